"""From what drivers bring in a cycle to a frame: scaling, range, quality, and holding what is a little old."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq.acquisition.frozen import FrozenDetector
from daq.arrays import BoolArray, FlagArray, FloatArray, IntArray
from daq.drivers.base import Samples
from daq.frames.channels import ChannelTable
from daq.frames.clock import NS, Tick
from daq.frames.frame import Frame
from daq.quality import Quality

#: After a tick's own moment, in periods, from which on what is sampled then is not of this cycle; and what sampling may
#: be uncertain by.
LATE, UNCERTAIN_NS = 0.1, 1_000_000
HOLD_CYCLES = 5  # for so long the last value is shown as stale; then the channel is missing
#: Whether a driver that gives this quality says that it has a number.
_NUMBERS = np.array([quality in (Quality.FRESH, Quality.LATE, Quality.OUT_OF_RANGE) for quality in Quality])


class Assembler:
    """Puts frames together, one per cycle, in the channel table's order.

    Parameters
    ----------
    table : the channels
    drivers : for each driver, in the order in which their samples will come, the names of its channels
    rate_hz : cycles per second of machine time
    lockstep : machine time stands still between SYNCs, so that what is sampled after SYNC is not older or younger
    frozen : tells which fresh values stand still; None: nobody does
    """

    def __init__(
        self,
        table: ChannelTable,
        drivers: Sequence[Sequence[str]],
        rate_hz: float,
        *,
        lockstep: bool = False,
        frozen: FrozenDetector | None = None,
    ) -> None:
        count = len(table.names)
        self._table = table
        self._order = [np.array([table.index(name) for name in names], dtype=np.intp) for names in drivers]
        self._period = 1.0 / rate_hz
        self._lockstep = lockstep
        self._frozen = frozen
        self._bounded = bool(np.isfinite(table.low).any() or np.isfinite(table.high).any())
        self._covered = sum(len(names) for names in drivers) == count  # else some channel comes from nobody
        self._in_order = len(drivers) == 1 and tuple(drivers[0]) == table.names
        self._all = np.arange(count)
        self._unknown = np.full(count, np.nan)
        self._last = np.full(count, np.nan)
        self._last_age = np.full(count, np.nan)  # at the cycle in which it came
        self._last_cycle = np.zeros(count, dtype=np.int64)
        self._newest: tuple[FloatArray, int, float] | None = None  # values, cycle, age, if it was plain
        self._counts = np.zeros((len(Quality), count), dtype=np.int64)
        self._plain_frames = 0  # that are not in there yet
        # Of plain frames, which share them:
        self._fresh, self._no_age = np.zeros(count, dtype=np.uint8), np.zeros(count)
        self._fresh.flags.writeable = self._no_age.flags.writeable = False

    def frame(
        self, tick: Tick, sync_ns: int, utc_ns: int, samples: Sequence[Samples], sent_ns: int | None = None
    ) -> Frame:
        """Assemble the frame of this tick; ``samples`` of every driver, in the order given at the start.

        ``sync_ns`` is when drivers were about to be triggered, ``sent_ns`` when all had been (None: at once). What they
        bring is as much younger than the tick as that was later, which is its (negative) age.
        """
        lag_s = 0.0
        if not self._lockstep and tick.at_ns is not None:
            lag_s = (sync_ns - tick.at_ns) / NS
            if lag_s > LATE * self._period or (sent_ns or sync_ns) - sync_ns > UNCERTAIN_NS:
                samples = [part if part.from_tick else _late(part) for part in samples]
        table = self._table
        if self._in_order:
            raw = samples[0].raw.copy()
        else:
            raw = self._unknown.copy()
            for order, part in zip(self._order, samples, strict=True):
                raw[order] = part.raw
        refused = [channel for channel, sentinel in table.sentinels if raw[channel] == sentinel]
        if refused:
            raw[refused] = np.nan
        if table.fields or table.turns:
            table.unwrapped(raw)
        values = table.gain * raw + table.bias
        new = np.isfinite(values)
        plain = self._covered and all(part.plain for part in samples) and np.count_nonzero(new) == len(new)
        if plain:
            quality, ages = self._judged(values, self._fresh), self._no_age - lag_s if lag_s else self._no_age
            self._newest = (values, tick.cycle, -lag_s)
        else:
            quality, ages, interval = self._described(samples, new, refused, lag_s)
            quality = self._judged(values, quality)
            self._hold(tick.cycle, new, values, ages, quality, interval)
        if quality is self._fresh:
            self._plain_frames += 1
        else:
            self._counts[quality, self._all] += 1
        return Frame(tick.cycle, sync_ns, utc_ns, tick.time, values, ages, quality)

    def _described(
        self, samples: Sequence[Samples], new: BoolArray, refused: list[int], lag_s: float
    ) -> tuple[FlagArray, FloatArray, FloatArray]:
        """Compute quality, age and interval (n,) of values: ``new``, or ``refused`` by a sentinel."""
        count = len(new)
        quality = np.full(count, Quality.MISSING, dtype=np.uint8)
        ago, after, interval = np.zeros(count, dtype=np.int64), np.zeros(count), np.ones(count)
        for order, part in zip(self._order, samples, strict=True):
            quality[order], ago[order] = part.quality, part.cycles_ago
            after[order] = part.after_sync_s if part.from_tick else part.after_sync_s + lag_s
            if part.interval is not None:
                interval[order] = part.interval
        quality[refused] = Quality.INVALID
        quality[~new & _NUMBERS[quality]] = Quality.INVALID  # whatever a driver says: what is no number is none
        quality[new & (quality == Quality.FRESH) & (ago > 0)] = Quality.LATE
        ages = np.asarray(ago * self._period - (0.0 if self._lockstep else after), dtype=np.float64)
        return quality, ages, interval

    def _judged(self, values: FloatArray, quality: FlagArray) -> FlagArray:
        """Mark fresh values out of range or frozen in the quality; return the same array if there are none."""
        if self._bounded:
            beyond = (values <= self._table.low) | (values >= self._table.high)
            if np.count_nonzero(beyond):  # quicker than any()
                quality = np.where(beyond & (quality == Quality.FRESH), np.uint8(Quality.OUT_OF_RANGE), quality)
        if self._frozen is not None:
            frozen = self._frozen.frozen(values, quality)
            if np.count_nonzero(frozen):
                quality = np.where(frozen, np.uint8(Quality.FROZEN), quality)
        return quality

    @property
    def counts(self) -> IntArray:
        """Frames of each quality so far, per channel, (qualities, n)."""
        self._counts[Quality.FRESH] += self._plain_frames
        self._plain_frames = 0
        return self._counts

    def _hold(
        self, cycle: int, new: BoolArray, values: FloatArray, ages: FloatArray, quality: FlagArray, interval: FloatArray
    ) -> None:
        """Fill what did not come with the last value, as held or stale, while it is recent; in place."""
        if self._newest is not None:
            self._last[:], self._last_cycle[:], self._last_age[:] = self._newest
            self._newest = None
        old = ~new
        if not old.any():
            self._last[:], self._last_age[:], self._last_cycle[:] = values, ages, cycle
            return
        self._last[new], self._last_age[new], self._last_cycle[new] = values[new], ages[new], cycle
        elapsed = cycle - self._last_cycle
        held = old & np.isfinite(self._last) & (elapsed <= np.maximum(HOLD_CYCLES, 2.0 * interval))
        values[held] = self._last[held]
        ages[old] = np.where(held, elapsed * self._period + self._last_age, np.nan)[old]
        absent = held & (quality == Quality.MISSING)
        # A device with a rate of its own owes nothing yet; half an interval is for what is a little late by itself.
        quality[absent] = np.where((interval > 1.0) & (elapsed <= 1.5 * interval), Quality.HELD, Quality.STALE)[absent]
        # A value that is no measurement is shown as such; holding is for values that did not come.
        values[old & (quality == Quality.INVALID)] = np.nan


def _late(samples: Samples) -> Samples:
    """Mark samples of a cycle sampled too late, or at an unknown moment."""
    return replace(
        samples, plain=False, quality=np.where(samples.quality == Quality.FRESH, Quality.LATE, samples.quality)
    )
