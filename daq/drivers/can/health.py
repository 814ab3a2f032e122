"""State of a CAN controller, from the error frames that its driver hands up; what drivers of CAN buses do about it.

SocketCAN (``linux/can/error.h``) says in an error frame's identifier which kinds of error it is about, and in its data
more about each::

    identifier  0x004 controller problem (data[1])   0x040 bus-off   0x100 restarted   0x200 counters (data[6], data[7])
    data[1]     0x04, 0x08 warning limit (96) of the receive, send counter   0x10, 0x20 error passive (128)
                0x40 error active again

Other interfaces send error frames without details; those are counted. A controller that was in warning and has had no
error frame for :data:`QUIET_S` is taken for active again: CiA and ISO 11898-1 let a counter fall by one with every good
frame, so at 50 SYNCs a second the 32 counts between warning and a sound bus are through in that time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from daq.drivers.base import DriverContext, DriverStatistics
from daq.drivers.bus_driver import BusDriver
from daq.frames.clock import NS
from daq.frames.events import EventLog
from daq.machine.machine_file import CanBus
from daq.messages import Sentence

QUIET_S = 2.0
_CONTROLLER, _BUS_OFF, _RESTARTED, _COUNTERS = 0x004, 0x040, 0x100, 0x200
WARNING_LIMIT, PASSIVE_LIMIT = 96, 128  # ISO 11898-1, 12.1.4
_ORDER = ("active", "warning", "passive", "bus_off")
_ADVICE = {
    "warning": "error counters of the CAN controller above their warning limit; check cable and termination",
    "passive": "the CAN controller is error passive; check bit rate, cable and termination",
    "bus_off": "the CAN controller is bus-off; check for a short circuit and the bit rate",
}


class BusHealth:
    """State of one controller: ``active``, ``warning``, ``passive`` or ``bus_off``; changes go into the events."""

    def __init__(self, bus: str = "", events: EventLog | None = None) -> None:
        self.state = "active"
        self.error_frames = 0
        self._bus = bus
        self._events = events
        self._last_ns = 0

    @property
    def line(self) -> str:
        """Cure of its state; empty while it is active."""
        return Sentence("daq.on_bus", bus=self._bus, advice=_ADVICE[self.state]) if self.state in _ADVICE else ""

    def on_error_frame(self, identifier: int, data: bytes, now_ns: int) -> None:
        """Count an error frame."""
        self.error_frames += 1
        self._last_ns = now_ns
        found: str | None = None
        if identifier & _CONTROLLER and len(data) > 1:
            detail = data[1]
            if detail & 0x30:
                found = "passive"
            elif detail & 0x0C:
                found = "warning"
            elif detail & 0x40:
                found = "active"
        if identifier & _COUNTERS and len(data) > 7:
            largest = max(data[6], data[7])
            by_count = _ORDER[(largest >= WARNING_LIMIT) + (largest >= PASSIVE_LIMIT)]
            found = by_count if found is None else max(found, by_count, key=_ORDER.index)
        if identifier & _BUS_OFF:
            found = "bus_off"
        elif identifier & _RESTARTED:
            found = "active"
        if found is not None:
            self._set(found)

    def look(self, now_ns: int) -> None:
        """End a limit that has not been reported for a while (not bus-off); to be called now and then."""
        if self.state in ("warning", "passive") and now_ns - self._last_ns > QUIET_S * NS:
            self._set("active")

    def opened(self) -> None:
        """Reset: the interface was opened anew, the controller with it."""
        self._set("active")

    def _set(self, state: str) -> None:
        old, self.state = self.state, state
        if self._events is not None and state != old:
            if old in _ADVICE:
                self._events.end(self._bus, _event(old))
            if state in _ADVICE:
                self._events.begin(self._bus, _event(state), self.line)


def _event(state: str) -> str:
    return state if state == "bus_off" else f"bus_{state}"


class CanDriver(BusDriver):
    """Keeps one CAN bus open.

    Attributes
    ----------
    health : of its controller, through all ports
    """

    def __init__(self, config: CanBus, names: Sequence[str], context: DriverContext, counts: Iterable[str]) -> None:
        super().__init__(config, names, context, counts)
        self.health = BusHealth(config.name, context.events)

    def opened(self) -> None:
        """Forget what was before a controller's reset."""
        self.health.opened()

    def condition(self) -> tuple[str, str]:
        """Return the condition by error frames."""
        return self.health.state, self.health.line

    def statistics(self) -> DriverStatistics:
        """Return the state of the bus and of every device, and counters since the start."""
        found = super().statistics()
        return replace(found, counts={**found.counts, "error_frames": self.health.error_frames})
