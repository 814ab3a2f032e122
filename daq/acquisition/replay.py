"""A raw trace through the drivers: what acquisition made of these frames, without the machine.

Time is the trace's: it passes by reading. Where no SYNC leads, cycles end in the longest pause, so that each has one of
every frame that comes once per cycle. Buses that were listened to go through their own drivers. A bus that hilfit led
is taken as another master's whose SYNC leads: its TPDOs are those that commissioning maps, credited to the recorded
SYNCs. Channels of other buses are missing.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import numpy as np

from daq.acquisition.assembly import Assembler
from daq.acquisition.frozen import FrozenDetector
from daq.acquisition.trace import bus_file, read_trace, trace_files
from daq.drivers.base import Driver, DriverContext, make_driver
from daq.drivers.can.port import CanAccess, CanPort
from daq.drivers.canopen.listening import ListeningDriver, commissioned, nothing_to_ask
from daq.errors import InputError
from daq.frames.channels import channel_table, channels_by_bus
from daq.frames.clock import NS, RealClock, Tick
from daq.frames.events import EventLog
from daq.frames.frame import Frame
from daq.machine.machine_file import CanBus, CanopenBus, CanSignalsBus, Channel, Machine

_LOOKED_AT = 5000  # frames of each bus by which the cycle's phase is chosen


@dataclass(frozen=True)
class Replay:
    """Content of a trace: frames, events (:class:`daq.frames.events.Event`) and the buses' counters."""

    frames: list[Frame]
    events: list[dict[str, Any]]
    buses: list[dict[str, Any]]


class _Silent:
    """A bus that nothing can be sent on."""

    def send(self, message: can.Message) -> None:
        raise can.CanOperationError("a trace takes no frames")

    def shutdown(self) -> None:
        pass


class _Tape(CanAccess):
    """Hands frames of all buses to their ports, in the order of their time stamps; they are the clock."""

    def __init__(self, files: dict[str, Path]) -> None:
        self._ports: dict[str, CanPort] = {}
        self.first = {bus: _first(bus, path) for bus, path in files.items()}
        self._frames = heapq.merge(*(_stamped(bus, path) for bus, path in files.items()), key=lambda entry: entry[0])
        self._next = next(self._frames, None)
        self.now_ns = 0 if self._next is None else self._next[0]

    @property
    def ended(self) -> bool:
        """True where there are no more frames."""
        return self._next is None

    def attach(self, port: CanPort, config: CanBus) -> Any:
        """Attach no interface."""
        self._ports[config.name] = port
        return _Silent()

    def begin(self, port: CanPort) -> None:
        """Do nothing: frames come by :meth:`step`."""

    def step(self, until_ns: int) -> bool:
        """Deliver the next frame if it came by then, and let time pass until it; else until then: False."""
        if self._next is None or self._next[0] > until_ns:
            self.now_ns = max(self.now_ns, until_ns)
            return False
        at_ns, bus, message = self._next
        self.now_ns = max(self.now_ns, at_ns)
        self._ports[bus].take(message)
        self._next = next(self._frames, None)
        return True


def _first(bus: str, path: Path) -> dict[int, list[int]]:
    """Find when the first frames of a bus came, by identifier."""
    found: dict[int, list[int]] = {}
    for at_ns, _, message in itertools.islice(_stamped(bus, path), _LOOKED_AT):
        found.setdefault(message.arbitration_id, []).append(at_ns)
    return found


def _stamped(bus: str, path: Path) -> Iterator[tuple[int, str, can.Message]]:
    for message in read_trace(path):
        yield round(message.timestamp * NS), bus, message


def replay(machine: Machine, trace: Path) -> Replay:
    """Run a machine's drivers over a trace.

    Raises
    ------
    InputError
        If the machine has no CAN bus, or a file of the trace is not there or none.
    """
    buses = [bus for bus in machine.buses if isinstance(bus, CanopenBus | CanSignalsBus)]
    grouped = channels_by_bus(machine, f"machine '{machine.name}'")
    buses = [bus for bus in buses if bus.name in grouped]
    tape = _Tape(_files(trace, [bus.name for bus in buses]))
    period_s = 1.0 / machine.rate_hz
    events = EventLog(lambda: tape.now_ns, lambda: tape.now_ns)
    context = DriverContext(period_s, 0.0, lambda: tape.now_ns, start_s=0.0, events=events, can=tape)
    drivers = [_driver(bus, grouped[bus.name], context) for bus in buses]
    leading = next((d for d in drivers if isinstance(d, ListeningDriver) and d.follows_sync), None)
    try:
        for driver in drivers:
            driver.start()
        frames = list(_frames(machine, tape, drivers, leading))
        statistics = [driver.statistics() for driver in drivers]
    finally:
        for driver in drivers:
            driver.stop()
    return Replay(frames, events.published(), [{"bus": s.bus, "counts": dict(s.counts)} for s in statistics])


