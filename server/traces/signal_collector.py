"""Reads the rings of all machines that are acquired into their memories; one thread, whoever looks or not."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from daq import Machine
from daq.acquisition.ring import RingReader
from daq.arrays import RowArray
from daq.errors import AcquisitionError
from daq.quality import MEASURED, Quality
from server.live.live_messages import Channels
from server.machines.acquisition import Acquisition
from server.platform.errors import InvalidError, ServiceError
from server.platform.processes.rounds import Rounds
from server.traces.extremes import BoolArray, Extremes, FloatArray, at_most, extremes

#: Length of a moment, s (0: a row as it came), and how many are kept: ten minutes of 50 Hz, half an hour, eight hours.
LEVELS = ((0.0, 30_000), (0.1, 18_000), (1.0, 28_800))


class _Kept:
    """One level: arrays with room for a quarter more than is kept, so that old moments are dropped rarely."""

    def __init__(self, width: float, most: int, channels: int) -> None:
        self.width, self._most = width, most
        room = most + most // 4
        self._time = np.empty(room)
        self._low = np.empty((room, channels), dtype=np.float32)
        # A row is its own smallest and largest value.
        self._high = self._low if width == 0 else np.empty_like(self._low)
        self._bad = np.empty((room, channels), dtype=bool)
        self._count = 0
        #: Whether something that came was dropped again: before its oldest moment there was more.
        self.dropped = False

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """(M,) of the moments that are kept."""
        return self._time[: self._count]

    def add(self, new: Extremes) -> None:
        """Append moments; the first of them may be a part of the last that is there."""
        first = 0
        if self.width > 0 and self._count and len(new.time) and abs(new.time[0] - self.time[-1]) < 0.5 * self.width:
            last = self._count - 1
            self._low[last] = np.fmin(self._low[last], new.low[0])
            self._high[last] = np.fmax(self._high[last], new.high[0])
            self._bad[last] |= new.flagged[0]
            first = 1
        first = max(first, len(new.time) - self._most)
        count = len(new.time) - first
        if self._count + count > len(self._time):
            self._keep(slice(self._count - (self._most - count), self._count))
            self.dropped = True
        place = slice(self._count, self._count + count)
        self._time[place], self._bad[place] = new.time[first:], new.flagged[first:]
        self._low[place] = new.low[first:]
        self._high[place] = new.high[first:]  # of rows: the same once more
        self._count += count

    def forget_from(self, time: float) -> None:
        """Drop what is not before ``time``."""
        self._count = int(np.searchsorted(self.time, time))

    def _keep(self, part: slice) -> None:
        count = part.stop - part.start
        own_high = () if self._high is self._low else (self._high,)
        for array in (self._time, self._low, *own_high, self._bad):
            array[:count] = array[part].copy()
        self._count = count

    def read(self, start: float, end: float, columns: Sequence[int]) -> Extremes:
        """Copy the moments from ``start`` to ``end``."""
        first = np.searchsorted(self.time, start - 0.5 * self.width)
        part = slice(int(first), int(np.searchsorted(self.time, end + 0.5 * self.width, side="right")))
        low = self._low[part][:, columns]
        high = low if self.width == 0 else self._high[part][:, columns]
        return Extremes(self._time[part].copy(), low, high, self._bad[part][:, columns], self.width)


class SignalMemory:
    """The last eight hours of one machine in bounded memory; filled by one thread, read by any.

    Three levels: rows as they came, the smallest and largest values of a tenth of a second, and those of each second. A
    range is read from the coarsest level that is fine enough for the plot and reaches back far enough.

    Parameters
    ----------
    channels : how many
    levels : from the finest, which is of rows, to the coarsest
    """

    def __init__(self, channels: int, levels: Sequence[tuple[float, int]] = LEVELS) -> None:
        self._levels = [_Kept(width, most, channels) for width, most in levels]
        self._lock = threading.Lock()

    def add(self, time: npt.NDArray[np.float64], values: FloatArray, bad: BoolArray) -> None:
        """Append rows.

        A computer's clock that was set back takes what lies after its new time along: a plot has one line of time.

        Parameters
        ----------
        time : (N,) s since 1970
        values : (N, n); NaN where nothing is known
        bad : (N, n) whether the value was not measured in this row
        """
        if len(time) == 0:
            return
        # Of rows whose time does not increase the later one counts.
        later = np.minimum.accumulate(np.append(time[1:], np.inf)[::-1])[::-1]
        keep = time < later
        time, bad = time[keep], bad[keep]
        values = np.asarray(values[keep], dtype=np.float32)
        with self._lock:
            for level in self._levels:
                if len(level.time) and time[0] <= level.time[-1] - level.width:
                    level.forget_from(float(time[0]) - 0.5 * level.width)
                level.add(
                    Extremes(time, values, values, bad, 0.0)
                    if level.width == 0
                    else extremes(time, values, values, bad, level.width)
                )

    @property
    def newest(self) -> float | None:
        """Time of the newest row, s since 1970; None before the first."""
        with self._lock:
            times = self._levels[0].time
            return float(times[-1]) if len(times) else None

    def read(self, start: float, end: float, moments: int, columns: Sequence[int]) -> Extremes:
        """Read what happened from ``start`` to ``end`` in at most ``moments`` + 1 moments.

        Parameters
        ----------
        start, end : s since 1970
        columns : of the channels that are asked for
        """
        with self._lock:
            level = self._level(start, (end - start) / moments)
            found = level.read(start, end, columns)
        return at_most(found, start, end, moments)

    def _level(self, start: float, width: float) -> _Kept:
        """Choose the coarsest level that is fine enough among those that reach back to ``start``, else the finest."""
        whole = [level for level in self._levels if not level.dropped or level.time[0] <= start]
        if not whole:
            return self._levels[-1]
        fine = [level for level in whole if level.width <= width]
        return fine[-1] if fine else whole[0]


#: Seconds between two looks; a ring holds a minute.
PERIOD_S = 0.5
#: Held values of a device with a rate of its own are as it should be: only the others are marked.
AS_IT_SHOULD = (*MEASURED, Quality.HELD)


class _Machine:
    """The memory of one machine, and the ring that it is filled from."""

    def __init__(self, channels: Channels) -> None:
        self.channels = channels
        self.memory = SignalMemory(len(channels.names))
        self.ring: RingReader | None = None

    def attach(self, name: str) -> None:
        """Read the ring of that name from its oldest row on, if it is another one than before."""
        if self.ring is None or self.ring.name != name:
            self.close()
            self.ring = RingReader(name, from_start=True)

    def close(self) -> None:
        """Release the ring."""
        if self.ring is not None:
            self.ring.close()
            self.ring = None

    def take(self) -> None:
        """Remember what came."""
        if self.ring is None:
            return
        rows = self.ring.read().rows
        if len(rows):
            values = self.channels.scale * rows["values"] + self.channels.offset
            self.memory.add(seconds(rows), values, ~np.isin(rows["quality"], AS_IT_SHOULD))


def seconds(rows: RowArray) -> npt.NDArray[np.float64]:
    """Return (N,) s since 1970 of rows of a ring."""
    return np.asarray(rows["utc_ns"] / 1e9)


class SignalCollector:
    """All memories.

    Parameters
    ----------
    acquired : where the rings are
    """

    def __init__(self, acquired: Acquisition) -> None:
        self._acquired = acquired
        self._lock = threading.Lock()
        self._machines: dict[str, _Machine] = {}
        self._rounds = Rounds("signals", PERIOD_S, self.step)

    def start(self) -> None:
        """Start collecting."""
        self._rounds.start()

    def stop(self) -> None:
        """End it, and let go of all rings."""
        self._rounds.stop()
        for machine in self._machines.values():
            machine.close()

    def step(self) -> None:
        """Remember what came since the last step."""
        for name in self._acquired.names():
            try:
                definition, feed = self._acquired.feed(name)
                machine = self._of(name, definition)
                machine.attach(feed.ring_name)
            except (ServiceError, AcquisitionError):  # it does not run at the moment
                continue
            machine.take()

    def read(
        self, name: str, seconds: float, end: float | None, moments: int, wanted: list[str] | None
    ) -> tuple[Channels, list[int], Extremes, tuple[float, float]] | None:
        """Read channels in the ``seconds`` before ``end`` (s since 1970; None: the newest row).

        Returns
        -------
        all channels, which of them were wanted, their extremes, and the range; None if nothing of the machine was
        acquired since the service began

        Raises
        ------
        InvalidError
            If the machine has no channel that is wanted.
        """
        with self._lock:
            machine = self._machines.get(name)
        if machine is None:
            return None
        names = machine.channels.names
        unknown = [one for one in wanted or () if one not in names]
        if unknown:
            raise InvalidError("server.channel_machine_none_name", unknown=unknown[0], name=name)
        columns = [names.index(one) for one in (names if wanted is None else wanted)]
        last = machine.memory.newest if end is None else end
        if last is None:
            return None
        return (
            machine.channels,
            columns,
            machine.memory.read(last - seconds, last, moments, columns),
            (last - seconds, last),
        )

    def _of(self, name: str, definition: Machine) -> _Machine:
        """Return the memory of a machine; a new one if its channels are others than before."""
        channels = Channels.of(definition)
        with self._lock:
            known = self._machines.get(name)
            if known is not None and (known.channels.names, known.channels.units) == (channels.names, channels.units):
                return known
            if known is not None:
                known.close()
            self._machines[name] = _Machine(channels)
            return self._machines[name]
