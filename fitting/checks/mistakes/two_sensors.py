"""A joint's two position sensors against each other through the linkage: no dynamics, so the most sensitive test.

Nominal is ``x = L(q)``. An offset of either sensor, pins that are a centimetre off and play are effects of the
catalogue: up to some per cent of the stroke. What is more has to be explained by one trial after another (another unit,
another sign, another joint's sensor, other pins, other clocks); each leaves its constant free, because an offset is the
most ordinary thing of all.

Where two sensors contradict each other in some recordings and agree in others, rods are off where the role states they
are on, or on in an `unloaded` recording, or a recording is of another machine: then nothing is wrong with the machine
file, and that recording alone is left out. So are single seconds of one, in which the rods are elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from daq.errors import RecordingError
from daq.machine.linkages import ThreePin
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.recordings.recording import Recording
from fitting.arm.linkage import cylinder_of, parameter_names
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, finding_of, worded
from fitting.checks.mistakes import channel_trials as trials
from fitting.checks.mistakes.hypothesis import Hypothesis
from fitting.checks.mistakes.machine_trials import changed_joint, with_joint
from fitting.checks.mistakes.physical import Trial
from fitting.checks.mistakes.samples import Samples
from fitting.signals.rods import with_declared_rods

#: Misfit (of the piston's spread) and distance (of the stroke) up to which two sensors agree: what effects do.
AGREE, NEAR = 0.08, 0.15
#: What is left after the right trial, and how much better it has to be.
_LEFT, _CLEAR = 0.04, 3.0
#: What leaves up to this many times as much as the one that is named, or less than this, explains as well.
_THE_SAME, _LEAST, _MOST_ALTERNATIVES = 1.1, 0.002, 3
#: A joint's two sensors disagree in one recording only: by this share of the motion, and so many times the usual.
_ALONE_OFF, _TIMES = 0.03, 6.0


@dataclass(frozen=True)
class Disagreement:
    """Two sensors that contradict each other, and what explains it.

    Attributes
    ----------
    joint : number of the joint
    before, after : misfit over the piston's spread
    hypothesis : what explains it; None: nothing that was tried
    alternatives : what explains as much
    """

    joint: int
    before: float
    after: float
    hypothesis: Hypothesis | None = None
    alternatives: tuple[str, ...] = ()


def _gap(machine: Machine, number: int, q: FloatArray, x: FloatArray) -> tuple[float, float]:
    """Compute the RMS of ``x - L(q)`` less its median, over the larger of both spreads; that median in strokes."""
    cylinder = cylinder_of(machine.joints[number])
    with np.errstate(all="ignore"):
        y = cylinder.linkage.piston_position(q)
    distance = x - y
    if not np.all(np.isfinite(distance)):
        return np.inf, np.inf
    middle = float(np.median(distance))
    spread = max(float(np.std(x)), float(np.std(y)), 1e-3 * cylinder.stroke)
    # A third of the rows may be off (rods that are pinned late): they are another check's.
    inner = np.sort(np.abs(distance - middle))[: max(10, round(0.9 * len(distance)))]
    return float(np.sqrt(np.mean(inner**2))) / spread, middle / cylinder.stroke


def disagreements(trial: Trial) -> tuple[list[Disagreement], Trial]:
    """Find joints whose two sensors contradict each other, and the trial with the cause taken back."""
    machine, samples = trial.machine, trial.samples
    loaded = samples.loaded
    found: list[Disagreement] = []
    settled: set[int] = set()
    if np.count_nonzero(loaded) < 50:
        return [], trial
    bad = {}
    for number, joint in enumerate(machine.joints):
        if joint.cylinder is None or not all(samples.get(k, number) for k in ("joint_position", "piston_position")):
            continue
        q, x = (own[loaded] for own in _both(samples, number))
        misfit, off = _gap(machine, number, q, x)
        if misfit > AGREE or abs(off) > NEAR:
            bad[number] = (misfit, off)
    right = trial
    for number, (misfit, off) in bad.items():
        if number in settled:
            continue
        best = _explained(trial, number, misfit, off, bad)
        found.append(best or Disagreement(number, misfit, misfit))
        if best is not None and best.hypothesis is not None:
            settled.update(best.hypothesis.joints)
            right = best.hypothesis.build(right, {})[0]
    return found, right


def _explained(trial: Trial, number: int, misfit: float, off: float, bad: Mapping[int, object]) -> Disagreement | None:
    loaded = trial.samples.loaded
    results = []
    for option in _options(trial, number, bad):
        tried, _ = option.build(trial, {})
        q, x = (own[loaded] for own in _both(tried.samples, number))
        left, distance = _gap(tried.machine, number, q, x)
        if left < _LEFT and abs(distance) < NEAR and (left < misfit / _CLEAR or abs(off) > NEAR):
            results.append((option.price * max(left, 0.004) * (1 + 4 * abs(distance)), left, option))
    if not results:
        return None
    _, left, option = min(results, key=lambda item: item[0])
    others = [own for _, near, own in results if own is not option and near < max(_THE_SAME * left, _LEAST)]
    also = [own.text for own in others if own.code != option.code or own.channels != option.channels]
    return Disagreement(number, misfit, left, option, tuple(dict.fromkeys(also))[:_MOST_ALTERNATIVES])


def _both(samples: Samples, number: int) -> tuple[FloatArray, FloatArray]:
    """Return joint and piston position of a joint, (T,) each."""
    return samples.signals["joint_position", number].value, samples.signals["piston_position", number].value


def _options(trial: Trial, number: int, bad: Iterable[int]) -> Iterator[Hypothesis]:
    linkage = cylinder_of(trial.machine.joints[number]).linkage
    for quantity in ("joint_position", "piston_position"):
        yield from trials.misread(trial.machine, number, quantity, 1.4)
        for degrees in (90, -90, 180) if quantity == "joint_position" else ():
            texts = worded("offset/sensor", degrees=degrees)
            yield trials.sensor(texts, number, quantity, 1.0, float(np.deg2rad(degrees)), 1.5)
        # Exchanged with that of another joint whose sensors contradict each other as well.
        for other in bad:
            if other != number and trial.samples.get(quantity, other) is not None:
                build = trials.exchange(quantity, number, other)
                yield trials.exchanged(trial.machine, [(quantity, quantity)], number, other, build, price=1.0)
    if isinstance(linkage, ThreePin):
        yield from _pins(trial.machine, trial.samples, number, linkage)
    piston = ("piston_position", number)
    for delay in (*trials.DELAYS, -0.15, 0.15):
        texts = worded("clock_offset/sensor", seconds=abs(delay), late=trials.late(delay))
        yield Hypothesis(*texts, (number,), trials.delayed([piston], delay), piston[:1], factor=delay, price=1.3)
    for rate in trials.RATES:
        texts = worded(f"clock_rate/sensor_{trials.fast(rate)}", percent=1e2 * abs(rate))
        yield Hypothesis(*texts, (number,), trials.stretched([piston], rate), piston[:1], factor=rate, price=1.3)


def _pins(machine: Machine, samples: Samples, number: int, linkage: ThreePin) -> Iterator[Hypothesis]:
    """Estimate one length or the offset of the pins from both sensors."""
    loaded = samples.loaded
    q, x = _both(samples, number)
    for name in parameter_names(linkage):
        value = float(getattr(linkage, name))
        if name == "offset":
            grid = value + np.linspace(-np.pi, np.pi, 73)
        else:
            grid = value * np.geomspace(0.08, 12.0, 61)
        best: tuple[float, float] | None = None
        for _ in range(3):
            scored = []
            for new in grid:
                trial = changed_joint(machine, number, "linkage", name, float(new))
                left, off = _gap(trial, number, q[loaded], x[loaded])
                scored.append((left + max(abs(off) - 0.02, 0.0), float(new)))
            best = min(scored)
            step = abs(grid[1] - grid[0]) if name == "offset" else best[1] * (grid[1] / grid[0] - 1)
            grid = np.linspace(best[1] - step, best[1] + step, 9)
        assert best is not None
        # A centimetre, or six degrees, is linkage_geometry or encoder_offset.
        if abs(best[1] - value) < (0.12 if name == "offset" else 0.1 * abs(value)):
            continue
        texts = worded("linkage/estimated", name=name, new=best[1], old=value, unit="rad" if name == "offset" else "m")
        key, factor = ("joints", number, "cylinder", "linkage", name), best[1] / value if value else None
        build = with_joint(number, "linkage", name, best[1])
        yield Hypothesis(*texts, (number,), build, key=key, factor=factor, price=1.8)


def recordings_apart(machine: Machine, recordings: Sequence[Recording]) -> tuple[list[Finding], list[Recording]]:
    """Find and leave out recordings in which the two sensors contradict each other while they agree in others."""
    both = [
        (k, angle.name, piston.name)
        for k, joint in enumerate(machine.joints)
        if joint.cylinder is not None
        and (angle := machine.channel("joint_position", joint.name)) is not None
        and (piston := machine.channel("piston_position", joint.name)) is not None
    ]
    found: list[Finding] = []
    kept: list[Recording] = []
    verdicts: list[tuple[Recording, int, int, int]] = []
    gaps: dict[str, dict[int, float]] = {}
    for recording in recordings:
        off = alone = 0
        own = gaps[recording.file] = dict[int, float]()
        for number, first, second in both:
            if first not in recording.values or second not in recording.values:
                continue
            q, x = recording.values[first], recording.values[second]
            known = np.isfinite(q) & np.isfinite(x)
            cylinder = cylinder_of(machine.joints[number])
            if np.count_nonzero(known) < 50 or np.ptp(x[known]) < 0.02 * cylinder.stroke:
                continue
            own[number], away = _gap(machine, number, q[known], x[known])
            off += own[number] > AGREE or abs(away) > NEAR
            follows = float(np.std(cylinder.linkage.piston_position(q[known])))
            alone += follows < 0.1 * float(np.std(x[known]))
        verdicts.append((recording, len(own), off, alone))
    for recording, seen, off, alone in verdicts:
        other, wrong = 0, ""
        if recording.role == "unloaded":
            wrong = "wrong_role/rods_on" if seen and off == 0 and alone == 0 else ""
        elif seen and alone == seen and off:
            wrong = "wrong_role/rods_off"
        elif other := _alone_off(recording, recordings, gaps):
            wrong = "other_machine"
        if wrong:
            details: dict[str, Any] = {"other": other, "seen": seen, "before": off / max(seen, 1)}
            found.append(finding_of(wrong, recording=recording.file, strength=8.0, **details))
        else:
            kept.append(recording)
    return found, kept


def rods_for_a_time(machine: Machine, recordings: Sequence[Recording]) -> tuple[list[Finding], list[Recording]]:
    """Find recordings whose rods are not where the role states for a time, and leave out those rows.

    An identification leaves the same rows out. Recordings in which that is so all the time are
    :func:`recordings_apart`, and are returned as they are.
    """
    found: list[Finding] = []
    kept: list[Recording] = []
    for recording in recordings:
        try:
            (without,), lines = with_declared_rods(machine, [recording])
        except RecordingError:
            without, lines = recording, ()
        kept.append(without)
        cure = Sentence("fitting.identification_leaves_them_out")
        found += [Finding("rods", line, cure, recording=recording.file, severity="note") for line in lines]
    return found, kept


def _alone_off(recording: Recording, recordings: Sequence[Recording], gaps: Mapping[str, Mapping[int, float]]) -> int:
    """Count the joints in which a recording's two sensors disagree that agree in the others."""
    others = [gaps[r.file] for r in recordings if r is not recording and r.role != "unloaded"]
    count = 0
    for joint, misfit in gaps[recording.file].items():
        elsewhere = [own[joint] for own in others if joint in own]
        count += len(elsewhere) >= 2 and misfit > max(_ALONE_OFF, _TIMES * float(np.median(elsewhere)))
    return count
