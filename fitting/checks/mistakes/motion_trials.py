"""Trials of positions and clocks: signs, units, offsets, exchanged sensors, roles of recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from daq.machine.machine_file import Machine
from daq.messages import Sentence
from fitting.arrays import BoolArray
from fitting.checks.findings import worded
from fitting.checks.mistakes.factors import gains
from fitting.checks.mistakes.hypothesis import CLEAR, Build, Hypothesis
from fitting.checks.mistakes.physical import Trial
from fitting.checks.mistakes.samples import EFFORTS, PRESSURES, Samples, Signal


def on_samples(change: Callable[[Samples], Samples]) -> Build:
    """Build a trial with other samples."""
    return lambda trial, targets: (trial.with_samples(change(trial.samples)), targets)


def mapped(key: tuple[str, int], gain: float, offset: float = 0.0) -> Build:
    """Build a trial with a channel's values times ``gain``, and ``offset`` more."""
    return on_samples(lambda own: own.replaced({key: own.signals[key].mapped(gain, offset)}))


#: Factors by which an encoder's counts are mistaken: edges of both tracks, one of two, diameters for radii.
COUNTS = (0.25, 0.5, 2.0, 4.0)
#: Shares of a stroke by which the zero of a piston's sensor is off.
ZEROS = (-0.5, -0.33, -0.2, 0.2, 0.33, 0.5)


def misread(machine: Machine, number: int, quantity: str) -> Iterator[tuple[tuple[str, str, str], float, float]]:
    """List what a joint's position sensor may be misread as: words, and the gain and offset that correct it.

    It counts the other way (a piston's zero is at the other end then), has another unit, or another scale.
    """
    joint, piston = machine.joints[number], quantity == "piston_position"
    channel = machine.channel(quantity, joint.name)
    assert channel is not None
    about = joint.cylinder.stroke if piston and joint.cylinder is not None else 0.0
    yield worded("sign/piston" if piston else "sign/joint"), -1.0, about
    for gain, unit in gains(machine.si_unit(channel), machine.conversion(channel).factor).items():
        yield worded("unit/like", says=unit), gain, 0.0
    for gain in COUNTS:
        times = Sentence(f"fitting.times_too_{'large' if gain < 1 else 'small'}", times=max(gain, 1 / gain))
        yield worded("scale/counts", times_too=times), gain, 0.0


def exchanged(machine: Machine, quantity: str, first: int, second: int) -> tuple[str, str, str]:
    """Word the finding on two joints' channels that look exchanged."""
    one, other = (machine.joints[number].name for number in (first, second))
    return worded("exchanged_channels", what=quantity.replace("_", " "), first=one, second=other)


def late(delay: float) -> str:
    """Return ``late`` or ``early``."""
    return "late" if delay > 0 else "early"


def fast(rate: float) -> str:
    """Return ``fast`` or ``slow``."""
    return "fast" if rate > 0 else "slow"


def motions(trial: Trial, *, exchanges: bool = True) -> Iterator[Hypothesis]:
    machine, samples = trial.machine, trial.samples
    for j, joint in enumerate(machine.joints):
        quantity = trial.positions[j]
        signal = samples.get(quantity, j)
        channel = machine.channel(quantity, joint.name)
        if signal is None or channel is None:
            continue
        piston = quantity == "piston_position"
        for texts, gain, offset in misread(machine, j, quantity):
            # A smaller position is tried only where the one as it is goes beyond what the joint can do.
            small = texts[0] == "unit" and abs(gain) <= 1 and _fits(trial, j, signal)
            fits = texts[0] == "sign" or (not small and _fits(trial, j, signal.mapped(gain)))
            if fits and (exchanges or texts[0] != "scale"):
                price = 1.65 if texts[0] == "scale" else 1.0
                build = mapped((quantity, j), gain, offset)
                yield Hypothesis(*texts, (j,), build, (quantity,), factor=gain, price=price)
        if not piston and machine.si_unit(channel) == "rad":
            for degrees in (90, -90, 180):
                offset = float(np.deg2rad(degrees))
                yield Hypothesis(
                    *worded("offset/joint", degrees=degrees), (j,), mapped((quantity, j), 1.0, offset), (quantity,),
                    factor=offset, price=1.4,
                )  # fmt: skip
        if piston and joint.cylinder is not None:
            for share in ZEROS:
                offset = share * joint.cylinder.stroke
                if _fits(trial, j, signal.mapped(1.0, offset)):
                    way = "small" if offset > 0 else "large"
                    yield Hypothesis(
                        *worded("offset/piston", mm=1e3 * abs(offset), way=way), (j,),
                        mapped((quantity, j), 1.0, offset), (quantity,),
                        factor=offset, price=1.6,
                    )  # fmt: skip
        for other in range(j + 1, len(machine.joints)) if exchanges else ():
            if samples.get(quantity, other) is not None and trial.positions[other] == quantity:
                yield Hypothesis(
                    *exchanged(machine, quantity, j, other), (j, other),
                    exchange(quantity, j, other), (quantity,), price=1.1,
                )  # fmt: skip


def _fits(trial: Trial, number: int, signal: Signal) -> bool:
    """Return whether a position is within one and a half times the joint's range."""
    joint = trial.machine.joints[number]
    low, high = joint.limits.position
    if trial.positions[number] == "piston_position" and joint.cylinder is not None:
        low, high = 0.0, joint.cylinder.stroke
    slack = 0.5 * (high - low)
    return bool(np.percentile(signal.value, 1) > low - slack and np.percentile(signal.value, 99) < high + slack)


def exchange(quantity: str, j: int, other: int) -> Build:
    a, b = (quantity, j), (quantity, other)
    return on_samples(lambda own: own.replaced({a: own.signals[b], b: own.signals[a]}))


