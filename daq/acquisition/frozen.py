"""Live detection of values that stand still although their sensor is alive, as one that hangs sends them.

Two signs, each learnt from the channel itself while acquisition runs; before enough is learnt nothing is said.

**Its own noise.** A measured value trembles. Where a block of a second holds enough changes, and a third of them turn
back, what is seen there is noise: successive differences of white noise turn back two times in three (of a random walk,
one in two), those of a motion that is sampled fast enough hardly ever. A channel that was seen so for
:data:`NOISY_BLOCKS` blocks trembles also at rest, and the longest run of equal values that it ever showed, ``L``, says
how rarely it repeats itself: with a chance ``p`` of one more repetition, the longest of ``N`` values is about
``L = ln N / ln(1/p)``, so a run of ``3 L`` has a chance of ``N^-3`` at any value, and of ``N^-2`` anywhere in as many
values as were seen: below one in 60 000 from the five seconds on that are asked for. A channel without noise (an
encoder at rest) is never judged so. What stands still on all devices at once is the machine (a pump that was switched
off), not a sensor.

**Another sensor of the same drive.** Joint and motor move together (a joint and its piston need not: a rod may be off
its pin, as in every ``unloaded`` recording). While one stands still, within its declared noise or resolution, the other
one moves no further than it did in such runs before, but for the play between them. Three times the longest way of at
least :data:`RUNS` such runs, and more than :data:`PLAY` of what the joint can do at all, is a sensor that hangs.
"""

from __future__ import annotations

import numpy as np

from daq.arrays import BoolArray, FlagArray, FloatArray
from daq.machine.machine_file import Channel, Machine
from daq.quality import Quality

NOISY_BLOCKS = 5  # of a second
CHANGES = 8  # in a block, of which a third turn back
FACTOR = 3
LEAST_RUN = 0.2  # s: a device may be busy with itself for so long
RUNS = 20
PLAY = 0.03  # of the range; play of that size is no longer an arm
POSITIONS = ("joint_position", "motor_position")