def _files(trace: Path, buses: list[str]) -> dict[str, Path]:
    """Return the file of each bus: by its name, or the only one of the only bus."""
    if not buses:
        raise InputError("daq.trace_without_can_bus", trace=trace)
    if not trace.parent.is_dir():
        raise InputError("daq.no_trace_folder", trace=trace)
    if len(buses) == 1 and trace.is_file():
        return {buses[0]: trace}
    files = {bus: bus_file(trace, bus) for bus in buses}
    there = {bus: path for bus, path in files.items() if trace_files(path)}
    if not there:
        names = [path.name for path in files.values()]
        raise InputError("daq.no_such_trace", trace=trace, names=names, folder=trace.parent)
    return there


def _driver(bus: CanopenBus | CanSignalsBus, channels: tuple[Channel, ...], context: DriverContext) -> Driver:
    if isinstance(bus, CanSignalsBus) or bus.listen_only:
        return make_driver(bus, channels, context)
    nothing_to_ask(bus, channels)
    followed = bus.model_copy(update={"listen_only": True, "sync": "external"})
    return ListeningDriver(followed, channels, context, commissioned(bus, channels))


def _frames(machine: Machine, tape: _Tape, drivers: list[Driver], leading: ListeningDriver | None) -> Iterator[Frame]:
    table = channel_table(machine)
    names = [driver.channels for driver in drivers]
    assembler = Assembler(table, names, machine.rate_hz, frozen=FrozenDetector(machine))
    period_ns = round(NS / machine.rate_hz)

    clock = None if leading is None else _TapeClock(tape, leading, machine.rate_hz)
    if clock is not None:
        clock.start()
    begin, number = tape.now_ns + _phase(tape.first, tape.now_ns, period_ns) - period_ns, 0
    while not tape.ended:
        if clock is not None:
            tick = clock.wait()
        else:
            number += 1
            while tape.step(begin + number * period_ns):
                pass
            tick = Tick(number - 1, (number - 1) / machine.rate_hz, 0, 0, tape.now_ns)
        at_ns = tape.now_ns
        for driver in drivers:
            driver.trigger(tick.cycle)
        samples = {id(driver): driver.collect(at_ns) for driver in drivers if driver is not leading}
        while tape.step(tick.collect_until_ns):
            pass
        if leading is not None:
            samples[id(leading)] = leading.collect(tape.now_ns)
            if not leading.counts["sync"]:
                continue  # commissioning, or nobody leads yet
        yield assembler.frame(tick, at_ns, at_ns, [samples[id(driver)] for driver in drivers])


class _TapeClock(RealClock):
    """Led by a trace's SYNCs; time passes as its frames are taken."""

    def __init__(self, tape: _Tape, leading: ListeningDriver, rate_hz: float) -> None:
        super().__init__(rate_hz, following=lambda: self._next_sync)
        self._tape, self._leading = tape, leading

    def monotonic_ns(self) -> int:
        """Return the tape's time."""
        return self._tape.now_ns

    def _next_sync(self, deadline_ns: int) -> int | None:
        while (came := self._leading.next_sync(self._tape.now_ns)) is None and self._tape.step(deadline_ns):
            pass
        return came


def _phase(first: dict[str, dict[int, list[int]]], begin_ns: int, period_ns: int) -> int:
    """Find where in a period frequent frames (one a second or more) come least: mid of the longest pause, ns."""
    streams = [moments for of_bus in first.values() for moments in of_bus.values()]
    often = [moments for moments in streams if 2 * len(moments) * period_ns >= moments[-1] - moments[0] > 0]
    phases = np.sort([(moment - begin_ns) % period_ns for moments in often for moment in moments])
    if not len(phases):
        return 0
    pauses = np.diff(phases, append=phases[0] + period_ns)
    widest = int(np.argmax(pauses))
    return int(phases[widest] + pauses[widest] // 2) % period_ns
