"""Trials of what channels hold: signs, units, offsets, exchanged cables, clocks, and the roles of recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from daq.machine.joints import Cylinder
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from fitting.arrays import BoolArray
from fitting.checks.findings import worded
from fitting.checks.mistakes.hypothesis import CLEAR, Build, Hypothesis, Targets, gains
from fitting.checks.mistakes.physical import Trial, declared, quantity_of
from fitting.checks.mistakes.samples import EFFORTS, PRESSURES, Samples, Signal

#: Quantities of channels that are exchanged: each of one joint with one of another.
Pairs: TypeAlias = Sequence[tuple[str, str]]
#: Factors by which an encoder's counts are mistaken: edges of both tracks, one of two, diameters for radii.
COUNTS = (0.25, 0.5, 2.0, 4.0)
#: Shares of a stroke by which the zero of a piston's sensor is off.
ZEROS = (-0.5, -0.33, -0.2, 0.2, 0.33, 0.5)
#: Scales of a whole effort that are tried; a transducer's gain is an effect up to ten per cent.
SCALES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.25, 1.4, 1.6, 2.0, 2.5, 3.3, 5.0, 10.0)
#: Delays that are tried, s: beyond the tens of milliseconds of a late sensor.
DELAYS = (-2.0, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 2.0)
#: Clocks that run fast or slow against one another.
RATES = (-0.02, -0.01, -0.005, -0.002, 0.002, 0.005, 0.01, 0.02)
#: Rates that a recorder may have run at instead, over the one of its time column; 20: milliseconds at 50 Hz.
TRUE_RATES = (0.05, 0.1, 0.2, 0.5, 2.0, 5.0, 10.0, 20.0)
#: An arm on the rods never explains less where there is one; noise of a small arm leaves this much of the difference.
_RODS_ON = 1.4
#: Leaving a recording out is a trial that a payload or another oil also passes a little: it has to do more than others.
_CLEARLY_ANOTHER = 3.5


def weighted(number: int, change: Callable[[Mapping[str, float]], Mapping[str, float]]) -> Build:
    """Build a trial with other weights of the signals in a joint's effort."""

    def build(trial: Trial, targets: Targets) -> tuple[Trial, Targets]:
        own = targets.get(number) or declared(trial.machine, trial.samples, number)
        return trial, {**targets, number: change(own)}

    return build


def _times(number: int, gain: float, *, only: str = "", but: str = "") -> Build:
    """Build a trial with all signals of a joint's effort times ``gain``, ``only`` one of them, or all ``but`` one."""
    return weighted(number, lambda own: {k: gain * v if only in ("", k) and k != but else v for k, v in own.items()})


def efforts(trial: Trial, *, exchanges: bool = True) -> Iterator[Hypothesis]:
    """Try a joint's chambers swapped, its signs and units, and its cables exchanged with another joint's."""
    machine = trial.machine
    for j, joint in enumerate(machine.joints):
        if trial.blocks[j] is None:
            continue
        own = declared(machine, trial.samples, j)
        if joint.cylinder is not None and f"head_pressure{j}" in own:
            yield from _chambers(trial, j, joint.cylinder)
        measured = next((q for q in ("cylinder_force", "joint_effort") if f"{q}{j}" in own), None)
        texts, channels = worded("sign/scale" if measured else "sign/effort"), (measured,) if measured else PRESSURES
        build = _times(j, -1.0, but="known")
        yield Hypothesis(*texts, (j,), build, channels, factor=-1.0, price=1.3, exact=True)
        if measured is not None and len(machine.joints) > 1:
            yield from _units(machine, j, measured)
        for other in range(j + 1, len(machine.joints)) if exchanges else ():
            yield from _exchanges(trial, j, other)


def _chambers(trial: Trial, number: int, cylinder: Cylinder) -> Iterator[Hypothesis]:
    """Try a cylinder's chambers swapped, and sign and unit of each pressure."""
    head, rod = (f"{quantity}{number}" for quantity in PRESSURES)
    build = weighted(number, lambda own: {**own, head: -cylinder.rod_area, rod: cylinder.head_area})
    yield Hypothesis(*worded("swapped_chambers"), (number,), build, PRESSURES, exact=True)
    for quantity, name in zip(PRESSURES, (head, rod), strict=True):
        signal = trial.samples.get(quantity, number)
        if signal is not None and np.median(signal.value) < 0:  # a pressure with the right sign is positive
            build = _times(number, -1.0, only=name)
            yield Hypothesis(*worded("sign/scale"), (number,), build, (quantity,), factor=-1.0, price=1.2, exact=True)
        yield from _units(trial.machine, number, quantity, name)


