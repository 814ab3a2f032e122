"""Seal friction of a pneumatic cylinder against pressure: five seals, one to seven bar.

Data: Zillen, TU Delft (CC0). A tester moves the rod slowly to and fro; head side at a regulated pressure, rod side
open. With the load cell's force as a measured external force, ``p A - F`` is what friction and mass take, so an
ordinary machine file and the ordinary loop serve. A recording is one pressure; every pressure between the lowest and
the highest is kept for `validate` once, and the loop is run each time.

Beside the loop there is the elementary reading: half the width of the force loop at mid-stroke, less what the pressure
regulator's own hysteresis contributes, cycle by cycle; a straight line over the pressures, weighted by the spread
of the cycles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measured.stacks import Found, loop, refitted, stack_of
from benchmarks.pages import svg
from benchmarks.targets import Check, figure
from daq.machine.machine_file import Machine, load_machine, machine_to_yaml
from daq.quality import Quality
from daq.recordings.recording import read_recording, write_recording
from fitting.arrays import BoolArray, FloatArray
from fitting.effects import effect
from fitting.loop.session import Options, Session
from fitting.residual.laws import Law
from fitting.residual.terms import Term

MACHINE = Path(__file__).parent / "machines" / "pneumatic_cylinder.yaml"
#: Pressures in bar that a seal was tried at.
SEALS: dict[str, tuple[int, ...]] = {
    "Circle": (1, 3, 5, 7),
    "NAP310": (1, 3, 5, 7),
    "O-ring257": (1, 3, 5, 7),
    "Kidney": (1, 2, 3, 4),
    "X-ring257": (1, 3),
}
EFFECT = "pressure_dependent_friction"
BAR = 1e5
#: The motion is a slow triangle, a tenth of a hertz; its corners would mislead the automatic choice.
BANDWIDTH_HZ = 3.0
_RETRACTED = 0.045  # m on the tester's scale where the rod counts as retracted: beyond its largest reading
_RUN_IN = 8.5  # s, the first cycle: the seal settles
_MIDDLE = (0.015, 0.035)  # m of the rod's travel where both directions run steadily
_HOLE = 0.05  # s between samples from which rows count as missing


@dataclass(frozen=True)
class Pressure:
    """Friction read from the force loops at one pressure.

    Attributes
    ----------
    bar : mean pressure
    friction, std : N, mean over the cycles and its standard error
    width : N, half the loop's width, with what the regulator contributes
    retracting, extending : m/s, speeds at mid-stroke
    cycles : how many
    """

    bar: float
    friction: float
    std: float
    width: float
    retracting: float
    extending: float
    cycles: int


@dataclass(frozen=True)
class Trial:
    """The loop with one pressure kept for `validate`.

    Attributes
    ----------
    kept : that pressure, bar; None where there are only two
    found : what the loop found
    fitted, fitted_std : N/bar, slope of the effect in the joint refit, with the other effects that were added
    before, after : error on the fitted recordings and on `validate` (None without one), N
    """

    kept: int | None
    found: Found
    fitted: float
    fitted_std: float
    before: tuple[float, float | None]
    after: tuple[float, float | None]

    @property
    def named(self) -> bool:
        """True if the effect was named, alone or in a set."""
        return self.found.in_a_set(EFFECT)


@dataclass(frozen=True)
class Seal:
    """Results for one seal.

    Attributes
    ----------
    name : of the seal
    bore : m, of the area that carries the mean force
    readings : per pressure
    slope, slope_std : N/bar, of the friction over the pressure, from the loops' widths
    trials : the loop, with each inner pressure kept once
    """

    name: str
    bore: float
    readings: tuple[Pressure, ...]
    slope: float
    slope_std: float
    trials: tuple[Trial, ...]


@dataclass(frozen=True)
class _Run:
    """One file on an even time base: rod position (m, extension positive), pressure (Pa), force (N), holes."""

    time: FloatArray
    position: FloatArray
    pressure: FloatArray
    force: FloatArray
    missing: BoolArray


def read_run(path: Path) -> _Run:
    """Read one file: tab separated, time in ms, displacement in mm, pressure in bar, force in N."""
    table = np.loadtxt(path, delimiter="\t")
    stamps = (table[:, 0] - table[0, 0]) / 1e3
    time = np.arange(0.0, stamps[-1], 0.01)
    displacement, pressure, force = (np.interp(time, stamps, table[:, k]) for k in (4, 5, 6))
    after = np.clip(np.searchsorted(stamps, time), 1, len(stamps) - 1)
    missing = stamps[after] - stamps[after - 1] > _HOLE
    return _Run(time, _RETRACTED - 1e-3 * displacement, BAR * pressure, force, missing)


def _half_strokes(run: _Run) -> tuple[FloatArray, FloatArray]:
    """Average force, pressure and speed of each pass through mid-stroke, (K, 3) retracting, (K, 3) extending.

    The first of either is left out: the seal settles.
    """
    inside = (run.position > _MIDDLE[0]) & (run.position < _MIDDLE[1]) & ~run.missing
    rows = np.flatnonzero(inside)
    passes = [part for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(part) > 50]
    ways = [run.position[part[-1]] - run.position[part[0]] for part in passes]
    speeds = [way / (run.time[part[-1]] - run.time[part[0]]) for way, part in zip(ways, passes, strict=True)]
    means = np.array(
        [(run.force[p].mean(), run.pressure[p].mean(), abs(v)) for p, v in zip(passes, speeds, strict=True)]
    )
    steady = np.abs(ways) > 0.8 * (_MIDDLE[1] - _MIDDLE[0])
    return means[steady & (np.array(ways) < 0)][1:], means[steady & (np.array(ways) > 0)][1:]


def readings(runs: Sequence[_Run]) -> tuple[float, tuple[Pressure, ...]]:
    """Find the area in m^2 that carries the mean force, and the friction at every pressure.

    Retracting, the tester pushes ``p A + friction``; extending, it holds ``p A - friction``.
    """
    passes = [_half_strokes(run) for run in runs]
    middle = np.array([(r.mean(axis=0) + e.mean(axis=0)) / 2 for r, e in passes])
    area = float(np.polyfit(middle[:, 1], middle[:, 0], 1)[0])
    result = []
    for retracting, extending in passes:
        cycles = min(len(retracting), len(extending))
        halves = (retracting[:cycles] - extending[:cycles]) / 2
        friction = halves[:, 0] - area * halves[:, 1]
        error = float(np.std(friction, ddof=1) / np.sqrt(cycles))
        pressure = float((retracting.mean(axis=0)[1] + extending.mean(axis=0)[1]) / 2)
        width, inward, outward = (float(own.mean()) for own in (halves[:, 0], retracting[:, 2], extending[:, 2]))
        result.append(Pressure(pressure / BAR, float(friction.mean()), error, width, inward, outward, cycles))
    return area, tuple(result)


def line(read: Sequence[Pressure]) -> tuple[float, float, float]:
    """Fit a weighted straight line: friction at 0 bar (N), slope (N/bar) and its deviation.

    Weights are the cycles' spread. Where the pressures scatter about the line by more than that, which is what a law
    that is not quite straight does, the standard deviation is enlarged accordingly.
    """
    bar = np.array([r.bar for r in read])
    y = np.array([r.friction for r in read])
    weight = 1.0 / np.maximum([r.std for r in read], 0.02)
    (slope, start), covariance = np.polyfit(bar, y, 1, w=weight, cov="unscaled")
    freedom = len(y) - 2
    scatter = float(np.sum((weight * (y - start - slope * bar)) ** 2) / freedom) if freedom else 1.0
    return float(start), float(slope), float(np.sqrt(covariance[0, 0] * max(scatter, 1.0)))


def machine_of(seal: str, area: float) -> Machine:
    """Make the machine file with a seal's name and bore."""
    machine = load_machine(MACHINE)
    joint = machine.joints[0]
    assert joint.cylinder is not None
    cylinder = joint.cylinder.model_copy(update={"bore": round(float(np.sqrt(4 * area / np.pi)), 5)})
    return machine.model_copy(update={"name": seal, "joints": (joint.model_copy(update={"cylinder": cylinder}),)})


