"""One channel at a time: what sensors, cables and converters do to a signal, whatever it measures.

Every test compares a signal with itself: how often it repeats, how large its steps are, what is usual of it elsewhere
in the same recording. Nothing here knows the machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from daq.machine.machine_file import Channel, Joint, Machine
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import cut_off, piled_up, regular_steps, runs
from fitting.arrays import BoolArray, FloatArray
from fitting.checks.findings import Finding, finding_of
from fitting.signals.position_sensors import position_channel
from fitting.signals.preparation import parked, reach

POSITIONS = ("joint_position", "piston_position", "motor_position")
#: s that a value has to stay the same at least, and chance of such a run that is too small.
_FROZEN_S, _CHANCE = 0.3, 1e-9
#: A signal of fewer levels is coarse, but for the effort of a joint that stands for more than this share of the time.
_LEVELS, _STANDS = 16, 0.25
#: A position has to be resolved better: speeds and accelerations are differences of it.
_POSITION_LEVELS = 100
#: A position that changes by less than this share of its travel stands still: few values are then no fault.
_TRAVELS = 0.01
#: Share of a signal's usual range (1st to 99th percentile) that a spike or a jump has at least.
_SPIKE_POSITION, _SPIKE_EFFORT, _JUMP = 0.03, 0.25, 0.02
#: Times the local noise (a spike goes and comes, a jump only goes), and times the largest ordinary step.
_SPIKE_NOISE, _JUMP_NOISE, _STEPS, _EFFORT_STEPS = 10.0, 20.0, 6.0, 3.0
#: Changes that fall on every k-th row: their share (of so many at least, up to that k). A signal that changes at random
#: rows has a share of 1/k there.
_IN_STEP, _LEAST_CHANGES, _LONGEST_HOLD = 0.97, 30, 60
#: Share of the usual speed that a joint cannot lose, and gain again, within a row.
_AT_SPEED = 0.5
#: Held for so many rows, and slower than this, is more than a remark: motions of some hertz need ten values a period.
_HELD_ROWS, _SLOW_HZ = 4, 20.0


def signal_findings(machine: Machine, recording: Recording) -> list[Finding]:
    """Findings on each channel of a joint; ``recording`` in SI, NaN where nothing was measured."""
    found: list[Finding] = []
    joined = regular_steps(recording.time, recording.rate_hz) if len(recording) > 1 else np.zeros(0, bool)
    for channel in machine.channels:
        values = recording.values.get(channel.name)
        if channel.joint is None or values is None or np.count_nonzero(np.isfinite(values)) < 50:
            continue
        joint = machine.joint(channel.joint)
        travel = 0.0
        if channel.quantity in POSITIONS:
            travel = reach(joint, channel.quantity == "piston_position")
        own = next(
            _of_channel(
                channel,
                np.asarray(values),
                joined,
                recording,
                travel,
                _other(machine, recording, channel),
                parked=_parked(machine, joint, recording),
            ),
            None,
        )
        if own is not None:
            found.append(replace(own, joint=channel.joint, channel=channel.name, recording=recording.file))
    return found + _same_channels(machine, recording)


def _of_channel(
    channel: Channel,
    values: FloatArray,
    joined: BoolArray,
    recording: Recording,
    travel: float,
    other: FloatArray | None,
    parked: bool,
) -> Iterator[Finding]:
    """What is wrong with a channel, the most telling first.

    ``travel`` is the range of a position, 0 of an effort; ``other`` the joint's other position sensor; ``parked`` says
    that the joint stands for much of the recording.
    """
    time, rate = recording.time, recording.rate_hz
    known = np.isfinite(values)
    span = float(np.subtract(*np.percentile(values[known], [99, 1])))
    if span <= 0 or np.ptp(values[known]) <= 0:
        return
    steps = np.diff(values)
    steps = np.where(joined & np.isfinite(steps), steps, 0.0)
    changing = steps[steps != 0]
    if len(changing) == 0:
        return
    if travel or not parked:  # an effort that only holds has few levels
        yield from _coarse(channel, values[known], span, travel)
    yield from _dropouts(channel, values, steps, span, time)
    yield from _held(channel, steps, rate)
    yield from _clipped(channel, values[known])
    yield from _frozen(channel, values, steps, joined, time, rate, other)
    yield from _jumps(channel, values, steps, span, time)


def _parked(machine: Machine, joint: Joint, recording: Recording) -> bool:
    """Whether a joint stands for more than :data:`_STANDS` of a recording."""
    channel = position_channel(machine, joint)
    x = None if channel is None else recording.values.get(channel.name)
    if channel is None or x is None or not np.isfinite(x).any():
        return False
    own = reach(joint, channel.quantity == "piston_position")
    return float(np.mean(parked(x[np.isfinite(x)], own, recording.rate_hz))) > _STANDS


def _coarse(channel: Channel, values: FloatArray, span: float, travel: float) -> Iterator[Finding]:
    found = np.unique(values)
    levels = len(found)
    if channel.quantity in POSITIONS and levels > 1:
        # Of all steps between neighbouring levels the least is the resolution; a fast motion leaves levels out.
        levels = max(levels, round(float(span / np.diff(found).min())))
    if levels < (_POSITION_LEVELS if channel.quantity in POSITIONS else _LEVELS) and span > _TRAVELS * travel:
        yield finding_of("coarse", channel=channel.name, before=float(levels), strength=5.0)


def _held(channel: Channel, steps: FloatArray, rate: float) -> Iterator[Finding]:
    """A slower signal whose values were repeated: it changes in every k-th row and in no other."""
    places = np.flatnonzero(steps)
    if len(places) < _LEAST_CHANGES:
        return
    # Of two rows that follow each other one is out of step, and no row is in more than two such pairs.
    if np.count_nonzero(np.diff(places) == 1) > 2 * (1 - _IN_STEP) * len(places) + 1:
        return
    for every in range(_LONGEST_HOLD, 1, -1):
        if len(places) < 0.2 * len(steps) / every or np.bincount(places % every).max() < _IN_STEP * len(places):
            continue
        serious = every >= _HELD_ROWS and rate / every < _SLOW_HZ
        yield finding_of(
            "held",
            channel=channel.name,
            hz=rate / every,
            rate=rate,
            severity="mistake" if serious else "note",
            before=float(every),
            unit="rows",
            strength=4.0,
        )
        return


def _least_jump(channel: Channel, steps: FloatArray, span: float, noise: float = _JUMP_NOISE) -> float:
    """Size from which a step is a jump: far beyond the noise, the ordinary steps, and a share of the range."""
    position = channel.quantity in POSITIONS
    ordinary = max(float(np.percentile(np.abs(steps), 98)), 1e-300)
    local = 1.4826 * float(np.median(np.abs(np.diff(steps)))) / np.sqrt(6) + 1e-300
    share, times = (_JUMP, _STEPS) if position else (_SPIKE_EFFORT, _EFFORT_STEPS)
    return float(max(times * ordinary, noise * local, share * span))


def _dropouts(
    channel: Channel, values: FloatArray, steps: FloatArray, span: float, time: FloatArray
) -> Iterator[Finding]:
    """One and the same value again and again, reached and left by a jump: a loose cable, a failing supply."""
    least = _least_jump(channel, steps, span)
    entered = np.flatnonzero(np.abs(steps) > least) + 1
    for value in np.unique(values[entered]) if len(entered) < 0.05 * len(values) else ():
        there = [(run.start, run.stop) for run in runs(values == value) if run.stop - run.start > 1]
        jumps = [
            a for a, b in there
            if a > 0 and b < len(values) and abs(steps[a - 1]) > least and abs(steps[b - 1]) > least
        ]  # fmt: skip
        if len(jumps) < 2 or len(jumps) < 0.5 * len(there):
            continue
        yield finding_of(
            "dropouts", channel=channel.name, value=value, at=time[jumps[0]], before=float(len(jumps)), strength=5.5
        )
        return


def _jumps(channel: Channel, values: FloatArray, steps: FloatArray, span: float, time: FloatArray) -> Iterator[Finding]:
    """Single wrong values, wraps, and steps of a position's zero."""
    position = channel.quantity in POSITIONS
    size = np.abs(steps)
    least = _least_jump(channel, steps, span, _SPIKE_NOISE)
    large = np.flatnonzero(size > least)
    if len(large) == 0 or len(large) > 0.05 * len(size):
        return
    # A spike comes back at once: the next step undoes it.
    back = [k for k in large if k + 1 < len(steps) and abs(steps[k] + steps[k + 1]) < 0.2 * size[k]]
    after = {k + 1 for k in back}
    lasting = [k for k in large if k not in after and k not in back and size[k] > _least_jump(channel, steps, span)]
    spike_size = max((float(size[k]) for k in back), default=0.0)
    if back and spike_size > (_SPIKE_POSITION if position else _SPIKE_EFFORT) * span and (position or len(back) >= 3):
        yield finding_of(
            "outliers",
            channel=channel.name,
            at=time[back[0] + 1],
            share=spike_size / span,
            before=float(len(back)),
            unit="rows",
            strength=5.0,
        )
    if not position or not lasting:
        return
    sizes = size[lasting]
    signs = np.sign(steps[lasting])
    alike = float(np.ptp(sizes)) < 0.1 * float(np.median(sizes))
    turn = float(np.median(sizes))
    round_turn = channel.quantity != "piston_position" and min(abs(turn / t - 1) for t in (np.pi, 2 * np.pi)) < 0.05
    if alike and ((len(lasting) >= 2 and np.any(signs > 0) and np.any(signs < 0)) or round_turn):
        yield finding_of(
            "wrap",
            channel=channel.name,
            times=len(lasting),
            row=lasting[0] + 2,
            at=time[lasting[0] + 1],
            before=turn,
            strength=6.0,
        )
    else:
        yield finding_of(
            "jump", channel=channel.name, step=steps[lasting[0]], at=time[lasting[0]], before=turn, strength=5.0
        )