def _units(machine: Machine, number: int, quantity: str, only: str = "") -> Iterator[Hypothesis]:
    """Try other units of a channel of a joint's effort: of the whole effort, or of its signal ``only``."""
    channel = machine.channel(quantity, machine.joints[number].name)
    assert channel is not None
    for gain, unit in gains(machine, channel).items():
        build = _times(number, gain, only=only)
        yield Hypothesis(*worded("unit/like", says=unit), (number,), build, (quantity,), factor=gain)


def _exchanges(trial: Trial, j: int, other: int) -> Iterator[Hypothesis]:
    """Exchange channels of two joints: the whole effort, or one chamber of each."""
    both = [{quantity_of(name) for name in declared(trial.machine, trial.samples, k)} for k in (j, other)]
    quantities = sorted(both[0] & both[1] - {"known"})
    if not quantities or trial.blocks[other] is None:
        return

    def build_of(pairs: Pairs) -> Build:
        there = {f"{q}{j}": f"{p}{other}" for q, p in pairs}
        names = there | {theirs: own for own, theirs in there.items()}

        def build(trial: Trial, targets: Targets) -> tuple[Trial, Targets]:
            own = {k: targets.get(k) or declared(trial.machine, trial.samples, k) for k in (j, other)}
            return trial, {**targets, **{k: {names.get(n, n): w for n, w in own[k].items()} for k in own}}

        return build

    for pairs in _pairs(quantities):
        yield exchanged(trial.machine, pairs, j, other, build_of(pairs), exact=True)


def _pairs(quantities: Sequence[str]) -> Iterator[Pairs]:
    """Yield what may be exchanged between two joints that have these channels: all, one, and a head with a rod."""
    same = [(q, q) for q in quantities]
    if same:
        yield tuple(same)
    chambers = (PRESSURES, PRESSURES[::-1]) if {*PRESSURES} <= {*quantities} else ()
    for pair in (*(same if len(same) > 1 else ()), *chambers):
        yield (pair,)


def scales(trial: Trial) -> Iterator[Hypothesis]:
    """Try a joint's effort too large or too small as a whole, whatever the reason."""
    for j in range(len(trial.machine.joints)):
        for factor in () if trial.blocks[j] is None or len(trial.machine.joints) < 2 else SCALES:
            texts, build = worded("effort_scale", times=1 / factor), _times(j, factor, but="known")
            yield Hypothesis(*texts, (j,), build, key=("joints", j), factor=factor, price=1.75)


def _on_samples(change: Callable[[Samples], Samples]) -> Build:
    """Build a trial with other samples."""
    return lambda trial, targets: (trial.with_samples(change(trial.samples)), targets)


def _changed(changes: Mapping[tuple[str, int], Signal]) -> Build:
    return _on_samples(lambda own: own.replaced(changes))


def mapped(key: tuple[str, int], gain: float, offset: float = 0.0) -> Build:
    """Build a trial with a channel's values times ``gain``, and ``offset`` more."""
    return _on_samples(lambda own: own.replaced({key: own.signals[key].mapped(gain, offset)}))


def sensor(
    texts: tuple[str, str, str], number: int, quantity: str, gain: float, offset: float = 0.0, price: float = 1.0
) -> Hypothesis:
    """Suppose that a joint's position sensor is right only times a gain, with an offset (m or rad) more."""
    build = mapped((quantity, number), gain, offset)
    factor = offset if gain == 1.0 else gain
    return Hypothesis(*texts, (number,), build, (quantity,), factor=factor, price=price)


def misread(machine: Machine, number: int, quantity: str, price: float) -> Iterator[Hypothesis]:
    """List what a joint's position sensor may be misread as: the other way (a piston's zero is at the other end then),
    in another unit, or, at a ``price``, in another scale.
    """
    joint, piston = machine.joints[number], quantity == "piston_position"
    channel = machine.channel(quantity, joint.name)
    assert channel is not None
    about = joint.cylinder.stroke if piston and joint.cylinder is not None else 0.0
    yield sensor(worded("sign/piston" if piston else "sign/joint"), number, quantity, -1.0, about)
    for gain, unit in gains(machine, channel).items():
        yield sensor(worded("unit/like", says=unit), number, quantity, gain)
    for gain in COUNTS:
        times = Sentence(f"fitting.times_too_{'large' if gain < 1 else 'small'}", times=max(gain, 1 / gain))
        yield sensor(worded("scale/counts", times_too=times), number, quantity, gain, price=price)


