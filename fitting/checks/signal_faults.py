"""One channel at a time: what sensors, cables and converters do to a signal, whatever it measures.

Every test compares a signal with itself: how often it repeats, how large its steps are, what is usual of it elsewhere
in the same recording. Only fast noise of a position is compared with that of its kind and of its resolution as well:
it is no effect of the catalogue and bends nothing, but it drowns speeds and accelerations. What is compared is the
white part, by eighth differences: of a motion below a tenth of the rate they keep less than 2 %, so that a fast joint
does not pass for a noisy sensor. A sensor is accused by the median of its differences, and compared with the root mean
square of the others': single wrong values accuse nobody.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from daq.machine.machine_file import Channel, Joint, Machine
from daq.messages import Sentence
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import cut_off, piled_up, regular_steps, runs
from fitting.arrays import BoolArray, FloatArray
from fitting.checks.findings import Finding, Severity, finding_of
from fitting.checks.mistakes.samples import POSITIONS
from fitting.signals.position_sensors import held, position_channel
from fitting.signals.preparation import parked, reach

_ANY_POSITION = (*POSITIONS, "motor_position")
#: s that a value has to stay the same at least, and chance of such a run that is too small.
_FROZEN_S, _CHANCE = 0.3, 1e-9
#: A signal of fewer levels is coarse, but for the effort of a joint at rest for more than this share of the time.
_LEVELS, _AT_REST = 16, 0.25
#: A position has to be resolved better: speeds and accelerations are differences of it.
_POSITION_LEVELS = 100
#: A position that changes by less than this share of its travel is at rest: few values are then no fault.
_TRAVELS = 0.01
#: Share of a signal's usual range (1st to 99th percentile) that a spike or a jump has at least.
_SPIKE_POSITION, _SPIKE_EFFORT, _JUMP = 0.03, 0.25, 0.02
#: Times the local noise (a spike goes and comes, a jump only goes), and times the largest ordinary step.
_SPIKE_NOISE, _JUMP_NOISE, _STEPS, _EFFORT_STEPS = 10.0, 20.0, 6.0, 3.0
#: Changes that fall on every k-th row: their share (of so many at least, up to that k). A signal that changes at random
#: rows has a share of 1/k there.
_IN_STEP, _LEAST_CHANGES, _LONGEST_HOLD = 0.97, 30, 60
#: A step is undone by one that leaves less than this share of it.
_UNDONE = 0.2
#: Share of the usual speed that a joint cannot lose, and gain again, within a row.
_AT_SPEED = 0.5
#: Held for so many rows, and slower than this, is more than a remark: motions of some hertz need ten values a period.
_HELD_ROWS, _SLOW_HZ = 4, 20.0
#: Noise over what it is compared with, and over the joint's reach, from which a sensor is accused.
_TIMES, _OF_REACH = 10.0, 2e-4
#: Order of the differences, and their spread over that of white noise (root of the sum of squared binomials).
_ORDER, _GAIN = 8, float(np.sqrt(12870.0))
_MEDIAN = 0.6745
#: Stretches of so many s, as many as this at least, and the share of them that has to be noisy, or quiet, together.
_STRETCH_S, _STRETCHES, _SHARE = 2.0, 5, 0.1


@dataclass(frozen=True)
class _Signal:
    """One channel of a recording, SI.

    Attributes
    ----------
    values, time : (N,) NaN where nothing was measured
    joined : (N - 1,) which rows follow each other
    travel : range of a position, 0 of an effort
    other : (N,) the joint's other position sensor where rods are on
    parked : whether the joint is at rest for much of the recording
    """

    channel: Channel
    recording: Recording
    values: FloatArray
    joined: BoolArray
    travel: float
    other: FloatArray | None
    parked: bool

    @property
    def position(self) -> bool:
        """True for a position, False for an effort."""
        return self.channel.quantity in _ANY_POSITION

    @property
    def time(self) -> FloatArray:
        """(N,) s."""
        return self.recording.time

    @cached_property
    def known(self) -> FloatArray:
        """Its measured values."""
        return self.values[np.isfinite(self.values)]

    @cached_property
    def span(self) -> float:
        """Its usual range, 1st to 99th percentile."""
        return float(np.subtract(*np.percentile(self.known, [99, 1])))

    @cached_property
    def steps(self) -> FloatArray:
        """(N - 1,) from row to row, 0 where one of both is not known."""
        steps = np.diff(self.values)
        return np.where(self.joined & np.isfinite(steps), steps, 0.0)

    @cached_property
    def back(self) -> BoolArray:
        """(N - 1,) which steps are undone by the next one: a value that comes and goes."""
        undone = np.zeros(len(self.steps), dtype=bool)
        undone[:-1] = np.abs(self.steps[:-1] + self.steps[1:]) < _UNDONE * np.abs(self.steps[:-1])
        return undone

    @property
    def who(self) -> dict[str, Any]:
        """Whose findings on it are."""
        return {"channel": self.channel.name, "joint": self.channel.joint, "recording": self.recording.file}


def signal_findings(machine: Machine, recording: Recording) -> list[Finding]:
    """Report the most significant fault of each channel of a joint; ``recording`` in SI, NaN where nothing is."""
    found: list[Finding] = []
    joined = regular_steps(recording.time, recording.rate_hz) if len(recording) > 1 else np.zeros(0, bool)
    for channel in machine.channels:
        values = recording.values.get(channel.name)
        if channel.joint is None or values is None or np.count_nonzero(np.isfinite(values)) < 50:
            continue
        joint = machine.joint(channel.joint)
        travel = reach(joint, channel.quantity == "piston_position") if channel.quantity in _ANY_POSITION else 0.0
        other, parked = _other(machine, recording, channel), _parked(machine, joint, recording)
        signal = _Signal(channel, recording, np.asarray(values), joined, travel, other, parked)
        if signal.span > 0 and np.ptp(signal.known) > 0 and signal.steps.any():
            checks = (_coarse, _dropouts, _held, _clipped, _frozen, _jumps)
            found += [own for check in checks if (own := check(signal)) is not None][:1]
    return found + _same_channels(machine, recording)


def track(machine: Machine, joint: Joint, recording: Recording) -> tuple[FloatArray, float] | None:
    """Return a joint's measured positions (k,) and its reach, m or rad; None where nothing was measured."""
    channel = position_channel(machine, joint)
    values = None if channel is None else recording.values.get(channel.name)
    if channel is None or values is None or not np.isfinite(values).any():
        return None
    return values[np.isfinite(values)], reach(joint, channel.quantity == "piston_position")