def evaluate(data: Path, directory: Path, seal: str, kept: Sequence[int | None] | None = None) -> Seal:
    """Read the loops, run the loop, and refit with the effect's slope.

    Parameters
    ----------
    data, directory : files of the data set; where recordings and results are written
    seal : its name
    kept : pressures to keep for `validate`, one run each; all inner ones if not given
    """
    pressures = SEALS[seal]
    runs = [read_run(data / f"{seal}_{bar}bar.csv") for bar in pressures]
    area, read = readings(runs)
    machine = machine_of(seal, area)
    file = directory / f"{seal}.yaml"
    file.write_text(machine_to_yaml(machine), encoding="utf-8")
    paths = {bar: _written(directory, machine, seal, bar, run) for bar, run in zip(pressures, runs, strict=True)}
    chosen = (pressures[1:-1] or (None,)) if kept is None else kept
    _, slope, slope_std = line(read)
    return Seal(
        name=seal,
        bore=2 * float(np.sqrt(area / np.pi)),
        readings=read,
        slope=slope,
        slope_std=slope_std,
        trials=tuple(_trial(file, paths, bar, directory / f"{seal}-{bar}") for bar in chosen),
    )


def _trial(file: Path, paths: Mapping[int, Path], kept: int | None, output: Path) -> Trial:
    machine = load_machine(file)
    recordings = [("validate" if bar == kept else "train", path) for bar, path in paths.items()]
    options = Options(bandwidth_hz=BANDWIDTH_HZ)
    found = loop(file, recordings, output, options)
    session = Session(machine, [read_recording(path, machine, role) for role, path in recordings], options)
    own = Term(effect(EFFECT), 0, {"head": 1.0, "rod": 0.0})
    terms = [*(term for term in found.terms if not _same(term)), own]
    model = refitted(session, terms, found)
    place = model.term_slice(len(terms) - 1)
    return Trial(
        kept=kept,
        found=found,
        fitted=BAR * float(model.fit.theta[place][0]),
        fitted_std=BAR * float(model.fit.std[place][0]),
        before=_errors(session, ()),
        after=_errors(session, found.terms, found),
    )