def exchanged(
    machine: Machine, pairs: Pairs, first: int, second: int, build: Build,
    *, price: float = 1.1, recording: int | None = None, exact: bool = False,
) -> Hypothesis:  # fmt: skip
    """Suppose that channels of two joints are exchanged."""
    of = [[machine.channel(pair[k], machine.joints[n].name) for pair in pairs] for k, n in enumerate((first, second))]
    one, other = ([channel.name for channel in own if channel is not None] for own in of)
    key = "exchanged_channels" if recording is None else "exchanged_channels/alone"
    texts = worded(key, first=", ".join(one), second=", ".join(other))
    about, names = tuple({q for pair in pairs for q in pair}), (*one, *other)
    return Hypothesis(*texts, (first, second), build, about, price=price, recording=recording, exact=exact, names=names)


def late(delay: float) -> str:
    """Return ``late`` or ``early``."""
    return "late" if delay > 0 else "early"


def fast(rate: float) -> str:
    """Return ``fast`` or ``slow``."""
    return "fast" if rate > 0 else "slow"


def motions(trial: Trial, *, exchanges: bool = True) -> Iterator[Hypothesis]:
    """Try positions misread, their zeros off, and sensors exchanged between joints."""
    machine, samples = trial.machine, trial.samples
    for j, joint in enumerate(machine.joints):
        quantity = trial.positions[j]
        signal = samples.get(quantity, j)
        channel = machine.channel(quantity, joint.name)
        if signal is None or channel is None:
            continue
        piston = quantity == "piston_position"
        for own in misread(machine, j, quantity, 1.65):
            # A smaller position is tried only where the one as it is goes beyond what the joint can do.
            gain = own.factor or 1.0
            small = own.code == "unit" and abs(gain) <= 1 and _fits(trial, j, signal)
            fits = own.code == "sign" or (not small and _fits(trial, j, signal.mapped(gain)))
            if fits and (exchanges or own.code != "scale"):
                yield own
        for degrees in (90, -90, 180) if not piston and machine.si_unit(channel) == "rad" else ():
            yield sensor(worded("offset/joint", degrees=degrees), j, quantity, 1.0, float(np.deg2rad(degrees)), 1.4)
        for share in ZEROS if piston and joint.cylinder is not None else ():
            offset = share * joint.cylinder.stroke if joint.cylinder is not None else 0.0
            if _fits(trial, j, signal.mapped(1.0, offset)):
                way = "small" if offset > 0 else "large"
                yield sensor(worded("offset/piston", mm=1e3 * abs(offset), way=way), j, quantity, 1.0, offset, 1.6)
        for other in range(j + 1, len(machine.joints)) if exchanges else ():
            if samples.get(quantity, other) is not None and trial.positions[other] == quantity:
                yield exchanged(machine, [(quantity, quantity)], j, other, exchange(quantity, j, other))


def _fits(trial: Trial, number: int, signal: Signal) -> bool:
    """Return whether a position is within one and a half times the joint's range."""
    joint = trial.machine.joints[number]
    low, high = joint.limits.position
    if trial.positions[number] == "piston_position" and joint.cylinder is not None:
        low, high = 0.0, joint.cylinder.stroke
    slack = 0.5 * (high - low)
    return bool(np.percentile(signal.value, 1) > low - slack and np.percentile(signal.value, 99) < high + slack)


def exchange(quantity: str, j: int, other: int) -> Build:
    """Build a trial with the same channel of two joints exchanged."""
    a, b = (quantity, j), (quantity, other)
    return _on_samples(lambda own: own.replaced({a: own.signals[b], b: own.signals[a]}))


def times(trial: Trial) -> Iterator[Hypothesis]:
    """Try efforts that are late, all or one joint's; clocks that run apart; and another rate of the recorder."""
    efforts = trial.samples.efforts
    for delay in DELAYS:
        texts = worded(f"clock_offset/{late(delay)}", seconds=abs(delay))
        yield Hypothesis(*texts, (), delayed(efforts, delay), EFFORTS, factor=delay, price=1.2)
    for rate in RATES:
        texts = worded(f"clock_rate/{fast(rate)}", percent=1e2 * abs(rate))
        yield Hypothesis(*texts, (), stretched(efforts, rate), EFFORTS, factor=rate, price=1.3)
    for factor in TRUE_RATES:
        texts = worded("wrong_rate/motion", factor=factor)
        yield Hypothesis(*texts, (), _faster(factor), factor=factor, price=1.5)
    for j in range(len(trial.machine.joints)):
        own = tuple(key for key in efforts if key[1] == j)
        for delay in DELAYS if own and len(own) < len(efforts) else ():
            texts = worded(f"late_channels/{late(delay)}", seconds=abs(delay))
            yield Hypothesis(*texts, (j,), delayed(own, delay), EFFORTS, factor=delay, price=1.5)


