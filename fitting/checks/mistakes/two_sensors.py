"""A joint's two position sensors against each other through the linkage: no dynamics, so the most sensitive test.

Nominal is ``x = L(q)``. An offset of either sensor, pins that are a centimetre off and play are effects of the
catalogue: up to some per cent of the stroke. What is more has to be explained by one trial after another (another unit,
another sign, another joint's sensor, other pins, other clocks); each leaves its constant free, because an offset is the
most ordinary thing of all.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from daq.machine.linkages import ThreePin
from daq.machine.machine_file import Machine
from fitting.arm.linkage import parameter_names
from fitting.arrays import FloatArray
from fitting.checks.findings import worded
from fitting.checks.mistakes.hypothesis import Hypothesis
from fitting.checks.mistakes.machine_trials import changed_joint, on_machine
from fitting.checks.mistakes.motion_trials import (
    DELAYS,
    RATES,
    delayed,
    exchange,
    exchanged,
    fast,
    late,
    mapped,
    misread,
    stretched,
)
from fitting.checks.mistakes.physical import Trial
from fitting.checks.mistakes.samples import Samples

#: Misfit (of the piston's spread) and distance (of the stroke) up to which two sensors agree: what effects do.
AGREE, NEAR = 0.08, 0.15
#: What is left after the right trial, and how much better it has to be.
_LEFT, _CLEAR = 0.04, 3.0
#: What leaves up to this many times as much as the one that is said, or less than this, explains as well.
_THE_SAME, _LEAST, _MOST_ALTERNATIVES = 1.1, 0.002, 3


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


def gap(machine: Machine, number: int, q: FloatArray, x: FloatArray) -> tuple[float, float]:
    """Compute the RMS of ``x - L(q)`` less its median, over the larger of both spreads; that median in strokes."""
    cylinder = machine.joints[number].cylinder
    assert cylinder is not None
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
        misfit, off = gap(machine, number, q, x)
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
        left, distance = gap(tried.machine, number, q, x)
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
    cylinder = trial.machine.joints[number].cylinder
    assert cylinder is not None
    for quantity in ("joint_position", "piston_position"):
        for texts, gain, offset in misread(trial.machine, number, quantity):
            price = 1.4 if texts[0] == "scale" else 1.0
            build = mapped((quantity, number), gain, offset)
            yield Hypothesis(*texts, (number,), build, (quantity,), factor=gain, price=price)
        for degrees in (90, -90, 180) if quantity == "joint_position" else ():
            offset = float(np.deg2rad(degrees))
            build = mapped((quantity, number), 1.0, offset)
            texts = worded("offset/sensor", degrees=degrees)
            yield Hypothesis(*texts, (number,), build, (quantity,), factor=offset, price=1.5)
        # Exchanged with that of another joint whose sensors contradict each other as well.
        for other in bad:
            if other != number and trial.samples.get(quantity, other) is not None:
                texts = exchanged(trial.machine, quantity, number, other)
                yield Hypothesis(*texts, (number, other), exchange(quantity, number, other), (quantity,))
    if isinstance(cylinder.linkage, ThreePin):
        yield from _pins(trial.machine, trial.samples, number, cylinder.linkage)
    sensor = ("piston_position", number)
    for delay in (*DELAYS, -0.15, 0.15):
        texts = worded("clock_offset/sensor", seconds=abs(delay), late=late(delay))
        yield Hypothesis(*texts, (number,), delayed([sensor], delay), sensor[:1], factor=delay, price=1.3)
    for rate in RATES:
        texts = worded(f"clock_rate/sensor_{fast(rate)}", percent=1e2 * abs(rate))
        yield Hypothesis(*texts, (number,), stretched([sensor], rate), sensor[:1], factor=rate, price=1.3)


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
                trial = changed_joint(machine, number, "linkage", {name: float(new)})
                left, off = gap(trial, number, q[loaded], x[loaded])
                scored.append((left + max(abs(off) - 0.02, 0.0), float(new)))
            best = min(scored)
            step = abs(grid[1] - grid[0]) if name == "offset" else best[1] * (grid[1] / grid[0] - 1)
            grid = np.linspace(best[1] - step, best[1] + step, 9)
        assert best is not None
        # A centimetre, or six degrees, is linkage_geometry or encoder_offset.
        if abs(best[1] - value) < (0.12 if name == "offset" else 0.1 * abs(value)):
            continue
        unit = "rad" if name == "offset" else "m"
        yield Hypothesis(
            *worded("linkage/estimated", name=name, new=best[1], old=value, unit=unit), (number,),
            on_machine(lambda m, k=name, v=best[1]: changed_joint(m, number, "linkage", {k: v})),  # type: ignore[misc]
            key=("joints", number, "cylinder", "linkage", name), factor=best[1] / value if value else None, price=1.8,
        )  # fmt: skip
