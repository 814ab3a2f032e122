"""Rows of ``hilfit bench faults`` about somebody else's bus, clocks and restarts: each so many times, from one seed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from benchmarks.acquisition import masters, restarts
from benchmarks.acquisition.masters import Row, Seen
from benchmarks.targets import Outcome, Show, fact, figure

RECOVERY_S = 2.0
AT_ONCE = 3  # times of a row beside each other: most of each is waiting
#: How many times run beside each other, and what.
ROWS: tuple[tuple[int, dict[str, Row]], ...] = ((AT_ONCE, masters.ROWS), (AT_ONCE, restarts.ROWS), (1, restarts.TRACES))


def names() -> tuple[str, ...]:
    """Return the names of all rows."""
    return tuple(name for _, rows in ROWS for name in rows)


def run_rows(times: int, seed: int, only: str | None, show: Show) -> Outcome:
    """Run every row so many times at random moments."""
    notes = [f"{'row':48s} ours  wrong  marked (excused)  heard, worst  recovery, worst    took"]
    seen: list[Seen] = []
    seeds = dict(zip(names(), np.random.SeedSequence(seed).spawn(len(names())), strict=True))
    for at_once, rows in ROWS:
        for name, row in rows.items():
            if only is not None and only not in name:
                continue
            began = time.monotonic()
            with ThreadPoolExecutor(at_once) as pool:
                found = list(pool.map(row, map(np.random.default_rng, seeds[name].spawn(times))))
            seen += found
            notes.append(_line(name, found, time.monotonic() - began))
            show(notes[-1])
            notes += [f"    {one.failed}" for one in found if one.failed][:3]
    marked = [one.marked for one in seen if one.marked is not None]
    recoveries = [one.recovery for one in seen if one.recovery is not None]
    frames, wrong, failed = (
        sum(one.frames for one in seen),
        sum(one.wrong for one in seen),
        sum(bool(one.failed) for one in seen),
    )
    return Outcome(
        (
            figure("frames of ours after another master's first", frames, most=0),
            figure("wrong values called fresh", wrong, most=0),
            figure("cycles marked, at most", max(marked, default=0), most=1),
            figure("slowest recovery", max(recoveries, default=0.0), "{:.2f} s", most=RECOVERY_S),
            fact("as it should be every time", not failed, f"{len(seen) - failed} of {len(seen)}"),
            fact("produced = stored + dropped", not sum(one.unbalanced for one in seen), f"{times} times each"),
        ),
        tuple(notes),
    )


def _line(name: str, found: Sequence[Seen], took: float) -> str:
    heard, recovery = (
        f"{max(told):.2f} s" if (told := [t for t in times if t is not None]) else "-"
        for times in ([one.heard for one in found], [one.recovery for one in found])
    )
    marked = [one.marked for one in found if one.marked is not None]
    excused = sum(one.excused for one in found)
    counts = f"{max(marked)} ({excused})" if marked else "-"
    return (
        f"{name:48s} {sum(one.frames for one in found):4d} {sum(one.wrong for one in found):6d} "
        f"{counts:>16s} {heard:>13s} {recovery:>16s} {took:5.0f} s"
    )
