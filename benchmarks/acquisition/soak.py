"""Faults of all kinds one after another for a long time: every value is accounted for, and memory does not grow."""

from __future__ import annotations

import os
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.acquisition.faults import LASTS_S, PATIENCE_S, WARM_UP_S, Bench, faults_of
from benchmarks.targets import Outcome, Show, fact, figure
from daq.acquisition.ring import RingReader
from sim_backends.faults.fault_runner import begin, end

PAUSE_S = (0.5, 3.0)
SETTLED = 0.25  # of the time, after which memory is compared
GROWTH_MB = 8.0  # that pools of the allocator may still fill up by
_MB = 2.0**20


def resident(pid: int) -> float:
    """Read the resident memory of a process in bytes, without what it shares (proc(5): statm).

    The ring is shared: it is resident as far as it was ever written to, which takes its ten minutes of machine time.
    """
    _, whole, shared, *_ = Path(f"/proc/{pid}/statm").read_text().split()
    return (int(whole) - int(shared)) * os.sysconf("SC_PAGE_SIZE")


def run(minutes: float, seed: int, say: Show) -> Outcome:
    """Cause faults at random for so long.

    Parameters
    ----------
    minutes : of the wall
    seed : of which fault comes when
    """
    random = np.random.default_rng(seed)
    with ExitStack() as stack:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="hilfit-bench-")))
        bench = Bench(directory, stack, real_time=False)
        faults = faults_of(bench.declared)
        with RingReader(bench.acquisition.ring_name) as ring:
            acquisition = ring.writer_pid
        bench.read(WARM_UP_S)
        began, memory, count, unrecovered = time.monotonic(), [], 0, 0
        said = began
        while (now := time.monotonic()) - began < 60 * minutes:
            name, fault = faults[int(random.integers(len(faults)))]
            begin(bench.machine, bench.declared, fault)
            bench.read(random.uniform(*LASTS_S))
            end(bench.machine, bench.declared, fault)
            count += 1
            if bench.recovered(time.monotonic_ns()) is None:
                unrecovered += 1
                say(f"{name}: not all fresh again after {PATIENCE_S:g} s")
            bench.read(random.uniform(*PAUSE_S))
            bench.rows.clear()  # a recording of hours is the recorder's business, not this process's
            memory.append((now - began, resident(acquisition)))
            if now - said > 60:
                said = now
                say(f"{(now - began) / 60:5.0f} min, {count} faults, acquisition has {memory[-1][1] / _MB:.0f} MB")
        statistics = bench.acquisition.statistics()
        summary = bench.recorder.stop()
    unbalanced = [n for n, e in summary.ledger.items() if e["produced"] != e["stored"] + sum(e["dropped"].values())]
    settled = [size for at, size in memory if at >= SETTLED * 60 * minutes]
    growth = (settled[-1] - settled[0]) / _MB
    grown = f"{growth:+.1f} MB after the first quarter, {settled[-1] / _MB:.0f} MB at the end"
    checks = (
        fact("produced = stored + dropped", not unbalanced, f"{len(summary.ledger)} channels, {summary.rows} rows"),
        figure("frames that are not in the recording", summary.missed_cycles, most=0),
        figure("cycles skipped", statistics.skipped, most=0),
        figure("faults that were not overcome", unrecovered, most=0, shown=f"{unrecovered} of {count}"),
        figure("growth of acquisition's memory", growth, "{:g} MB", most=GROWTH_MB, shown=grown),
    )
    return Outcome(checks, (f"{minutes:g} min, load of the computer {os.getloadavg()[0]:.1f}",))