class FrozenDetector:
    """Looks at every frame; tells which channels stand still.

    Parameters
    ----------
    machine : its channels, in whose order values come
    """

    def __init__(self, machine: Machine) -> None:
        channels = machine.channels
        n = len(channels)
        self._block = max(CHANGES, round(machine.rate_hz))
        self._least = max(4, round(LEAST_RUN * machine.rate_hz))
        self._tolerance = np.array([_tolerance(machine, channel) for channel in channels])
        devices = [_device(channel) for channel in channels]
        self._device = np.array([devices.index(device) for device in devices])
        pairs = [
            (i, j, PLAY * _range(machine, other))
            for i, one in enumerate(channels)
            for j, other in enumerate(channels)
            if i != j and one.joint == other.joint and one.quantity in POSITIONS and other.quantity in POSITIONS
        ]
        self._one = np.array([i for i, _, _ in pairs], dtype=np.intp)
        self._other = np.array([j for _, j, _ in pairs], dtype=np.intp)
        self._play = np.array([play for _, _, play in pairs])  # that may be between them, in the other's SI unit
        self._last = np.full(n, np.nan)
        self._running = True  # whether some run may go on
        self._all, self._none = np.ones(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
        self._step = np.zeros(n)  # the last change that was one
        self._steps: list[FloatArray] = []  # since then; NaN where nothing fresh came
        self._run = np.zeros(n, dtype=np.int64)  # values equal to the one before, until now
        self._longest = np.zeros(n, dtype=np.int64)
        self._found = np.zeros(n, dtype=np.bool_)  # whether the run that goes on was called frozen
        self._noisy = np.zeros(n, dtype=np.int64)
        self._known = np.zeros(n, dtype=np.bool_)  # seen to tremble often enough to be judged by it
        self._some_known = False
        self._anchor = np.full(n, np.nan)  # where a channel stands, within its tolerance
        self._low, self._high = np.full(len(pairs), np.inf), np.full(len(pairs), -np.inf)
        self._way = np.zeros(len(pairs))  # longest way of the other one in a run that ended
        self._ended = np.zeros(len(pairs), dtype=np.int64)

    def frozen(self, values: FloatArray, quality: FlagArray) -> BoolArray:
        """Find channels whose value of this frame is frozen, (n,); only fresh ones are looked at."""
        fresh = quality == Quality.FRESH if quality.any() else self._all
        step = values - self._last
        changed = step != 0.0
        if fresh is not self._all:
            step[~fresh] = np.nan
            changed &= fresh
        self._steps.append(step)
        if self._running or np.count_nonzero(changed) != len(step):  # else no run goes on that could end
            # A run that was called frozen says nothing about what is normal: the next one has to be found as well.
            np.maximum(self._longest, self._run, out=self._longest, where=changed & ~self._found)
            self._found[changed] = False
            self._run += step == 0.0
            self._run[changed] = 0
            self._running = bool(self._run.any())
        self._last = values if fresh is self._all else np.where(fresh, values, self._last)
        if len(self._steps) >= self._block:
            self._learn()
        found = self._by_noise() if self._running and self._some_known else self._none
        if len(self._one):
            found = found | self._by_other(values, fresh)
        if found is not self._none:
            found &= fresh
            self._found |= found
        return found

    def _learn(self) -> None:
        """Learn once a block in which channels enough changes reverse the change before them."""
        steps = np.stack([self._step, *self._steps])
        self._steps.clear()
        rows = np.arange(len(steps))[:, None]
        change = np.abs(steps) > 0.0
        change[0] = True
        # The newest change at or before each row: a value that repeats itself is none.
        newest = np.take_along_axis(steps, np.maximum.accumulate(np.where(change, rows, 0), axis=0), axis=0)
        changes, turns = change[1:].sum(axis=0), (steps[1:] * newest[:-1] < 0.0).sum(axis=0)
        self._step = newest[-1]
        self._noisy += (changes >= CHANGES) & (3 * turns >= changes)
        self._known = self._noisy >= NOISY_BLOCKS
        self._some_known = bool(self._known.any())

    def _by_noise(self) -> BoolArray:
        noisy = self._known
        still: BoolArray = noisy & (self._run >= self._least)
        if not still.any():
            return still
        limit = np.maximum(self._least, FACTOR * (self._longest + 1))
        still &= self._run >= limit
        if not still.any():
            return still
        devices = set(self._device[noisy].tolist())
        # They reach their limits one after another, so half of the limit counts for the others.
        if len(devices) > 1 and devices == set(self._device[noisy & (2 * self._run >= limit)].tolist()):
            return np.zeros_like(still)
        return still

    def _by_other(self, values: FloatArray, fresh: BoolArray) -> BoolArray:
        found = np.zeros(len(values), dtype=np.bool_)
        moved = fresh & ~(np.abs(values - self._anchor) <= self._tolerance)
        self._anchor = np.where(moved, values, self._anchor)
        one, other = values[self._one], values[self._other]
        both = fresh[self._one] & fresh[self._other] & np.isfinite(one)
        self._low = np.where(both, np.minimum(self._low, other), self._low)
        self._high = np.where(both, np.maximum(self._high, other), self._high)
        way = self._high - self._low
        tolerance = self._tolerance[self._other]
        limit = np.maximum(FACTOR * self._way + 2 * tolerance, self._play)
        still = both & ~moved[self._one]
        found[self._one[still & (self._ended >= RUNS) & (way > limit)]] = True
        ends = both & ~still  # the run ends, and the next one begins here
        self._way = np.where(ends, np.maximum(self._way, way), self._way)
        self._ended += ends & (way > tolerance)
        self._low, self._high = np.where(ends, other, self._low), np.where(ends, other, self._high)
        return found


def _tolerance(machine: Machine, channel: Channel) -> float:
    """Compute how far a frozen channel may tremble, SI: four deviations of its noise, or a step."""
    declared = max(4.0 * (channel.noise_std or 0.0), channel.resolution or 0.0)
    return abs(machine.conversion(channel).factor) * declared


def _range(machine: Machine, channel: Channel) -> float:
    """Compute how far a position can move, SI."""
    assert channel.joint is not None
    joint = machine.joint(channel.joint)
    low, high = joint.limits.position
    ratio = abs(joint.drive.ratio) if channel.quantity == "motor_position" and joint.drive is not None else 1.0
    return ratio * (high - low)


def _device(channel: Channel) -> tuple[str, str]:
    source = channel.source
    return ("", channel.name) if source is None else (source.bus, source.device or channel.name)
