"""Common parts of drivers of a bus: a port that is opened, watched and rebuilt, and a keeper of each device."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from daq.drivers.base import DeviceStatus, DriverContext, DriverStatistics
from daq.errors import AcquisitionError, first_line
from daq.frames.clock import NS
from daq.machine.machine_file import Bus
from daq.messages import Sentence, named

#: Pauses after so many failures in a row. The longest one, with the time that an attempt takes, is what a device that
#: is back may have to wait for: it is kept below the two seconds within which its values have to be there again.
BACK_OFF_S = (0.25, 0.5, 1.0)
STOP_TIMEOUT_S = 3.0
LOOK_S = 0.5  # at most between two looks at the clock while something is due
REOPEN_S = 0.25  # between two attempts to open a bus: one that is refused costs nobody anything, unlike a node's


class Keeper:
    """Calls ``care`` in a thread of its own whenever it is due.

    Parameters
    ----------
    care : what is to be done; may take long. It asks again (:meth:`later`) if it did not succeed, or says
        :meth:`settled`.
    broke : gets an exception that ``care`` let out; it is a bug or a frame nobody thought of, never the keeper's end
    monotonic_ns : the clock that pauses are measured with
    pauses : s, after so many failures in a row
    """

    def __init__(
        self,
        name: str,
        care: Callable[[], None],
        broke: Callable[[Exception], None],
        monotonic_ns: Callable[[], int],
        pauses: Sequence[float] = BACK_OFF_S,
    ) -> None:
        self._care = care
        self._broke = broke
        self._monotonic_ns = monotonic_ns
        self._pauses = pauses
        self._condition = threading.Condition()
        self._due: int | None = None
        self._attempts = 0
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._started = False

    @property
    def stopping(self) -> bool:
        """True when whatever takes long should give up."""
        return self._stopping

    def paused(self, seconds: float) -> bool:
        """Let time pass; return True if the keeper was stopped meanwhile."""
        with self._condition:
            return self._condition.wait_for(lambda: self._stopping, seconds)

    def start(self) -> None:
        """Start the thread; nothing is due yet."""
        self._started = True
        self._thread.start()

    def soon(self) -> None:
        """Care now: something happened that makes a new attempt worthwhile."""
        with self._condition:
            self._attempts = 0
            self._due = self._monotonic_ns()
            self._condition.notify()

    def later(self) -> None:
        """Schedule care after the back-off, unless it is due already."""
        with self._condition:
            if self._due is not None:
                return
            pause = self._pauses[min(self._attempts, len(self._pauses) - 1)]
            self._attempts += 1
            self._due = self._monotonic_ns() + round(pause * NS)
            self._condition.notify()

    def settled(self) -> None:
        """Reset: nothing is due, and the next failure is a first one."""
        with self._condition:
            self._due, self._attempts = None, 0

    def stop(self) -> None:
        """End the thread."""
        with self._condition:
            self._stopping = True
            self._condition.notify()
        if self._started and threading.current_thread() is not self._thread:
            self._thread.join(timeout=STOP_TIMEOUT_S)

    def _run(self) -> None:
        while True:
            with self._condition:
                if self._stopping:
                    return
                if self._due is None:  # whoever makes something due says so: looking now and then costs 0.3 % of a core
                    self._condition.wait()
                    continue
                if (wait := (self._due - self._monotonic_ns()) / NS) > 0:
                    self._condition.wait(min(LOOK_S, wait))
                    continue
                self._due = None
            try:
                self._care()
            except Exception as error:  # whatever it is costs this attempt, not the device for good
                self._broke(error)
                self.later()


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