def _parked(machine: Machine, joint: Joint, recording: Recording) -> bool:
    """Return whether a joint is at rest for more than :data:`_AT_REST` of a recording."""
    own = track(machine, joint, recording)
    return own is not None and float(np.mean(parked(*own, recording.rate_hz))) > _AT_REST


def _coarse(own: _Signal) -> Finding | None:
    if own.parked and not own.travel:
        return None  # an effort that only holds has few levels
    found = np.unique(own.known)
    levels = len(found)
    if own.position and levels > 1:
        # Of all steps between neighbouring levels the least is the resolution; a fast motion leaves levels out.
        levels = max(levels, round(float(own.span / np.diff(found).min())))
    if levels < (_POSITION_LEVELS if own.position else _LEVELS) and own.span > _TRAVELS * own.travel:
        return finding_of("coarse", before=float(levels), strength=5.0, **own.who)
    return None


def _held(own: _Signal) -> Finding | None:
    """Report a slower signal whose values were repeated: it changes in every k-th row only."""
    places, rate = np.flatnonzero(own.steps), own.recording.rate_hz
    # Of two rows that follow each other one is out of step, and no row is in more than two such pairs.
    most = 2 * (1 - _IN_STEP) * len(places) + 1
    if len(places) < _LEAST_CHANGES or np.count_nonzero(np.diff(places) == 1) > most:
        return None
    for every in range(_LONGEST_HOLD, 1, -1):
        if len(places) < 0.2 * len(own.steps) / every or np.bincount(places % every).max() < _IN_STEP * len(places):
            continue
        severity: Severity = "mistake" if every >= _HELD_ROWS and rate / every < _SLOW_HZ else "note"
        details: dict[str, Any] = {"hz": rate / every, "rate": rate, "before": float(every), "unit": "rows"}
        return finding_of("held", severity=severity, strength=4.0, **details, **own.who)
    return None


def _least_jump(own: _Signal, noise: float = _JUMP_NOISE) -> float:
    """Compute the size from which a step is a jump: far beyond noise, ordinary steps, and a share of the range.

    Ordinary are all but the largest of those that last, as spikes do not, and all steps but as many as may be spikes;
    a joint at rest has its encoder's least step.
    """
    sizes, lasting = np.abs(own.steps), ~own.back
    lasting[1:] &= ~own.back[:-1]
    all_but = (np.percentile(some, share) for some, share in ((sizes[lasting], 98), (sizes, 95)) if len(some))
    ordinary = float(max(*all_but, sizes[sizes > 0].min()))
    local = 1.4826 * float(np.median(np.abs(np.diff(own.steps)))) / np.sqrt(6) + 1e-300
    share, times = (_JUMP, _STEPS) if own.position else (_SPIKE_EFFORT, _EFFORT_STEPS)
    return float(max(times * ordinary, noise * local, share * own.span))