def delayed(keys: Sequence[tuple[str, int]], delay: float) -> Build:
    """Build a trial with some channels taken ``delay`` s later."""
    return _on_samples(lambda own: own.moved(keys, delay))


def stretched(keys: Sequence[tuple[str, int]], rate: float) -> Build:
    """Build a trial with some channels taken later by ``rate`` s for each second of their recording."""
    return _on_samples(lambda own: own.moved(keys, rate * own.since))


def _faster(factor: float) -> Build:
    """Build a trial with all positions in a time that runs ``factor`` times as fast."""

    def change(samples: Samples) -> Samples:
        positions = {key: own for key, own in samples.signals.items() if key[0] not in EFFORTS}
        return samples.replaced({key: own.faster(factor) for key, own in positions.items()})

    return _on_samples(change)


def in_one_recording(trial: Trial, number: int) -> Iterator[Hypothesis]:
    """Try what may have been wrong in one recording: chambers swapped, channels of two joints exchanged, a position
    that counts the other way."""
    machine, samples = trial.machine, trial.samples
    rows = samples.recording == number

    def swapped(pairs: Sequence[tuple[tuple[str, int], tuple[str, int]]]) -> Build:
        both = [(a, b) for pair in pairs for a, b in (pair, pair[::-1])]
        return _changed({a: _where(rows, samples.signals[b], samples.signals[a]) for a, b in both})

    for j, joint in enumerate(machine.joints):
        if all(samples.get(quantity, j) is not None for quantity in PRESSURES):
            build = swapped([((PRESSURES[0], j), (PRESSURES[1], j))])
            yield Hypothesis(*worded("swapped_chambers/alone"), (j,), build, PRESSURES, recording=number, exact=True)
        quantity = trial.positions[j]
        signal = samples.get(quantity, j)
        if signal is not None:
            piston = quantity == "piston_position" and joint.cylinder is not None
            about = joint.cylinder.stroke if piston and joint.cylinder is not None else 0.0
            build = _changed({(quantity, j): _where(rows, signal.mapped(-1.0, about), signal)})
            yield Hypothesis(*worded("sign/alone"), (j,), build, (quantity,), recording=number, exact=True)
        for other in range(j):
            both = {q for q in (quantity, *EFFORTS) if samples.get(q, j) and samples.get(q, other)}
            kinds = ([quantity], EFFORTS)
            for pairs in (own for kind in kinds for own in _pairs([q for q in kind if q in both])):
                build = swapped([((q, other), (p, j)) for q, p in pairs])
                yield exchanged(machine, pairs, other, j, build, recording=number, exact=True)


def _where(rows: BoolArray, there: Signal, elsewhere: Signal) -> Signal:
    """Join two signals: ``there`` in some rows (T,), ``elsewhere`` in the others; noises are those of the latter."""
    return replace(
        elsewhere,
        value=np.where(rows, there.value, elsewhere.value),
        first=np.where(rows, there.first, elsewhere.first),
        second=np.where(rows, there.second, elsewhere.second),
    )


def recordings(trial: Trial) -> Iterator[Hypothesis]:
    """Try rods that are on or off against a recording's role, and a recording of another machine."""
    samples = trial.samples
    numbers = np.unique(samples.recording)
    rods = any(joint.cylinder is not None for joint in trial.machine.joints)
    for number in (int(k) for k in numbers):
        own = samples.recording == number
        loaded, others = bool(samples.loaded[own].all()), np.count_nonzero(samples.loaded & ~own) >= 100
        if rods and (others or not loaded):
            texts, least = worded("wrong_role/off" if loaded else "wrong_role/on"), CLEAR if loaded else _RODS_ON
            build = _changed_role(number, not loaded)
            yield Hypothesis(*texts, (), build, recording=number, price=1.2, exact=True, least=least)
        if len(numbers) > 2 and others:
            texts, build = worded("other_machine/unlike"), _left_out(number)
            yield Hypothesis(*texts, (), build, recording=number, price=1.6, least=_CLEARLY_ANOTHER)


def _changed_role(number: int, loaded: bool) -> Build:
    return _on_samples(lambda own: replace(own, loaded=np.where(own.recording == number, loaded, own.loaded)))


def _left_out(number: int) -> Build:
    return _on_samples(lambda own: replace(own, used=own.used & (own.recording != number)))
