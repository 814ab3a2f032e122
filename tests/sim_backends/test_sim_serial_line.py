"""Modbus units on a pseudo-terminal, and what goes wrong on their way: read by hilfit's own client."""

from __future__ import annotations

import asyncio
import os
import select
import threading
from collections.abc import Iterator

import pytest
from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerType
from pymodbus.simulator import DataType, SimData, SimDevice

from daq.drivers.modbus.client import ModbusConnection
from daq.machine.machine_file import ModbusRtuBus
from sim_backends.devices.modbus_devices import SerialLine, Wire

WORDS = [0x4048, 0xF5C3, 0x0001, 0xFFFF]


class Line:
    """Unit 7 on a line of its own, in a loop of its own."""

    def __init__(self) -> None:
        self.garbled = False
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self._thread.start()
        self.wire, self.line = asyncio.run_coroutine_threadsafe(self._make(), self.loop).result(10)

    async def _make(self) -> tuple[Wire, SerialLine]:
        async def access(
            function: int, start: int, address: int, count: int, registers: list[int], written: object
        ) -> ExcCodes | None:
            registers[: len(WORDS)] = WORDS
            return None

        data = SimData(0, count=len(WORDS), values=0, datatype=DataType.REGISTERS)
        wire = Wire([SimDevice(id=7, simdata=[data], action=access)], lambda unit: self.garbled, FramerType.RTU)
        return wire, SerialLine(wire, 115200)

    def close(self) -> None:
        self.loop.call_soon_threadsafe(self.line.close)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join(10)
        self.loop.close()


@pytest.fixture(scope="module")
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.close()


def connected(line: Line, timeout_s: float) -> ModbusConnection:
    return ModbusConnection(ModbusRtuBus(name="line", type="modbus_rtu", port=line.line.port, parity="N"), timeout_s)


@pytest.fixture
def connection(line: Line) -> Iterator[ModbusConnection]:
    opened = connected(line, 30.0)  # longer than a busy computer keeps the line's thread from running
    yield opened
    line.garbled, line.wire.slow = False, 0.0
    opened.close()


def test_the_line_is_a_terminal_and_its_units_answer(line: Line, connection: ModbusConnection) -> None:
    assert os.path.exists(line.line.port)  # noqa: PTH110 (a device, not a file of ours)
    assert connection.read(7, "holding", 0, 4).registers == tuple(WORDS)
    assert connection.read(7, "holding", 1, 2).registers == tuple(WORDS[1:3])


def test_an_answer_in_pieces_is_the_same_answer(line: Line, connection: ModbusConnection) -> None:
    line.wire.slow = 0.05
    assert connection.read(7, "holding", 0, 4).registers == tuple(WORDS)


def test_pieces_that_are_late_do_not_overtake_each_other(line: Line) -> None:
    """On a busy computer two pieces of an answer are sent in one turn of the loop; the shorter one is the last."""
    port = os.open(line.line.port, os.O_RDWR | os.O_NOCTTY)
    try:
        line.loop.call_soon_threadsafe(lambda: [line.line.write(part) for part in (b"0123456789", b"ab", b"c")])
        came = b""
        while len(came) < 13:
            assert select.select([port], [], [], 30)[0], came
            came += os.read(port, 64)
    finally:
        os.close(port)
    assert came == b"0123456789abc"


def test_a_garbled_answer_is_none_and_a_whole_one_after_it_is_taken(line: Line) -> None:
    connection = connected(line, 0.3)  # is sat out where an answer is garbled
    try:
        line.garbled = True
        assert not connection.read(7, "holding", 0, 4).good
        line.garbled = False
        answers = (connection.read(7, "holding", 0, 4) for _ in range(100))
        assert next(answer for answer in answers if answer.good).registers == tuple(WORDS)
    finally:
        line.garbled = False
        connection.close()