def _dropouts(own: _Signal) -> Finding | None:
    """Report one same value again and again, reached and left by a jump: a loose cable, a failing supply."""
    values, steps, least = own.values, own.steps, _least_jump(own)
    entered = np.flatnonzero(np.abs(steps) > least) + 1
    for value in np.unique(values[entered]) if len(entered) < 0.05 * len(values) else ():
        there = [(run.start, run.stop) for run in runs(values == value) if run.stop - run.start > 1]
        jumps = [
            a for a, b in there
            if a > 0 and b < len(values) and abs(steps[a - 1]) > least and abs(steps[b - 1]) > least
        ]  # fmt: skip
        if len(jumps) >= 2 and len(jumps) >= 0.5 * len(there):
            return finding_of(
                "dropouts", value=value, at=own.time[jumps[0]], before=float(len(jumps)), strength=5.5, **own.who
            )
    return None


def _jumps(own: _Signal) -> Finding | None:
    """Report single wrong values, wraps, and steps of a position's zero."""
    steps, size, time = own.steps, np.abs(own.steps), own.time
    large = np.flatnonzero(size > _least_jump(own, _SPIKE_NOISE))
    if len(large) == 0 or len(large) > 0.05 * len(size):
        return None
    # A spike comes back at once: the next step undoes it.
    back = large[own.back[large]]
    gone, least = {*back, *(back + 1)}, _least_jump(own)
    lasting = [k for k in large if k not in gone and size[k] > least]
    spike = float(size[back].max(initial=0.0)) / own.span
    if len(back) and spike > (_SPIKE_POSITION if own.position else _SPIKE_EFFORT) and (own.position or len(back) >= 3):
        details: dict[str, Any] = {"at": time[back[0] + 1], "share": spike, "before": float(len(back)), "unit": "rows"}
        return finding_of("outliers", strength=5.0, **details, **own.who)
    if not own.position or not lasting:
        return None
    sizes, ways, first = size[lasting], np.sign(steps[lasting]), lasting[0]
    turn = float(np.median(sizes))
    of_turns = min(abs(turn / t - 1) for t in (np.pi, 2 * np.pi)) < 0.05
    round_turn = own.channel.quantity != "piston_position" and of_turns
    if np.ptp(sizes) < 0.1 * turn and (np.ptp(ways) > 0 or round_turn):
        details = {"times": len(lasting), "row": first + 2, "at": time[first + 1]}
        return finding_of("wrap", before=turn, strength=6.0, **details, **own.who)
    return finding_of("jump", step=steps[first], at=time[first], before=turn, strength=5.0, **own.who)


def _frozen(own: _Signal) -> Finding | None:
    """Report a value constant for longer than chance allows, on a signal that returns with a jump or has noise."""
    values, steps, rate = own.values, own.steps, own.recording.rate_hz
    equal = own.joined & (steps == 0) & np.isfinite(values[1:]) & np.isfinite(values[:-1])
    stretches = runs(equal)
    lengths = np.array([run.stop - run.start for run in stretches], dtype=np.intp)
    usual, ordinary = (float(p) for p in np.percentile(np.abs(steps[steps != 0]), [50, 75]))
    for k in np.argsort(-lengths)[:5]:
        start, stop, length = stretches[k].start, stretches[k].stop, int(lengths[k])
        if length < max(8, _FROZEN_S * rate):
            return None
        elsewhere = (np.count_nonzero(equal) - length) / max(len(equal) - length, 1)
        improbable = len(equal) * max(elsewhere, 1e-3) ** length < _CHANCE
        ends = [abs(steps[i]) for i in (start - 1, stop) if 0 <= i < len(steps)]
        catches_up = max(ends, default=0.0) > 10 * ordinary
        if own.position:
            # A machine at rest has an encoder at rest; one that moves on comes back with a jump, or the joint's
            # other sensor has moved on, or the joint stops and starts at full speed from one row to the next.
            # It may wake where the joint happens to be again: the first step counts, or the second.
            beside = [np.abs(steps[max(start - 2, 0) : start]), np.abs(steps[stop : stop + 2])]
            abrupt = all(len(part) == 2 and part.max() > _AT_SPEED * usual for part in beside)
            wrong = improbable and (catches_up or abrupt or _moved(own.other, start, stop))
        else:
            # Coarse steps of a joint at rest repeat too, but none so long alone, and none that ends with a jump.
            second = int(np.sort(lengths)[-2]) if len(lengths) > 1 else 1
            alone, fine = length >= rate and length > 4 * second, elsewhere < 0.3
            wrong = improbable and ((fine and catches_up) or (alone and (fine or not own.parked)))
        if wrong:
            return finding_of("frozen", at=own.time[start], before=length / rate, unit="s", strength=5.0, **own.who)
    return None


def _other(machine: Machine, recording: Recording, channel: Channel) -> FloatArray | None:
    """Return the joint's other position sensor where rods are on."""
    partner = {"joint_position": "piston_position", "piston_position": "joint_position"}.get(channel.quantity)
    found = machine.channel(partner, str(channel.joint)) if partner and recording.role != "unloaded" else None
    return None if found is None else recording.values.get(found.name)


