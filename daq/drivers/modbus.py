"""Modbus drivers: one block read per unit and cycle, right after SYNC was sent on the buses that have one.

Modbus TCP has a connection and a thread per unit, so that a silent unit delays nobody else; a serial line is shared,
so there one thread asks unit after unit, and a silent one is asked ever more rarely.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daq import wire
from daq.drivers.base import DeviceStatus, DriverContext, DriverStatistics, Samples, nothing
from daq.drivers.modbus_client import DEVICE_FAILURE, EXCEPTIONS, Answer, ModbusConnection
from daq.machine_file import Channel, ModbusRtuBus, ModbusSource, ModbusTcpBus
from daq.quality import Quality

NS = 1_000_000_000
BLOCK_REGISTERS = 125  # the most that one read may ask for (Modbus application protocol V1.1b3, 6.3)
BACK_OFF_S = (0.0, 0.0, 0.5, 1.0, 2.0, 5.0)  # after so many failures in a row
MISSES_TOLERATED = 3


@dataclass(frozen=True)
class Block:
    """Registers that one request reads, and where their channels are in it: (position, first register, source)."""

    table: str
    address: int
    count: int
    members: tuple[tuple[int, int, ModbusSource], ...]


def blocks(channels: Sequence[tuple[int, Channel]]) -> tuple[Block, ...]:
    """The fewest blocks that cover one unit's channels: one per table, more only if it spans over 125 registers."""
    found: list[Block] = []
    for table in ("holding", "input"):
        members = sorted(
            (
                (position, channel.source)
                for position, channel in channels
                if isinstance(channel.source, ModbusSource) and channel.source.table == table
            ),
            key=lambda member: member[1].register_,
        )
        group: list[tuple[int, ModbusSource]] = []
        for member in members:
            end = member[1].register_ + wire.registers(member[1].data_type)
            if group and end - group[0][1].register_ > BLOCK_REGISTERS:
                found.append(_block(table, group))
                group = []
            group.append(member)
        if group:
            found.append(_block(table, group))
    return tuple(found)


def _block(table: str, group: Sequence[tuple[int, ModbusSource]]) -> Block:
    start = group[0][1].register_
    end = max(source.register_ + wire.registers(source.data_type) for _, source in group)
    members = tuple((position, source.register_ - start, source) for position, source in group)
    return Block(table, start, end - start, members)


class Unit:
    """One Modbus unit: its blocks, its last answers, and how it is doing.

    Answers are kept by the polling thread and taken by the collecting one, both under the poller's lock.
    """

    def __init__(self, number: int, place: str, channels: Sequence[tuple[int, Channel]]) -> None:
        self.number = number
        self.place = place
        self.blocks = blocks(channels)
        self.positions = tuple(position for position, _ in channels)
        self.state, self.detail = "commissioning", ""
        self.failures = 0
        self.not_before_ns = 0
        self.cycle = -1  # of the answers
        self.taken = -1
        self.answers: tuple[Answer, ...] = ()
        self.sampled_ns = 0
        self.requests = self.timeouts = self.exceptions = 0

    def problem(self, answers: Sequence[Answer]) -> str | None:
        """One line about what is wrong with the answers, or None."""
        for block, answer in zip(self.blocks, answers, strict=False):
            registers = f"{block.table} registers {block.address} to {block.address + block.count - 1}"
            if answer.failure is not None:
                return f"{self.place}: {answer.failure} ({registers}); check its power, address and cable"
            if answer.exception is not None:
                meaning = EXCEPTIONS.get(answer.exception, "unknown")
                return f"{self.place}: exception {answer.exception} ({meaning}) for {registers}; see its manual"
        return None


