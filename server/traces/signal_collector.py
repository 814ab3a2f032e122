"""Reads the rings of all machines that are acquired into their memories; one thread, whoever looks or not."""

from __future__ import annotations

import threading

import numpy as np
import numpy.typing as npt

from daq import Machine
from daq.acquisition.ring import RingReader
from daq.errors import AcquisitionError
from daq.messages import Sentence
from daq.quality import MEASURED, Quality
from server.live.live_messages import Channels
from server.machines.acquisition import Acquisition
from server.platform.errors import InvalidError, ServiceError
from server.platform.processes.rounds import Rounds
from server.traces.extremes import Extremes
from server.traces.signal_memory import SignalMemory

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


def seconds(rows: npt.NDArray[np.void]) -> npt.NDArray[np.float64]:
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
            raise InvalidError(Sentence("server.channel_machine_none_name", unknown=unknown[0], name=name))
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
