"""From what drivers bring in a cycle to a frame: scaling, range, quality, and holding what is a little old."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from daq.acquisition.frozen import FrozenDetector
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
        self._newest: tuple[npt.NDArray[np.float64], int, float] | None = None  # values, cycle, age, if it was plain
        self._counts = np.zeros((len(Quality), count), dtype=np.int64)
        self._plain_frames = 0  # that are not in there yet
        # Of plain frames, which share them:
        self._fresh, self._no_age = np.zeros(count, dtype=np.uint8), np.zeros(count)
        self._fresh.flags.writeable = self._no_age.flags.writeable = False

    def frame(
        self, tick: Tick, sync_ns: int, utc_ns: int, samples: Sequence[Samples], sent_ns: int | None = None
    ) -> Frame:
        """The frame of this tick; ``samples`` of every driver, in the order given at the start.

        ``sync_ns`` is when drivers were about to be triggered, ``sent_ns`` when all had been (None: at once). What they
        bring is as much younger than the tick as that was later, which is its (negative) age.
        """
        lag_s = 0.0
        if not self._lockstep and tick.at_ns is not None:
            lag_s = (sync_ns - tick.at_ns) / NS
            if lag_s > LATE * self._period or (sent_ns or sync_ns) - sync_ns > UNCERTAIN_NS:
                samples = [part if part.from_tick else _late(part) for part in samples]
        if self._covered and all(part.plain for part in samples):
            plain = self._plain(tick, sync_ns, utc_ns, samples, lag_s)
            if plain is not None:
                return plain
        table = self._table
        count = len(table.names)
        raw = self._unknown.copy()
        quality = np.full(count, Quality.MISSING, dtype=np.uint8)
        ago = np.zeros(count, dtype=np.int64)
        after = np.zeros(count)
        interval = np.ones(count)
        for order, part in zip(self._order, samples, strict=True):
            raw[order], quality[order] = part.raw, part.quality
            ago[order] = part.cycles_ago
            after[order] = part.after_sync_s if part.from_tick else part.after_sync_s + lag_s
            if part.interval is not None:
                interval[order] = part.interval
        for channel, sentinel in table.sentinels:
            if raw[channel] == sentinel:
                raw[channel], quality[channel] = np.nan, Quality.INVALID
        if table.fields or table.turns:
            table.unwrapped(raw)
        values = table.gain * raw + table.bias
        ages: npt.NDArray[np.float64] = np.asarray(ago * self._period, dtype=np.float64)
        if not self._lockstep:
            ages = np.asarray(ages - after, dtype=np.float64)
        new = np.isfinite(values)
        # Whatever a driver says: what is no number is no measurement.
        if not new.all():
            quality[~new & _NUMBERS[quality]] = Quality.INVALID
        if ago.any():
            quality[new & (quality == Quality.FRESH) & (ago > 0)] = Quality.LATE
        beyond = (values <= table.low) | (values >= table.high)
        if beyond.any():
            quality[beyond & (quality == Quality.FRESH)] = Quality.OUT_OF_RANGE
        if self._frozen is not None:
            quality[self._frozen.frozen(values, quality)] = Quality.FROZEN
        self._hold(tick.cycle, new, values, ages, quality, interval)
        self._counts[quality, self._all] += 1
        return Frame(tick.cycle, sync_ns, utc_ns, tick.time, values, ages, quality)

    @property
    def counts(self) -> npt.NDArray[np.int64]:
        """Frames of each quality so far, per channel, (qualities, n)."""
        self._counts[Quality.FRESH] += self._plain_frames
        self._plain_frames = 0
        return self._counts

    def _plain(self, tick: Tick, sync_ns: int, utc_ns: int, samples: Sequence[Samples], lag_s: float) -> Frame | None:
        """What :meth:`frame` makes of samples that are all plain; None if some value is no measurement after all."""
        table = self._table
        if self._in_order:
            raw = samples[0].raw
        else:
            raw = self._unknown.copy()
            for order, part in zip(self._order, samples, strict=True):
                raw[order] = part.raw
        for channel, sentinel in table.sentinels:
            if raw[channel] == sentinel:
                return None
        if table.fields or table.turns:
            raw = raw.copy()
            table.unwrapped(raw)
        values = table.gain * raw + table.bias
        if np.count_nonzero(np.isfinite(values)) != len(values):  # quicker than all()
            return None
        quality = self._fresh
        if self._bounded:
            beyond = (values <= table.low) | (values >= table.high)
            if np.count_nonzero(beyond):
                quality = np.where(beyond, np.uint8(Quality.OUT_OF_RANGE), quality)
        if self._frozen is not None:
            frozen = self._frozen.frozen(values, quality)
            if np.count_nonzero(frozen):
                quality = np.where(frozen, np.uint8(Quality.FROZEN), quality)
        self._newest = (values, tick.cycle, -lag_s)
        if quality is self._fresh:
            self._plain_frames += 1
        else:
            self._counts[quality, self._all] += 1
        ages = self._no_age - lag_s if lag_s else self._no_age
        return Frame(tick.cycle, sync_ns, utc_ns, tick.time, values, ages, quality)

    def _hold(
        self,
        cycle: int,
        new: npt.NDArray[np.bool_],
        values: npt.NDArray[np.float64],
        ages: npt.NDArray[np.float64],
        quality: npt.NDArray[np.uint8],
        interval: npt.NDArray[np.float64],
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
    """Samples of a cycle that was sampled too late, or nobody knows when."""
    return replace(
        samples, plain=False, quality=np.where(samples.quality == Quality.FRESH, Quality.LATE, samples.quality)
    )