class Poller:
    """A thread that reads the units of one connection once per cycle."""

    def __init__(self, connection: ModbusConnection, units: Sequence[Unit], context: DriverContext) -> None:
        self.units = tuple(units)
        self.connection = connection
        self.done = threading.Event()
        self.lock = threading.Lock()
        self._context = context
        self._go = threading.Event()
        self._stopping = False
        self._requested = -1
        self._sync_ns = 0
        self._thread: threading.Thread | None = None

    def start(self, name: str) -> None:
        """Start polling on :meth:`trigger`."""
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def trigger(self, cycle: int, now_ns: int) -> None:
        """Ask for a round of reads; a round that is still under way (a time-out) is not joined by a second one."""
        self._requested, self._sync_ns = cycle, now_ns
        self.done.clear()
        self._go.set()

    def patience(self) -> bool:
        """Whether its round is worth waiting for: some unit answered lately."""
        return any(unit.failures < MISSES_TOLERATED for unit in self.units)

    def _run(self) -> None:
        while True:
            self._go.wait()
            self._go.clear()
            if self._stopping:
                return
            cycle = self._requested
            for unit in self.units:
                if self._context.monotonic_ns() >= unit.not_before_ns:
                    self.poll(unit, cycle)
            if cycle == self._requested:
                self.done.set()

    def poll(self, unit: Unit, cycle: int) -> None:
        """Read all blocks of a unit and keep the answers."""
        before = self._context.monotonic_ns()
        answers: list[Answer] = []
        for block in unit.blocks:
            answers.append(self.connection.read(unit.number, block.table, block.address, block.count))
            if answers[-1].failure is not None:
                break  # its other blocks would time out as well
        after = self._context.monotonic_ns()
        failed = answers[-1].failure is not None
        problem = unit.problem(answers)
        with self.lock:
            if failed:
                unit.failures += 1
                pause = BACK_OFF_S[min(unit.failures, len(BACK_OFF_S) - 1)]
                unit.not_before_ns = after + round(pause * NS)
                unit.timeouts += 1
            else:
                unit.failures, unit.not_before_ns = 0, 0
                unit.answers, unit.cycle, unit.sampled_ns = tuple(answers), cycle, (before + after) // 2
            unit.requests += len(answers)
            unit.exceptions += sum(answer.exception is not None for answer in answers)
            unit.detail = problem or ""
            unit.state = "running" if problem is None else ("silent" if failed else "failed")

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
        grouped: dict[int, list[tuple[int, Channel]]] = {}
        for position, channel in enumerate(channels):
            assert isinstance(channel.source, ModbusSource)
            grouped.setdefault(channel.source.unit, []).append((position, channel))
        self._units = [
            Unit(
                number,
                f"bus '{bus.name}' unit {number} ({', '.join(c.name for _, c in members[:3])})",
                members,
            )
            for number, members in grouped.items()
        ]
        self._counts = dict.fromkeys(("missing", "late", "not_a_number"), 0)
        self._pollers: list[Poller] = []
        self._cycle = 0
        self._sync_ns = 0

    def _groups(self) -> list[list[Unit]]:
        """Units that share a connection."""
        raise NotImplementedError

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the samples."""
        return self._names

    def start(self) -> tuple[str, ...]:
        """Connect, and read every unit once."""
        problems = []
        for group in self._groups():
            connection = ModbusConnection(self._bus, self._timeout)
            poller = Poller(connection, group, self._context)
            self._pollers.append(poller)
            for unit in group:
                poller.poll(unit, -1)
                if unit.detail:
                    poller.poll(unit, -1)  # a first request may meet a gateway that is just opening its line
                if unit.detail:
                    problems.append(unit.detail)
        for number, poller in enumerate(self._pollers):
            poller.start(f"modbus-{self._bus.name}-{number}")
        return tuple(problems)

    def trigger(self, cycle: int) -> None:
        """Start a round of reads."""
        self._cycle, self._sync_ns = cycle, self._context.monotonic_ns()
        for poller in self._pollers:
            poller.trigger(cycle, self._sync_ns)

    def collect(self, until_ns: int) -> Samples:
        """Registers of this cycle, as soon as all units that are alive have answered."""
        samples = nothing(len(self._names))
        for poller in self._pollers:
            remaining = (until_ns - self._context.monotonic_ns()) / NS
            if remaining > 0 and poller.patience():
                poller.done.wait(remaining)
            with poller.lock:
                for unit in poller.units:
                    self._take(unit, samples)
        return samples

    def _take(self, unit: Unit, samples: Samples) -> None:
        ago = self._cycle - unit.cycle
        if unit.cycle < 0 or ago > 1 or unit.taken == unit.cycle:
            self._counts["missing"] += 1
            return
        self._counts["late"] += ago
        unit.taken = unit.cycle
        for block, answer in zip(unit.blocks, unit.answers, strict=False):
            for position, offset, source in block.members:
                samples.cycles_ago[position] = ago
                if answer.exception is not None:
                    failure = answer.exception == DEVICE_FAILURE
                    samples.quality[position] = Quality.EMERGENCY if failure else Quality.MISSING
                    continue
                words = list(answer.registers[offset : offset + wire.registers(source.data_type)])
                value = wire.from_registers(source.data_type, words, source.word_order)
                samples.after_sync_s[position] = (unit.sampled_ns - self._sync_ns) / NS if ago == 0 else 0.0
                if np.isfinite(value):
                    samples.raw[position] = value
                    samples.quality[position] = Quality.FRESH
                else:
                    self._counts["not_a_number"] += 1
                    samples.quality[position] = Quality.OUT_OF_RANGE

    def statistics(self) -> DriverStatistics:
        """State of every unit, and counters since the start."""
        devices = tuple(DeviceStatus(f"unit {u.number}", u.state, u.detail) for u in self._units)
        counts = {
            "requests": sum(unit.requests for unit in self._units),
            "timeouts": sum(unit.timeouts for unit in self._units),
            "exceptions": sum(unit.exceptions for unit in self._units),
            **self._counts,
        }
        return DriverStatistics(self._bus.name, devices, counts)

    def stop(self) -> None:
        """Close all connections."""
        pollers, self._pollers = self._pollers, []
        for poller in pollers:
            poller.stop()


class ModbusTcpDriver(_ModbusDriver):
    """Modbus TCP transmitters (see :class:`daq.drivers.base.Driver`); a connection per unit."""

    def _groups(self) -> list[list[Unit]]:
        return [[unit] for unit in self._units]


class ModbusRtuDriver(_ModbusDriver):
    """Modbus transmitters on a serial line (see :class:`daq.drivers.base.Driver`); the port is shared."""

    def _groups(self) -> list[list[Unit]]:
        return [self._units]
