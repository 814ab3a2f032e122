"""The base model of measured machines beside plain least squares: fitted on one motion, judged on another.

``ways`` are all ways to the base parameters at the default bandwidth, same rows, same filter; *plain least squares* is
one ordinary regression of everything on the ``train`` recordings, as a user would write it. Splits are all pairs of two
motions of one machine in three bandwidths, nothing of the second used; beside the base that is handed out are least
squares (a flat prior, all efforts alike) and the nearest fit within what is physically possible. Errors are
``100 |measured - predicted| / |measured|`` of joint efforts in the identification band."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measured import sets
from benchmarks.targets import Check, figure
from daq.errors import RecordingError
from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.loop.session import Options, Session
from fitting.pipeline.results.stage_results import Refitted, StageResults
from fitting.pipeline.stages import STEPS
from fitting.progress import quiet
from fitting.regression.error_sizes import errors_of

#: Identification bandwidths, Hz.
BANDS = (3.0, 4.5, 6.0)
#: Most that the base may cost over least squares, and over the better of least squares and the possible fit: in nine of
#: ten splits, and in all.
MOST_OVER, MOST_OVER_BETTER, MOST_IN_ALL = 1.02, 1.02, 1.1
#: Relative error in percent of the KUKA on another motion (published: 13.2), and at 3 Hz of its motions swapped.
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


def _splits(data: Path, scratch: Path) -> Iterator[tuple[str, Machine, list[Recording]]]:
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
    for name, machine, own in _splits(data, scratch):
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
    if not splits:
        return ()
    worst = max(splits, key=lambda split: split.over)
    better = max(splits, key=lambda split: split.over_better)
    share = float(np.mean([s.over_better <= MOST_OVER_BETTER for s in splits]))
    mean = float(np.exp(np.mean([np.log(s.over) for s in splits])))
    found = [
        Check("splits: base against least squares, geometric mean", mean, f"{mean:.3f} of {len(splits)} splits"),
        Check("splits: base against least squares, worst", worst.over, _at(worst, worst.over), "at most", MOST_OVER),
        Check(f"splits: base within {MOST_OVER_BETTER:g} of the better of least squares and possible", share,
              f"{100 * share:.0f} %", "at least", 0.9, "90 %"),
        Check("splits: the same, worst", better.over_better, _at(better, better.over_better), "at most", MOST_IN_ALL),
    ]  # fmt: skip
    for name, most in (("KUKA", KUKA), ("KUKA, swapped", KUKA_SWAPPED)):
        found += [
            figure(f"{name}: base at 3 Hz", s.base, "{:.2f} %", most=most)
            for s in splits
            if s.name == name and s.bandwidth_hz == BANDS[0]
        ]
    return tuple(found)


def _at(split: Split, value: float) -> str:
    return f"{value:.3f} ({split.name}, {split.bandwidth_hz:g} Hz)"


#: Share by which the base may be worse than plain least squares.
MOST_WORSE = 0.02


@dataclass(frozen=True)
class Ways:
    """The ways to one machine's base parameters.

    Attributes
    ----------
    machine : its name
    chosen : which one is handed out
    ratio : training error of the whitened fit over that of least squares
    training, held_out : relative error of each way that there is, percent; ``one_shot`` is plain least squares
    base, after : relative error on the held-out motion of the base that is handed out, and with what the loop added;
        the latter None where no loop was run
    impossible : parameters by which the report names violations of physics, with their values
    """

    machine: str
    chosen: str
    ratio: float
    training: dict[str, float]
    held_out: dict[str, float]
    base: float
    after: float | None
    impossible: tuple[str, ...]

    @property
    def worse(self) -> float:
        """Error of the base that is handed out over that of plain least squares, less one."""
        return self.base / self.held_out["one_shot"] - 1.0


def ways(name: str, session: Session) -> Ways:
    """Run both stages, and the loop where the session's options ask for it, and read off what every way leaves.

    Parameters
    ----------
    name : of the machine, for the table
    session : with a ``validate`` recording
    """
    results = StageResults()
    for compute in STEPS.values():
        results = results.having(compute(session, results, quiet))
    refitted = results[Refitted]
    estimation, relative = refitted.estimation, refitted.overall["relative"]
    tried = {way["name"]: way for way in estimation["tried"]}
    return Ways(
        name,
        str(estimation["chosen"]),
        float(estimation["ratio"]),
        {way: 100.0 * own["training_error"] for way, own in tried.items()},
        {way: 100.0 * own["held_out_error"] for way, own in tried.items()},
        100.0 * relative["before"],
        100.0 * relative["after"] if session.options.loop else None,
        tuple(map(_named, refitted.plausibility.violations)),
    )


def _named(violation: Mapping[str, Any]) -> str:
    """Name an impossible parameter with its value."""
    place = f"{violation['joint']}." if violation["joint"] else ""
    return f"`{place}{violation['parameter']}` = {violation['value']:.3g} {violation['unit']}"


def ways_checks(results: Sequence[Ways]) -> list[Check]:
    """Check the KUKA's base and what the loop added on another motion, and every base beside plain least squares."""
    found = []
    for own in results:
        if own.after is not None:
            shown = ", ".join(own.impossible) or "none"
            found += [
                figure("KUKA: relative error of the base model on another motion", own.base, "{:.2f} %", most=KUKA),
                figure("KUKA: the same with what the loop added", own.after, "{:.2f} %", most=KUKA),
                Check("KUKA: impossible parameters that the report names", None, shown),
            ]
    return found + [_beside(own) for own in results]


def _beside(result: Ways) -> Check:
    """Compare the resulting base with plain least squares on a motion that neither has seen."""
    shown = (
        f"{result.base:.2f} % ({result.chosen}) beside {result.held_out['one_shot']:.2f} %, {100 * result.worse:+.1f} %"
    )
    name = f"{result.machine}: base model against plain least squares, held-out motion"
    return figure(name, 100 * result.worse, "{:g} % worse", most=100 * MOST_WORSE, shown=shown)
