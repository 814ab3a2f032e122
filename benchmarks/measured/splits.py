"""The base model on every split of the measured sets and three bandwidths: fitted on one motion, judged on another.

A split is two motions of one machine, fitted on the first, nothing of the second used. Beside the base that is handed
out stand least squares (a flat prior, all efforts alike) and the nearest fit within what is physically possible.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.measured import sets
from benchmarks.targets import Check, figure
from daq.errors import RecordingError
from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.loop.session import Options, Session
from fitting.regression.error_sizes import errors_of

#: Identification bandwidths, Hz.
BANDS = (3.0, 4.5, 6.0)
#: Most that the base may cost over least squares, and over the better of least squares and the possible fit: in nine of
#: ten splits, and in all.
MOST_OVER, MOST_OVER_BETTER, MOST_IN_ALL = 1.02, 1.02, 1.1
#: Relative error in percent at 3 Hz of the KUKA and of its motions swapped.
KUKA, KUKA_SWAPPED = 4.4, 2.9


@dataclass(frozen=True)
class Split:
    """One split at one bandwidth; relative errors on the motion that was not fitted, percent.

    Attributes
    ----------
    name : of the machine and its split
    bandwidth_hz : of the identification filter
    weights : of the fit that is handed out; ``refused`` where the motion refuses the plausible arm
    base, least_squares, possible : errors
    """

    name: str
    bandwidth_hz: float
    weights: str
    base: float
    least_squares: float
    possible: float

    @property
    def over(self) -> float:
        """Error over that of least squares."""
        return self.base / self.least_squares

    @property
    def over_better(self) -> float:
        """Error over that of the better of least squares and the possible fit."""
        return self.base / min(self.least_squares, self.possible)


def recordings(data: Path, scratch: Path) -> Iterator[tuple[str, Machine, list[Recording]]]:
    """Yield every split of the sets that are there, by name."""
    for name, short in (("KUKA LWR", "KUKA"), ("EMPS", "EMPS")):
        if found := sets.read(name, data, scratch):
            yield short, *found
            yield f"{short}, swapped", found[0], sets.swapped(found[1][0], found[1][2])
            if short == "KUKA":  # at 3 Hz half as many rows as parameters
                sixth = sets.cut(found[1][2], 1 / 6)[0]
                yield f"{short}, swapped, a sixth", found[0], [sixth, replace(found[1][0], role="validate")]
    if found := sets.read("TX40", data, scratch):
        first, second = sets.cut(found[1][0], 0.5)
        yield "TX40, halves", found[0], [first, second]
        yield "TX40, halves swapped", found[0], sets.swapped(first, second)
        yield "TX40, last 30 %", found[0], list(sets.cut(found[1][0], sets.FITTED))
        yield "TX40, a third", found[0], list(sets.cut(found[1][0], 1 / 3))


def evaluate(data: Path, scratch: Path) -> tuple[list[Split], list[str]]:
    """Evaluate all splits, and a line for each impossible one: a filter longer than the motion."""
    splits, refused = [], []
    for name, machine, own in recordings(data, scratch):
        for band in BANDS:
            session = Session(machine, own, Options(loop=False, bandwidth_hz=band))
            try:
                base, design = session.weighted_base, session.plain.design
            except RecordingError:
                refused.append(f"{name} at {band:g} Hz: no stretch is as long as the filter")
                continue
            ways = {"base": base.model.fit.theta, **base.tried}
            errors = {way: 100.0 * errors_of(design, theta)[2]["validate"] for way, theta in ways.items()}
            weights = f"{base.weights}, refused" if session.prior.refused else base.weights
            splits.append(Split(name, band, weights, errors["base"], errors["least_squares"], errors["possible"]))
    return splits, refused


def checks(splits: list[Split]) -> tuple[Check, ...]:
    """Check the table against its targets."""
    worst = max(splits, key=lambda split: split.over)
    better = max(splits, key=lambda split: split.over_better)
    share = float(np.mean([s.over_better <= MOST_OVER_BETTER for s in splits]))
    mean = float(np.exp(np.mean([np.log(s.over) for s in splits])))
    found = [
        Check("splits: base against least squares, geometric mean", mean, f"{mean:.3f} of {len(splits)} splits"),
        Check("splits: base against least squares, worst", worst.over, _at(worst, worst.over), "at most", MOST_OVER),
        Check(
            f"splits: base within {MOST_OVER_BETTER:g} of the better of least squares and possible",
            share,
            f"{100 * share:.0f} %",
            "at least",
            0.9,
            "90 %",
        ),
        Check("splits: the same, worst", better.over_better, _at(better, better.over_better), "at most", MOST_IN_ALL),
    ]
    for name, most in (("KUKA", KUKA), ("KUKA, swapped", KUKA_SWAPPED)):
        found += [
            figure(f"{name}: base at 3 Hz", s.base, "{:.2f} %", most=most)
            for s in splits
            if s.name == name and s.bandwidth_hz == BANDS[0]
        ]
    return tuple(found)


def _at(split: Split, value: float) -> str:
    return f"{value:.3f} ({split.name}, {split.bandwidth_hz:g} Hz)"


def table(splits: list[Split], refused: list[str]) -> str:
    """Write the table of the page."""
    lines = [
        "| split | Hz | weights | least squares | possible | handed out | over least squares | over the better |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {s.name} | {s.bandwidth_hz:g} | {s.weights} | {s.least_squares:.2f} % | {s.possible:.2f} % | "
        f"**{s.base:.2f} %** | {s.over:.3f} | {s.over_better:.3f} |"
        for s in splits
    ]
    notes = f"\nNot possible: {'; '.join(refused)}.\n" if refused else ""
    return "\n".join(lines) + "\n" + notes