def _same(term: Term) -> bool:
    """Test whether a term is the effect itself, by another name or as a law of the same signal."""
    if isinstance(term.content, Law):
        return term.content.signal in ("cylinder_force", "head_pressure")
    return term.id in ("load_dependent_friction", EFFECT)


def _written(directory: Path, machine: Machine, seal: str, bar: int, run: _Run) -> Path:
    used = run.time > _RUN_IN
    flags = np.where(run.missing[used], int(Quality.MISSING), int(Quality.FRESH))
    values = {"rod.position": run.position[used], "rod.pressure": run.pressure[used], "rod.load_cell": run.force[used]}
    path, quality = directory / f"{seal}-{bar}.parquet", dict.fromkeys(values, flags)
    return write_recording(path, machine, "train", run.time[used], values, quality=quality)


def _errors(session: Session, terms: Sequence[Term], found: Found | None = None) -> tuple[float, float | None]:
    """Compute the deviation of the moving rows' error on the fitted recordings, and on `validate`."""
    model = refitted(session, terms, found)
    errors: dict[bool, list[FloatArray]] = {False: [], True: []}
    for index, segment in enumerate(model.design.segments):
        errors[segment.role == "validate"].append(stack_of(model, index).moving_error(model.fit.theta)[0])
    own = float(np.std(np.concatenate(errors[False])))
    return own, float(np.std(np.concatenate(errors[True]))) if errors[True] else None


def checks(results: Sequence[Seal]) -> tuple[Check, ...]:
    """Check that a run of each seal names its friction."""
    found = []
    for seal in results:
        runs = [trial for trial in seal.trials if trial.kept is not None]
        named = sum(trial.named for trial in runs)
        slope = f"{seal.slope:.2f} ± {seal.slope_std:.2f} N/bar"
        name = f"pneumatic cylinder, {seal.name}: runs that name pressure-dependent friction, alone or in a set"
        if runs:
            found.append(figure(name, float(named), least=1.0, shown=f"{named} of {len(runs)}; {slope}"))
        else:
            found.append(Check(name, None, f"two pressures only; {slope}"))
    return tuple(found)


_COLOURS = ("#1f6f8b", "#b3541e", "#4b7f2b", "#7a3e9d", "#8a6d00")
_MARKERS = "osD^v"


def drawn(seals: Sequence[Seal]) -> str:
    """Plot friction against pressure of every seal, with standard errors and the weighted line."""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        for seal, colour, marker in zip(seals, _COLOURS, _MARKERS, strict=False):
            bar = np.array([reading.bar for reading in seal.readings])
            force = [reading.friction for reading in seal.readings]
            ax.errorbar(
                bar, force, yerr=[reading.std for reading in seal.readings], fmt=marker, color=colour, capsize=3,
                label=f"{seal.name}: {seal.slope:.2f} ± {seal.slope_std:.2f} N/bar",
            )  # fmt: skip
            start, slope, _ = line(seal.readings)
            ax.plot(bar, start + slope * bar, color=colour, linewidth=1.0)
        ax.set_xlabel("pressure [bar]")
        ax.set_ylabel("friction [N]")
        ax.set_ylim(bottom=0.0)
        ax.legend(loc="lower right")

    return svg(draw, 6.4, 4.2)