def _frozen(
    channel: Channel,
    values: FloatArray,
    steps: FloatArray,
    joined: BoolArray,
    time: FloatArray,
    rate: float,
    other: FloatArray | None,
) -> Iterator[Finding]:
    """The same value for longer than chance allows, while the signal comes back with a jump or is noisy elsewhere."""
    equal = joined & (steps == 0) & np.isfinite(values[1:]) & np.isfinite(values[:-1])
    stretches = runs(equal)
    lengths = np.array([run.stop - run.start for run in stretches], dtype=np.intp)
    for k in np.argsort(-lengths)[:5]:
        start, stop, length = stretches[k].start, stretches[k].stop, int(lengths[k])
        if length < max(8, _FROZEN_S * rate):
            return
        elsewhere = (np.count_nonzero(equal) - length) / max(len(equal) - length, 1)
        improbable = len(equal) * max(elsewhere, 1e-3) ** length < _CHANCE
        ordinary = float(np.percentile(np.abs(steps[steps != 0]), 75))
        ends = [abs(steps[i]) for i in (start - 1, stop) if 0 <= i < len(steps)]
        catches_up = max(ends, default=0.0) > 10 * ordinary
        if channel.quantity in POSITIONS:
            # A machine that stands has an encoder that stands; one that moves on comes back with a jump, or the joint's
            # other sensor has moved on, or the joint stops and starts at full speed from one row to the next.
            usual = float(np.median(np.abs(steps[steps != 0])))
            # It may wake where the joint happens to be again: the first step counts, or the second.
            beside = [np.abs(steps[max(start - 2, 0) : start]), np.abs(steps[stop : stop + 2])]
            abrupt = all(len(own) == 2 and own.max() > _AT_SPEED * usual for own in beside)
            wrong = improbable and (catches_up or abrupt or _moved(other, start, stop))
        else:
            # Coarse steps in a quiet phase repeat too, but none so long alone, and none that ends with a jump.
            second = int(np.sort(lengths)[-2]) if len(lengths) > 1 else 1
            wrong = improbable and elsewhere < 0.3 and (catches_up or (length >= rate and length > 4 * second))
        if wrong:
            yield finding_of(
                "frozen", channel=channel.name, at=time[start], before=length / rate, unit="s", strength=5.0
            )
            return


