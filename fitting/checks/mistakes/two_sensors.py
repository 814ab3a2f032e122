"""A joint's two position sensors against each other through the linkage: no dynamics, so the sharpest test there is.

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
from fitting.checks.mistakes.factors import gains
from fitting.checks.mistakes.machine_trials import changed_joint
from fitting.checks.mistakes.motion_trials import COUNTS, DELAYS, RATES, exchanged, fast, late, times_too
from fitting.checks.mistakes.samples import Samples, Signal

#: Misfit (of the piston's spread) and distance (of the stroke) up to which two sensors agree: what effects do.
AGREE, NEAR = 0.08, 0.15
#: What is left after the right trial, and how much better it has to be.
_LEFT, _CLEAR = 0.04, 3.0
#: What leaves up to this many times as much as the one that is said, or less than this, explains as well.
_THE_SAME, _LEAST, _MOST_ALTERNATIVES = 1.1, 0.002, 3


@dataclass(frozen=True)
class Option:
    """A mistake that may explain why two sensors contradict each other.

    Attributes
    ----------
    code, text, cure, key : of the finding
    machine, samples : with the mistake taken back, where it is in one of them
    price : simplicity: of two that explain alike, the one with the lower price is said
    quantity : sensor to blame, or None for the linkage or for both
    other : number of the joint that the sensor is exchanged with
    factor : number that it stands for
    """

    code: str
    text: str
    cure: str
    samples: Samples | None
    price: float = 1.0
    quantity: str | None = None
    other: int | None = None
    key: tuple[str | int, ...] = ()
    factor: float | None = None
    machine: Machine | None = None


@dataclass(frozen=True)
class Disagreement:
    """Two sensors that contradict each other, and what explains it.

    Attributes
    ----------
    joint : number of the joint
    before, after : misfit over the piston's spread
    option : what explains it; None: nothing that was tried
    alternatives : what explains as much
    """

    joint: int
    before: float
    after: float
    option: Option | None = None
    alternatives: tuple[str, ...] = ()


def gap(machine: Machine, number: int, q: FloatArray, x: FloatArray) -> tuple[float, float]:
    """Root mean square of ``x - L(q)`` less its median, over the larger of both spreads; that median in strokes."""
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


def disagreements(machine: Machine, samples: Samples) -> list[Disagreement]:
    """Joints whose two sensors contradict each other."""
    loaded = samples.loaded
    found: list[Disagreement] = []
    settled: set[int] = set()
    if np.count_nonzero(loaded) < 50:
        return []
    bad = {}
    for number, joint in enumerate(machine.joints):
        if joint.cylinder is None or not all(samples.get(k, number) for k in ("joint_position", "piston_position")):
            continue
        q, x = (own[loaded] for own in _both(samples, number))
        misfit, off = gap(machine, number, q, x)
        if misfit > AGREE or abs(off) > NEAR:
            bad[number] = (misfit, off)
    for number, (misfit, off) in bad.items():
        if number in settled:
            continue
        best = _explained(machine, samples, number, misfit, off, bad)
        found.append(best or Disagreement(number, misfit, misfit))
        if best is not None and best.option is not None and best.option.other is not None:
            settled.add(best.option.other)
    return found


def _explained(
    machine: Machine, samples: Samples, number: int, misfit: float, off: float, bad: Mapping[int, object]
) -> Disagreement | None:
    loaded = samples.loaded
    results = []
    for option in _options(machine, samples, number, bad):
        q, x = (own[loaded] for own in _both(option.samples or samples, number))
        left, distance = gap(option.machine or machine, number, q, x)
        if left < _LEFT and abs(distance) < NEAR and (left < misfit / _CLEAR or abs(off) > NEAR):
            results.append((option.price * max(left, 0.004) * (1 + 4 * abs(distance)), left, option))
    if not results:
        return None
    _, left, option = min(results, key=lambda item: item[0])
    others = [own for _, near, own in results if own is not option and near < max(_THE_SAME * left, _LEAST)]
    also = [own.text for own in others if own.code != option.code or own.quantity != option.quantity]
    return Disagreement(number, misfit, left, option, tuple(dict.fromkeys(also))[:_MOST_ALTERNATIVES])


def _both(samples: Samples, number: int) -> tuple[FloatArray, FloatArray]:
    """Joint and piston position of a joint, (T,) each."""
    return samples.signals["joint_position", number].value, samples.signals["piston_position", number].value


def _options(machine: Machine, samples: Samples, number: int, bad: Mapping[int, object]) -> Iterator[Option]:
    cylinder = machine.joints[number].cylinder
    assert cylinder is not None
    for quantity, about in (("joint_position", 0.0), ("piston_position", cylinder.stroke)):
        yield from _of_channel(machine, samples, number, quantity, about)
        yield from _exchanged(machine, samples, number, quantity, bad)
    if isinstance(cylinder.linkage, ThreePin):
        yield from _pins(machine, samples, number, cylinder.linkage)
    yield from _of_clocks(samples, number)


def _of_channel(machine: Machine, samples: Samples, number: int, quantity: str, about: float) -> Iterator[Option]:
    """One sensor counts the other way (its zero is at ``about`` then), or has another unit, scale or offset."""
    channel = machine.channel(quantity, machine.joints[number].name)
    assert channel is not None
    signal, mine = samples.signals[quantity, number], quantity == "joint_position"

    def option(said: tuple[str, str, str], new: Signal, price: float, factor: float) -> Option:
        changed = samples.replaced({(quantity, number): new})
        return Option(*said, changed, price, quantity, factor=factor)

    yield option(worded("sign/joint" if mine else "sign/piston"), signal.mapped(-1.0, about), 1.0, -1.0)
    for gain, unit in gains(machine.si_unit(channel), machine.conversion(channel).factor).items():
        yield option(worded("unit/like", says=unit), signal.mapped(gain), 1.0, gain)
    for gain in COUNTS:
        yield option(worded("scale/counts", times_too=times_too(gain)), signal.mapped(gain), 1.4, gain)
    for degrees in (90, -90, 180) if mine else ():
        offset = float(np.deg2rad(degrees))
        yield option(worded("offset/sensor", degrees=degrees), signal.mapped(1.0, offset), 1.5, offset)


def _exchanged(machine: Machine, samples: Samples, number: int, quantity: str, bad: Iterable[int]) -> Iterator[Option]:
    """It is exchanged with that of another joint whose sensors contradict each other as well."""
    signal = samples.signals[quantity, number]
    for other in bad:
        theirs = samples.get(quantity, other)
        if other != number and theirs is not None:
            swapped = samples.replaced({(quantity, number): theirs, (quantity, other): signal})
            yield Option(*exchanged(machine, quantity, number, other), swapped, 1.0, quantity, other)


def _of_clocks(samples: Samples, number: int) -> Iterator[Option]:
    """The clock of the piston's sensor is off, or runs at another rate."""
    for delay in (*DELAYS, -0.15, 0.15):
        moved = samples.moved([("piston_position", number)], delay)
        said = worded("clock_offset/sensor", seconds=abs(delay), late=late(delay))
        yield Option(*said, moved, 1.3, "piston_position", factor=delay)
    for rate in RATES:
        moved = samples.moved([("piston_position", number)], rate * samples.since)
        said = worded(f"clock_rate/sensor_{fast(rate)}", percent=1e2 * abs(rate))
        yield Option(*said, moved, 1.3, "piston_position", factor=rate)


def _pins(machine: Machine, samples: Samples, number: int, linkage: ThreePin) -> Iterator[Option]:
    """One length or the offset of the pins estimated from both sensors."""
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
        yield Option(
            *worded("linkage/estimated", name=name, new=best[1], old=value, unit=unit), None, 1.8,
            key=("joints", number, "cylinder", "linkage", name), factor=best[1] / value if value else None,
            machine=changed_joint(machine, number, "linkage", {name: best[1]}),
        )  # fmt: skip