def _moved(other: FloatArray | None, start: int, stop: int) -> bool:
    """Return whether a position changes by a tenth of its range or more between two rows."""
    part = np.zeros(0) if other is None else other[start:stop][np.isfinite(other[start:stop])]
    return other is not None and bool(len(part)) and np.ptp(part) > 0.1 * np.nanmax(np.abs(other - np.nanmedian(other)))


def _clipped(own: _Signal) -> Finding | None:
    """Report an effort that stops at one value: far more samples there than at any value near it."""
    values = own.known
    if own.position or len(np.unique(values)) < 4 * _LEVELS:
        return None
    for extreme, side in ((float(values.max()), "largest"), (float(values.min()), "smallest")):
        count = piled_up(values, extreme)
        # A fine sensor with little noise has one value wherever the signal rests.
        if count > max(0.01 * len(values), 10) and cut_off(values, extreme):
            details: dict[str, Any] = {"rows": len(values), "side": side, "extreme": extreme, "unit": "rows"}
            return finding_of("clipped", before=float(count), strength=4.0, **details, **own.who)
    return None


def _same_channels(machine: Machine, recording: Recording) -> list[Finding]:
    """Report two channels with the very same values."""
    seen: dict[bytes, Channel] = {}
    found = []
    for channel in machine.channels:
        values = recording.values.get(channel.name)
        if values is None or channel.joint is None:
            continue
        known = np.asarray(values)[np.isfinite(values)]
        if len(known) < 50 or np.ptp(known) == 0:
            continue
        first = seen.setdefault(known.tobytes(), channel)
        if first is not channel:
            who: dict[str, Any] = {"joint": channel.joint, "channel": channel.name, "recording": recording.file}
            found.append(finding_of("same_channel", first=first.name, strength=8.0, **who))
    return found


def noise_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Find position sensors ten times noisier than they have to be; ``recordings`` in SI."""
    found = []
    stretches = {c.name: _stretches(c, recordings) for c in machine.channels if c.quantity in POSITIONS}
    moving = {name: own for name, own in stretches.items() if len(own)}
    for channel in machine.channels:
        if channel.name not in moving:
            continue
        joint = machine.joint(str(channel.joint))
        least = _OF_REACH * reach(joint, channel.quantity == "piston_position")
        noise = float(np.median(moving[channel.name][:, 0]))
        sisters = [
            float(np.median(moving[c.name][:, 1]))
            for c in machine.channels
            if c.quantity == channel.quantity and c is not channel and c.name in moving
        ]
        conversion = machine.conversion(channel)
        own_step = abs(conversion.factor) * (channel.resolution or 0.0)
        excess: tuple[float, float, str] | None = None
        if noise > least and sisters and noise > _TIMES * (usual := float(np.median(sisters))) > 0:
            excess = (noise, usual, Sentence("fitting.other_sensors_kind"))
        elif noise > least and own_step and noise > _TIMES * own_step:
            excess = (noise, own_step, "its resolution")
        elif (apart := _apart(moving[channel.name], least)) is not None:
            excess = (*apart, Sentence("fitting.other_stretches"))
        if excess is not None:
            before, after, what = excess
            who: dict[str, Any] = {"joint": channel.joint, "channel": channel.name, "unit": machine.si_unit(channel)}
            times = before / after
            found.append(finding_of("noisy", times=times, what=what, before=before, after=after, strength=3.0, **who))
    return found


def _stretches(channel: Channel, recordings: Sequence[Recording]) -> FloatArray:
    """Compute a channel's noise (k, 2) where it moves, by stretch: by the median of its differences, and by all."""
    result = []
    for recording in recordings:
        values = recording.values.get(channel.name)
        if values is None:
            continue
        rows = round(_STRETCH_S * recording.rate_hz)
        there = np.isfinite(values) & ~held(values, recording.rate_hz)
        for run in runs(there, recording.joined):
            for start in range(run.start, run.stop - rows + 1, rows):
                differences = np.diff(values[start : start + rows], _ORDER)
                if len(differences):
                    size = np.abs(differences)
                    result.append((float(np.median(size)) / _MEDIAN, float(np.sqrt(np.mean(size**2)))))
    return np.array(result).reshape(-1, 2) / _GAIN


def _apart(noise: FloatArray, least: float) -> tuple[float, float] | None:
    """Return the noise of the noisy and of the quiet stretches, where there are enough of both."""
    count = max(2, round(_SHARE * len(noise)))
    if len(noise) < _STRETCHES:
        return None
    loud, quiet = float(np.sort(noise[:, 0])[-count]), float(np.sort(noise[:, 1])[count - 1])
    return (loud, quiet) if loud > least and loud > _TIMES * quiet > 0 else None
