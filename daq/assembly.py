"""From what drivers bring in a cycle to a frame: scaling, range, quality, and holding what is a little old."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from daq.channels import ChannelTable
from daq.clock import Tick
from daq.drivers.base import Samples
from daq.frame import Frame
from daq.frozen import FrozenDetector
from daq.quality import Quality

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
        self._all = np.arange(count)
        self._unknown = np.full(count, np.nan)
        self._last = np.full(count, np.nan)
        self._last_age = np.full(count, np.nan)  # at the cycle in which it came
        self._last_cycle = np.zeros(count, dtype=np.int64)
        self.counts = np.zeros((len(Quality), count), dtype=np.int64)  # frames of each quality, per channel

    def frame(self, tick: Tick, sync_ns: int, utc_ns: int, samples: Sequence[Samples]) -> Frame:
        """The frame of this tick; ``samples`` of every driver, in the order given at the start."""
        table = self._table
        count = len(table.names)
        raw = self._unknown.copy()
        quality = np.full(count, Quality.MISSING, dtype=np.uint8)
        ago = np.zeros(count, dtype=np.int64)
        after = np.zeros(count)
        interval = np.ones(count)
        for order, part in zip(self._order, samples, strict=True):
            raw[order], quality[order] = part.raw, part.quality
            ago[order], after[order] = part.cycles_ago, part.after_sync_s
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
        self.counts[quality, self._all] += 1
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
