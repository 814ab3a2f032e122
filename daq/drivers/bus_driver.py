"""What drivers of a bus have in common, whether they lead or listen: a port that is opened, watched and rebuilt."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from daq.drivers.base import DeviceStatus, DriverContext, DriverStatistics
from daq.drivers.keeper import Keeper
from daq.errors import AcquisitionError, first_line
from daq.machine.machine_file import Bus
from daq.messages import Sentence, named

REOPEN_S = 0.25  # between two attempts to open a bus: one that is refused costs nobody anything, unlike a node's


class Port:
    """An open bus.

    Attributes
    ----------
    failure : why it cannot be used any more; None while it can
    sure_ns : times of what came before, monotonic ns, may be wrong by more than a millisecond
    """

    failure: str | None = None
    sure_ns: float = 0.0

    def fail(self, error: Exception) -> None:
        """Remember why the bus is unusable; the first reason counts."""
        if self.failure is None:
            self.failure = named(type(error).__name__, first_line(error))

    def received_ns(self, now_ns: int) -> int:
        """Return up to when all that came was taken: nobody is silent by what this process missed."""
        return now_ns

    def counts(self) -> dict[str, int]:
        """Count what came and what was lost since it was opened."""
        return {}

    def close(self) -> None:
        """Release the interface."""


class BusDriver:
    """Keeps one bus open (see :class:`daq.drivers.base.Driver`).

    A subclass says how a port is made (:meth:`connected`), and what its devices are (:meth:`devices`).

    Attributes
    ----------
    port : the open bus; None while there is none
    failure : why it cannot be used; empty while it can
    counts : what happened on it since the start
    """

    def __init__(self, config: Bus, names: Sequence[str], context: DriverContext, counts: Iterable[str]) -> None:
        self.config = config
        self.context = context
        self.counts = dict.fromkeys((*counts, "bus_rebuilt", "keeper_broke"), 0)
        self.port: Port | None = None
        self.failure = ""
        self.keeper = Keeper(f"keeper-{config.name}", self.open, self._broke, context.monotonic_ns, (REOPEN_S,))
        self._names = tuple(names)
        self._before: Counter[str] = Counter()  # counts of the ports that were closed

    def connected(self) -> Port:
        """Open a new port whose frames arrive; AcquisitionError if the bus cannot be opened."""
        raise NotImplementedError

    def opened(self) -> None:
        """Take over a new port."""

    def went_down(self) -> None:
        """Note that the bus cannot be used, for ``failure``."""

    def devices(self, failure: str) -> Iterable[DeviceStatus]:
        """Return the state of every device; ``failure`` is why the bus is unusable, or empty."""
        raise NotImplementedError

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the samples."""
        return self._names

    def open(self) -> None:
        """Close the bus if it is open, and open it."""
        port, self.port = self.port, None
        if port is not None:
            self._before += Counter(port.counts())
            port.close()
            self.counts["bus_rebuilt"] += 1
        try:
            self.port = self.connected()
        except AcquisitionError as error:
            self.is_down(str(error))
            return
        self.failure = ""
        self.context.events.end(self.config.name, "bus_down")
        self.keeper.settled()
        self.opened()

    def _broke(self, error: Exception) -> None:
        self.counts["keeper_broke"] += 1
        what = named(type(error).__name__, first_line(error))
        self.is_down(Sentence("daq.bus_opening_broke", config=self.config.name, what=what))

    def is_down(self, line: str) -> None:
        """Note that the bus is unusable; it is opened again after a while."""
        self.failure = line
        self.context.events.begin(self.config.name, "bus_down", line)
        self.went_down()
        self.keeper.later()

    def working(self) -> bool:
        """Return whether there is a bus; a broken one is taken care of."""
        port = self.port
        if port is not None and port.failure is None:
            return True
        if port is not None and not self.failure:
            self.is_down(Sentence("daq.bus_opened_again", config=self.config.name, failure=port.failure))
        return False

    def condition(self) -> tuple[str, str]:
        """Return the state of the open bus (:class:`daq.drivers.base.DriverStatistics`), and a line about it."""
        return "active", ""

    def statistics(self) -> DriverStatistics:
        """Return the state of the bus and of every device, and counters since the start."""
        port = self.port
        failure = self.failure or (port.failure or "" if port is not None else "closed")
        counts = self.counts | dict(self._before)
        for name, value in (port.counts() if port is not None else {}).items():
            counts[name] = value + self._before[name]
        state, line = self.condition()
        return DriverStatistics(
            self.config.name,
            tuple(self.devices(failure)),
            counts,
            "down" if failure and state != "bus_off" else state,
            line or failure,
        )

    def stop(self) -> None:
        """Close the bus."""
        self.keeper.stop()
        port, self.port = self.port, None
        if port is not None:
            port.close()
