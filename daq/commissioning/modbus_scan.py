"""Which Modbus units answer, in a range that somebody gave: each unit is asked once, and nothing is written.

A unit that says that it has no such register is there; a gateway that says that nobody answers behind it is not the
unit.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from daq.drivers.modbus.client import DEVICE_FAILURE, EXCEPTIONS, GATEWAY_EXCEPTIONS, ModbusConnection
from daq.errors import InputError
from daq.machine.machine_file import ModbusRtuBus, ModbusTcpBus

TIMEOUT_S = 0.3
BLOCK = 60  # registers of one question


@dataclass(frozen=True)
class FoundUnit:
    """A unit that answers.

    Attributes
    ----------
    unit : its number
    milliseconds : that its first answer took
    answer : what it was
    identity : vendor, product and revision, as far as it tells them (function 43, 14)
    registers : by table, number and content of those that were asked for and are there
    """

    unit: int
    milliseconds: float
    answer: str
    identity: tuple[str, ...] = ()
    registers: dict[str, dict[int, int]] = field(default_factory=dict)
    failing: bool = False  # it says that it is broken, which gateways also say of units that are not there


@dataclass(frozen=True)
class ModbusScan:
    """Findings of a scan of a Modbus bus, and lines about them."""

    bus: dict[str, Any]
    units_asked: tuple[int, ...]
    units: tuple[FoundUnit, ...]
    notes: tuple[str, ...]


def scan_modbus(bus: ModbusTcpBus | ModbusRtuBus, units: Sequence[int], registers: range | None = None) -> ModbusScan:
    """Ask units one after another.

    Parameters
    ----------
    units : numbers to ask
    registers : that are read from those which answer; None: only the first one, to see whether they do

    Raises
    ------
    BusError
        If the other end or the port is not there.
    """
    connection = ModbusConnection(bus, max(TIMEOUT_S, bus.timeout_s))
    try:
        connection.open()
        answered = [unit for number in units if (unit := _unit(connection, number, registers)) is not None]
    finally:
        connection.close()
    found = [unit for unit in answered if not unit.failing]
    failing = [str(unit.unit) for unit in answered if unit.failing]
    notes = [] if answered else [f"bus '{bus.name}': no unit answers; check units, cable, baudrate and parity"]
    if failing:
        notes.append(
            f"bus '{bus.name}': for units {', '.join(failing)} comes 'device failure' (exception 4): they are broken, "
            "or a gateway says so of units that it does not have"
        )
    described = bus.model_dump(mode="json", exclude_unset=True)
    return ModbusScan(described, tuple(units), tuple(found), tuple(notes))


def _unit(connection: ModbusConnection, number: int, registers: range | None) -> FoundUnit | None:
    first = 0 if registers is None else registers.start
    began = time.monotonic()
    answer = connection.read(number, "holding", first, 1)
    took = 1e3 * (time.monotonic() - began)
    if answer.failure is not None or answer.exception in GATEWAY_EXCEPTIONS:
        return None
    if answer.exception is None:
        reply = f"holding register {first}: {answer.registers[0]}"
    else:
        reply = f"exception {answer.exception} ({EXCEPTIONS.get(answer.exception, 'unknown')})"
    held = {}
    if registers is not None:
        read = {table: _registers(connection, number, table, registers) for table in ("holding", "input")}
        held = {table: own for table, own in read.items() if own}
    identity = tuple(connection.identity(number).values())
    return FoundUnit(number, took, reply, identity, held, answer.exception == DEVICE_FAILURE)


def _registers(connection: ModbusConnection, number: int, table: str, wanted: range) -> dict[int, int]:
    """Read the registers that exist: blocks, or the halves of one that is refused."""
    found: dict[int, int] = {}
    todo = [wanted[start : start + BLOCK] for start in range(0, len(wanted), BLOCK)]
    while todo:
        block = todo.pop()
        answer = connection.read(number, table, block.start, len(block))
        if answer.good:
            found.update(zip(block, answer.registers, strict=True))
        elif answer.exception == 2 and len(block) > 1:
            half = len(block) // 2
            todo += [block[:half], block[half:]]
    return dict(sorted(found.items()))


def span(text: str, what: str, low: int, high: int) -> list[int]:
    """Parse the numbers of ``1-8,12`` (InputError, in one line, if it is none of that)."""
    numbers: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise InputError("daq.span_not_numbers", text=text, what=what)
        numbers.update(range(int(first), int(last or first) + 1))
    if not numbers or min(numbers) < low or max(numbers) > high:
        raise InputError("daq.span_beyond", text=text, what=what, low=low, high=high)
    return sorted(numbers)