#: Delays that are tried, s: beyond the tens of milliseconds of a late sensor.
DELAYS = (-2.0, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 2.0)
#: Clocks that run fast or slow against one another.
RATES = (-0.02, -0.01, -0.005, -0.002, 0.002, 0.005, 0.01, 0.02)


def times(trial: Trial) -> Iterator[Hypothesis]:
    efforts = tuple(key for key in trial.samples.dense if key[0] in EFFORTS)
    for delay in DELAYS:
        yield Hypothesis(
            *worded(f"clock_offset/{late(delay)}", seconds=abs(delay)), (),
            delayed(efforts, delay), EFFORTS, factor=delay, price=1.2,
        )  # fmt: skip
    for rate in RATES:
        yield Hypothesis(
            *worded(f"clock_rate/{fast(rate)}", percent=1e2 * abs(rate)), (),
            stretched(efforts, rate), EFFORTS, factor=rate, price=1.3,
        )  # fmt: skip
    for factor in TRUE_RATES:
        yield Hypothesis(
            *worded("wrong_rate/motion", factor=factor), (), _faster(factor), factor=factor, price=1.5,
        )  # fmt: skip
    for j in range(len(trial.machine.joints)):
        own = tuple(key for key in efforts if key[1] == j)
        if own and len(own) < len(efforts):
            for delay in DELAYS:
                yield Hypothesis(
                    *worded(f"late_channels/{late(delay)}", seconds=abs(delay)), (j,),
                    delayed(own, delay), EFFORTS, factor=delay, price=1.5,
                )  # fmt: skip


def delayed(keys: Sequence[tuple[str, int]], delay: float) -> Build:
    """Build a trial with some channels taken ``delay`` s later."""
    return on_samples(lambda own: own.moved(keys, delay))


#: Rates that a recorder may have run at instead, over the one that its time column says; 20: milliseconds at 50 Hz.
TRUE_RATES = (0.05, 0.1, 0.2, 0.5, 2.0, 5.0, 10.0, 20.0)


def _faster(factor: float) -> Build:
    def change(samples: Samples) -> Samples:
        positions = {key: own for key, own in samples.signals.items() if key[0] not in EFFORTS}
        return samples.replaced({key: own.faster(factor) for key, own in positions.items()})

    return on_samples(change)


def stretched(keys: Sequence[tuple[str, int]], rate: float) -> Build:
    return on_samples(lambda own: own.moved(keys, rate * own.since))


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
            yield Hypothesis(
                *worded("swapped_chambers/alone"), (j,),
                swapped([((PRESSURES[0], j), (PRESSURES[1], j))]), PRESSURES, recording=number, exact=True,
            )  # fmt: skip
        quantity = trial.positions[j]
        signal = samples.get(quantity, j)
        if signal is not None:
            piston = quantity == "piston_position" and joint.cylinder is not None
            about = joint.cylinder.stroke if piston and joint.cylinder is not None else 0.0
            yield Hypothesis(
                *worded("sign/alone"), (j,),
                _changed({(quantity, j): _where(rows, signal.mapped(-1.0, about), signal)}), (quantity,),
                recording=number, exact=True,
            )  # fmt: skip
        for other in range(j):
            there = [q for q in (quantity, *EFFORTS) if samples.get(q, j) and samples.get(q, other)]
            sets = [(q,) for q in there] + [PRESSURES] * (set(PRESSURES) <= set(there))
            for chosen in sets:
                what = " and ".join(q.replace("_", " ") for q in chosen)
                names = machine.joints[other].name, joint.name
                yield Hypothesis(
                    *worded("exchanged_channels/alone", what=what, first=names[0], second=names[1]), (other, j),
                    swapped([((q, j), (q, other)) for q in chosen]), chosen, price=1.1, recording=number, exact=True,
                )  # fmt: skip


def _where(rows: BoolArray, there: Signal, elsewhere: Signal) -> Signal:
    return replace(
        elsewhere,
        value=np.where(rows, there.value, elsewhere.value),
        first=np.where(rows, there.first, elsewhere.first),
        second=np.where(rows, there.second, elsewhere.second),
    )


def _changed(changes: Mapping[tuple[str, int], Signal]) -> Build:
    return on_samples(lambda own: own.replaced(changes))


#: An arm on the rods never explains less where there is one; noise of a small arm leaves this much of the difference.
_RODS_ON = 1.4
#: Leaving a recording out is a trial that a payload or another oil also passes a little: it has to do more than others.
_CLEARLY_ANOTHER = 3.5


def recordings(trial: Trial) -> Iterator[Hypothesis]:
    samples = trial.samples
    numbers = np.unique(samples.recording)
    rods = any(joint.cylinder is not None for joint in trial.machine.joints)
    for number in (int(k) for k in numbers):
        own = samples.recording == number
        loaded = bool(samples.loaded[own].all())
        if rods and (np.count_nonzero(samples.loaded & ~own) >= 100 or not loaded):
            yield Hypothesis(
                *worded("wrong_role/off" if loaded else "wrong_role/on"), (),
                _changed_role(number, not loaded), recording=number, price=1.2, exact=True,
                least=CLEAR if loaded else _RODS_ON,
            )  # fmt: skip
        if len(numbers) > 2 and np.count_nonzero(samples.loaded & ~own) >= 100:
            yield Hypothesis(
                *worded("other_machine/unlike"), (), _left_out(number), recording=number,
                price=1.6, least=_CLEARLY_ANOTHER,
            )  # fmt: skip


def _changed_role(number: int, loaded: bool) -> Build:
    return on_samples(lambda own: replace(own, loaded=np.where(own.recording == number, loaded, own.loaded)))


def _left_out(number: int) -> Build:
    return on_samples(lambda own: replace(own, used=own.used & (own.recording != number)))