def _other(machine: Machine, recording: Recording, channel: Channel) -> FloatArray | None:
    """The joint's other position sensor where rods are on."""
    partner = {"joint_position": "piston_position", "piston_position": "joint_position"}.get(channel.quantity)
    found = machine.channel(partner, str(channel.joint)) if partner and recording.role != "unloaded" else None
    return None if found is None else recording.values.get(found.name)


def _moved(other: FloatArray | None, start: int, stop: int) -> bool:
    """Whether a position changes by a tenth of its range or more between two rows."""
    if other is None or not np.any(np.isfinite(other[start:stop])):
        return False
    return bool(
        np.ptp(other[start:stop][np.isfinite(other[start:stop])]) > 0.1 * np.nanmax(np.abs(other - np.nanmedian(other)))
    )


def _clipped(channel: Channel, values: FloatArray) -> Iterator[Finding]:
    """An effort that stops at one value: far more samples there than at any value near it."""
    if channel.quantity in POSITIONS:
        return
    if len(np.unique(values)) < 4 * _LEVELS:
        return
    for extreme, side in ((float(values.max()), "largest"), (float(values.min()), "smallest")):
        count = piled_up(values, extreme)
        # A fine sensor with little noise says one value wherever the signal rests.
        if count > max(0.01 * len(values), 10) and cut_off(values, extreme):
            yield finding_of(
                "clipped",
                channel=channel.name,
                rows=len(values),
                side=side,
                extreme=extreme,
                before=float(count),
                unit="rows",
                strength=4.0,
            )


def _same_channels(machine: Machine, recording: Recording) -> list[Finding]:
    """Two channels with the very same values."""
    seen: dict[bytes, Channel] = {}
    found = []
    for channel in machine.channels:
        values = recording.values.get(channel.name)
        if values is None or channel.joint is None:
            continue
        known = np.asarray(values)[np.isfinite(values)]
        if len(known) < 50 or np.ptp(known) == 0:
            continue
        key = np.ascontiguousarray(known).tobytes()
        first = seen.setdefault(key, channel)
        if first is not channel:
            found.append(
                finding_of(
                    "same_channel",
                    first=first.name,
                    joint=channel.joint,
                    channel=channel.name,
                    recording=recording.file,
                    strength=8.0,
                )
            )
    return found
