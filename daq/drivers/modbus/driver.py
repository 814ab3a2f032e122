"""Modbus drivers: one block read per unit and cycle, right after SYNC was sent on the buses that have one.

Modbus TCP has a connection and a thread per unit, so that a silent unit delays nobody else. A serial line, and a
gateway that allows one connection, are shared: there one thread asks unit after unit, the living first, and a silent
one ever more rarely. A unit that needs longer than a cycle is asked again when it has answered: its values come at its
own rate, with their age.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

from daq.drivers import wire
from daq.drivers.base import Answers, DeviceStatus, DriverContext, DriverStatistics, Problem, Samples, by_device
from daq.drivers.modbus.client import DEVICE_FAILURE, Answer, ModbusConnection
from daq.drivers.modbus.unit import Block, Reading, Unit, gap_is_to_blame
from daq.frames.clock import NS
from daq.machine.machine_file import Channel, ModbusRtuBus, ModbusSource, ModbusTcpBus
from daq.messages import Sentence
from daq.quality import Quality

BACK_OFF_S = (0.0, 0.0, 0.25, 0.5, 1.0)  # after so many failures in a row
MISSES_TOLERATED = 3
NAME_S = 0.2  # that asking a unit what it is may cost in service
#: Of the time of a line that several units share, silent ones may have a tenth: after each that was asked comes a pause
#: of nine time-outs.
SILENT_SHARE = 9


class Poller:
    """A thread that reads the units of one connection once per cycle."""

    def __init__(self, connection: ModbusConnection, units: Sequence[Unit], context: DriverContext) -> None:
        self.units = tuple(units)
        self.connection = connection
        self.done = threading.Event()
        self.lock = threading.Lock()
        self._context = context
        self._rate_hz = context.rate_hz or 1.0 / context.period_s
        self._go = threading.Event()
        self._stopping = False
        self._requested = (-1, 0)  # cycle and its SYNC
        self._silent_after_ns = 0
        self._names_until_ns: int | None = None
        self._question_s = connection.timeout_s
        self._thread: threading.Thread | None = None

    def start(self, name: str, names_until_ns: int | None = None, question_s: float | None = None) -> None:
        """Start polling on :meth:`trigger`; until then units that share a connection are asked what they are.

        Parameters
        ----------
        name : of the thread
        names_until_ns : monotonic time after which none of them is asked; None: no limit
        question_s : what asking a unit costs that does not know the question; the connection's time-out if None
        """
        self._names_until_ns = names_until_ns
        self._question_s = self.connection.timeout_s if question_s is None else question_s
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def trigger(self, cycle: int, now_ns: int) -> None:
        """Ask for a round of reads; a round that is still under way (a time-out) is not joined by a second one."""
        self._requested = (cycle, now_ns)
        self.done.clear()
        self._go.set()

    def begun(self) -> None:
        """End the start: what was read belongs to no cycle, and who has not answered is silent."""
        with self.lock:
            for unit in self.units:
                unit.forget()
                if unit.state == "commissioning":
                    self._is(unit, "silent", Sentence("daq.not_answered_yet", place=unit.place))

    def patience(self) -> bool:
        """Return whether its round is worth waiting for: some unit answered lately, in time."""
        return any(unit.failures < MISSES_TOLERATED and not unit.slow for unit in self.units)

    def _run(self) -> None:
        while True:
            self._go.wait()
            self._go.clear()
            if self._stopping:
                return
            cycle, sync_ns = self._requested
            for unit in sorted(self.units, key=lambda unit: unit.failures):
                if self._may_ask(unit):
                    try:
                        self.poll(unit, cycle, sync_ns)
                    except Exception as error:  # a frame that nobody thought of costs this answer, not the thread
                        self._failed(
                            unit,
                            Sentence("daq.reading_broke", place=unit.place, name=type(error).__name__, error=error),
                        )
            self._name_units(cycle)
            if cycle == self._requested[0]:
                self.done.set()

    def _may_ask(self, unit: Unit) -> bool:
        now = self._context.monotonic_ns()
        if now < unit.not_before_ns or self._stopping:
            return False
        return len(self.units) == 1 or unit.failures < MISSES_TOLERATED or now >= self._silent_after_ns

    def poll(self, unit: Unit, cycle: int, sync_ns: int = 0) -> None:
        """Read the blocks of a unit that are due and keep the answers."""
        began = self._context.monotonic_ns()
        problem = ""
        due = unit.due(cycle)
        if not due or not self._decimals(unit):
            return
        for block in due:
            before = self._context.monotonic_ns()
            answer = self.connection.read(unit.number, block.table, block.address, block.count)
            after = self._context.monotonic_ns()
            problem = problem or unit.problem(block, answer) or ""
            if answer.failure is None:
                unit.latency.add(after - before)
            if answer.failure is not None:
                unit.requests += 1
                self._failed(unit, problem)
                return  # its other blocks would time out as well
            with self.lock:
                self._keep(unit, block, Reading(answer, cycle, sync_ns, (before + after) // 2, block.asked + 1))
        ended = self._context.monotonic_ns()
        with self.lock:
            unit.failures, unit.not_before_ns = 0, 0
            unit.took(max(1, self._requested[0] - cycle + (self._requested[0] > cycle)), (ended - began) / 1e6)
            any_good = any(block.reading is not None and block.reading.answer.good for block in unit.blocks)
            self._is(unit, "running" if any_good else "failed", problem)

    def _name_units(self, cycle: int) -> None:
        """Ask answering units what they are, once: one that does not know the question costs a time-out.

        While cycles go on that may cost nobody else, and not much: only a unit with a connection of its own and a short
        time-out, or one that has answered the question before, is asked then.
        """
        cheap = len(self.units) == 1 and self._question_s <= NAME_S
        for unit in self.units:
            if not unit.unnamed or unit.failures or unit.state != "running" or self._stopping:
                continue
            ends = self._context.monotonic_ns() + round(self._question_s * NS)
            if cycle < 0 and self._names_until_ns is not None and ends > self._names_until_ns:
                continue
            if cycle < 0 or cheap or unit.identity:
                unit.unnamed = False
                unit.identity = self.connection.identity(unit.number)

    def _decimals(self, unit: Unit) -> bool:
        """Ask for unknown decimals; return whether they now are known."""
        for table, register in unit.unknown_decimals():
            answer = self.connection.read(unit.number, table, register, 1)
            unit.requests += 1
            problem = unit.learn_decimals(table, register, answer)
            if problem:
                self._failed(unit, problem)
                return False
        return True

    def _keep(self, unit: Unit, block: Block, reading: Reading) -> None:
        unit.requests += 1
        block.asked = reading.ordinal
        if not reading.answer.good:
            unit.exceptions += 1
            if gap_is_to_blame(reading.answer) and unit.split(block):
                return
        elif block.rate_hz is not None:
            block.next_cycle = reading.cycle + max(1, round(self._rate_hz / block.rate_hz))
        block.reading = reading

    def _failed(self, unit: Unit, problem: str) -> None:
        now = self._context.monotonic_ns()
        with self.lock:
            unit.failures += 1
            unit.timeouts += 1
            pause = BACK_OFF_S[min(unit.failures, len(BACK_OFF_S) - 1)]
            unit.not_before_ns = now + round(pause * NS)
            if unit.failures >= MISSES_TOLERATED:
                self._silent_after_ns = now + round(SILENT_SHARE * self.connection.timeout_s * NS)
                unit.unnamed |= bool(unit.identity)  # it may be another one when it is back
            unit.forget_decimals()
            self._is(unit, "silent", problem)

    def _is(self, unit: Unit, state: str, problem: str) -> None:
        events = self._context.events
        if state != "running" and not unit.away:
            events.begin(unit.name, state, problem)
            unit.away, unit.cause = state, problem
        elif state == "running" and unit.away:
            seconds = events.end(unit.name, unit.away) or 0.0
            unit.away, unit.cause = "", Sentence("daq.was_away", cause=unit.cause, seconds=seconds)
        unit.state, unit.detail = state, problem

    def stop(self) -> None:
        """End the thread and close the connection."""
        self._stopping = True
        self._go.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        self.connection.close()


class _ModbusDriver:
    leads = False

    def __init__(self, bus: ModbusTcpBus | ModbusRtuBus, channels: Sequence[Channel], context: DriverContext) -> None:
        self._bus = bus
        self._context = context
        self._names = tuple(channel.name for channel in channels)
        self._timeout = max(bus.timeout_s, context.patience_s)
        self._rate_hz = context.rate_hz or 1.0 / context.period_s
        self._units = [
            Unit(
                number,
                Sentence("daq.bus_unit_named", bus=bus.name, number=number, member=[c.name for _, c in members[:3]]),
                f"{bus.name}/unit {number}",
                members,
                bus.maximum_gap,
            )
            for number, members in by_device(channels, lambda source: source.unit).items()
        ]
        self._counts = dict.fromkeys(("missing", "late", "not_a_number"), 0)
        self._pollers: list[Poller] = []
        self._cycle = 0
        self._sync_ns = 0

    def _groups(self) -> list[list[Unit]]:
        """Group units that share a connection."""
        raise NotImplementedError

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the samples."""
        return self._names

    def start(self) -> tuple[str, ...]:
        """Connect to all side by side, and read every unit once."""
        for group in self._groups():
            self._pollers.append(Poller(ModbusConnection(self._bus, self._timeout), group, self._context))
        allowed = self._context.start_s
        deadline = None if allowed is None else self._context.monotonic_ns() + round(allowed * NS)
        for number, poller in enumerate(self._pollers):
            poller.start(f"modbus-{self._bus.name}-{number}", deadline, self._bus.timeout_s)
        for attempt in (-2, -1):  # a first request may meet a gateway that is just opening its line
            for poller in self._pollers:
                if attempt == -2 or any(unit.detail for unit in poller.units):
                    poller.trigger(attempt, self._context.monotonic_ns())
            for poller in self._pollers:
                left = None if deadline is None else max(0.0, (deadline - self._context.monotonic_ns()) / NS)
                poller.done.wait(left)
        for poller in self._pollers:
            poller.begun()
        return tuple(Problem(unit.detail, unit.lost()) for unit in self._units if unit.detail)

    def trigger(self, cycle: int) -> None:
        """Start a round of reads."""
        self._cycle, self._sync_ns = cycle, self._context.monotonic_ns()
        for poller in self._pollers:
            poller.trigger(cycle, self._sync_ns)

    def collect(self, until_ns: int) -> Samples:
        """Collect registers of this cycle, as soon as all units that are alive have answered."""
        answers = Answers(len(self._names))
        for poller in self._pollers:
            remaining = (until_ns - self._context.monotonic_ns()) / NS
            if remaining > 0 and poller.patience():
                poller.done.wait(remaining)
            with poller.lock:
                for unit in poller.units:
                    for block in unit.blocks:
                        self._take(unit, block, answers)
        self._counts["not_a_number"] += answers.no_numbers
        return answers.samples()

    def _take(self, unit: Unit, block: Block, answers: Answers) -> None:
        every = 1.0 if block.rate_hz is None else max(1.0, self._rate_hz / block.rate_hz)
        interval = max(every, unit.cycles)
        for position, _, _ in block.members:
            answers.interval[position] = interval
        reading = block.reading
        if reading is None or reading.ordinal <= block.taken:
            if interval == 1.0:
                self._counts["missing"] += 1
            return
        block.taken = reading.ordinal
        ago = self._cycle - reading.cycle
        self._counts["late"] += ago > 0
        after_s = (reading.sampled_ns - reading.sync_ns) / NS
        for position, offset, source in block.members:
            answers.cycles_ago[position] = ago
            answers.after_sync_s[position] = after_s
            self._value(unit, reading.answer, position, offset, source, answers)

    def _value(
        self, unit: Unit, answer: Answer, position: int, offset: int, source: ModbusSource, answers: Answers
    ) -> None:
        if answer.exception is not None:
            failure = answer.exception == DEVICE_FAILURE
            answers.quality[position] = Quality.EMERGENCY if failure else Quality.MISSING
            return
        words = list(answer.registers[offset : offset + wire.registers(source.data_type)])
        value = wire.from_registers(source.data_type, words, source.word_order, source.byte_order)
        if position in unit.decimals:
            value = unit.decimals[position].value(value)
        answers.value(position, value, Quality.FRESH)

    def statistics(self) -> DriverStatistics:
        """Return the state of every unit, and counters since the start."""
        devices = tuple(
            DeviceStatus(
                Sentence("daq.unit_number", number=u.number),
                u.state,
                u.detail or u.slowness(self._rate_hz) or u.cause,
                u.latency.mean_std(),
                u.identity,
            )
            for u in self._units
        )
        counts = {
            "requests": sum(unit.requests for unit in self._units),
            "timeouts": sum(unit.timeouts for unit in self._units),
            "exceptions": sum(unit.exceptions for unit in self._units),
            "slow_units": sum(unit.slow for unit in self._units),
            **self._counts,
        }
        down = all(unit.state == "silent" for unit in self._units)
        line = Sentence("daq.no_unit_answers", bus=self._bus.name) if down else ""
        return DriverStatistics(self._bus.name, devices, counts, "down" if down else "active", line)

    def stop(self) -> None:
        """Close all connections."""
        pollers, self._pollers = self._pollers, []
        for poller in pollers:
            poller.stop()


class ModbusTcpDriver(_ModbusDriver):
    """Modbus TCP transmitters (see :class:`daq.drivers.base.Driver`); a connection per unit, or one for all."""

    def _groups(self) -> list[list[Unit]]:
        shared = isinstance(self._bus, ModbusTcpBus) and self._bus.connections == "shared"
        return [self._units] if shared else [[unit] for unit in self._units]


class ModbusRtuDriver(_ModbusDriver):
    """Modbus transmitters on a serial line (see :class:`daq.drivers.base.Driver`); the port is shared."""

    def _groups(self) -> list[list[Unit]]:
        return [self._units]
