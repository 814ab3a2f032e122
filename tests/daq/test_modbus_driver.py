"""The Modbus drivers against servers that answer, refuse, fall silent, and come back."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from bench_machines import modbus, modbus_serial
from modbus_test_serial import FakeSerialModbus, crc
from modbus_test_server import FakeModbus, bench_registers, float_registers
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from daq import Machine, Quality, parse_machine
from daq.drivers import Driver, DriverContext, Samples, make_driver
from daq.drivers.modbus.unit import BLOCK_REGISTERS, blocks
from daq.frames.channels import channels_by_bus

PERIOD = 0.02
#: A cycle waits this long for what is due, at most as long as the unit's own time-out: longer than a busy computer
#: keeps a server's thread from running.
PATIENCE = 20.0
#: Time-out of units that do not answer. A busy computer may exceed it, so nothing is asserted of one cycle.
SILENT_S = 0.5
NS = 1_000_000_000
ANGLE, HEAD, ROD = 0, 1, 2


class Run:
    """Cycles of a driver."""

    def __init__(self, machine: Machine, period: float = PERIOD, *, patience: float = 0.0) -> None:
        self.driver: Driver = make_driver(
            machine.buses[0], machine.channels, DriverContext(period, patience, time.monotonic_ns)
        )
        self.period = period
        self.cycle = 0

    def once(self) -> Samples:
        start = time.monotonic_ns()
        self.driver.trigger(self.cycle)
        samples = self.driver.collect(start + round(PATIENCE * NS))
        self.took_s = (time.monotonic_ns() - start) / NS
        self.cycle += 1
        time.sleep(max(0.0, self.period - (time.monotonic_ns() - start) / NS))
        return samples

    def until(self, done: Callable[[Samples], bool], cycles: int = 500) -> Samples:
        for _ in range(cycles):
            samples = self.once()
            if done(samples):
                return samples
        raise AssertionError(f"not within {cycles} cycles; {self.driver.statistics()}")


def fresh(samples: Samples) -> bool:
    return bool(np.all(samples.quality == Quality.FRESH))


@pytest.fixture
def run(server: FakeModbus) -> Iterator[Run]:
    made = Run(parse_machine(modbus(server.port)))
    yield made
    made.driver.stop()


def test_a_valves_command_is_read_and_nothing_ever_writes_it(server: FakeModbus) -> None:
    text = modbus(server.port).replace("name: j1.head, quantity: head_pressure", "name: j1.command, quantity: command")
    text = text.replace("unit: bar,\n    source: {bus: mb, unit: 1", "unit: mA,\n    source: {bus: mb, unit: 1")
    valve = "stroke: 0.3, valve: {unit: mA, range: [0, 100], neutral: 50},"
    run = Run(
        parse_machine(
            text.replace("quantity: rod_pressure, joint: j1", "quantity: supply_pressure").replace(
                "stroke: 0.3,", valve
            )
        )
    )
    try:
        run.driver.start()
        run.until(fresh)
    finally:
        run.driver.stop()
    assert {function for _, function, _, _ in server.requests} <= {1, 2, 3, 4, 0x2B}, (
        "reading, by every function there is"
    )


def test_one_block_per_unit_and_cycle(server: FakeModbus, run: Run) -> None:
    assert run.driver.start() == ()
    run.until(fresh)
    server.requests.clear()
    before = run.cycle
    samples = [run.once() for _ in range(10)]
    assert any(fresh(s) for s in samples)
    asked = [request for request in server.requests if request[0] == 1]
    assert set(server.requests) == {(1, 3, 2, 6), (2, 3, 4, 1)}
    assert len(asked) <= run.cycle - before


def test_values_and_their_instant(run: Run) -> None:
    run.driver.start()
    samples = run.until(lambda s: fresh(s) and not s.cycles_ago.any())
    np.testing.assert_allclose(samples.raw, [0.3, 50.0, 215.0], rtol=1e-7)
    assert np.all((samples.after_sync_s > 0) & (samples.after_sync_s < run.took_s))
    assert not run.driver.leads


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_an_error_of_the_channel(server: FakeModbus, run: Run, value: float) -> None:
    run.driver.start()
    server.units[1].update(float_registers({2: value}))
    samples = run.until(lambda s: s.quality[HEAD] == Quality.INVALID)
    assert np.isnan(samples.raw[HEAD])
    assert run.driver.statistics().counts["not_a_number"] >= 1
    assert run.until(lambda s: s.quality[ANGLE] == Quality.FRESH).quality[HEAD] == Quality.INVALID


def test_device_failure_is_emergency_and_other_exceptions_are_missing(server: FakeModbus, run: Run) -> None:
    run.driver.start()
    server.exceptions[1] = 4  # device failure
    samples = run.until(lambda s: s.quality[HEAD] == Quality.EMERGENCY)
    assert np.isnan(samples.raw[HEAD])
    server.exceptions[1] = 6  # busy
    samples = run.until(lambda s: s.quality[HEAD] == Quality.MISSING)
    details = [d.detail for d in run.driver.statistics().devices]
    assert any("exception 6 (device busy)" in detail for detail in details)
    server.exceptions.clear()
    run.until(fresh)


@pytest.mark.slow
def test_a_silent_unit_costs_only_itself(server: FakeModbus) -> None:
    run = Run(parse_machine(modbus(server.port, timeout_s=SILENT_S)))
    try:
        run.driver.start()
        run.until(fresh)
        server.silent.add(2)
        run.until(lambda s: s.quality[ROD] == Quality.MISSING)
        run.until(lambda s: run.driver.statistics().counts["timeouts"] >= 3)
        for _ in range(40):
            samples = run.until(lambda s: s.quality[HEAD] == Quality.FRESH)
            assert samples.quality[ROD] != Quality.FRESH
        asked = sum(request[0] == 2 for request in server.requests[-60:])
        assert asked <= 10  # backs off instead of asking every cycle
        server.silent.clear()
        run.until(fresh)
    finally:
        run.driver.stop()


def test_an_answer_of_the_wrong_length_is_not_used(server: FakeModbus, run: Run) -> None:
    run.driver.start()
    run.until(fresh)
    server.short.add(1)
    samples = run.until(lambda s: s.quality[HEAD] == Quality.MISSING)
    assert np.isnan(samples.raw[HEAD])


def test_a_server_that_goes_away_and_comes_back(server: FakeModbus, run: Run) -> None:
    run.driver.start()
    run.until(fresh)
    port = server.port
    server.close()
    run.until(lambda s: bool(np.all(s.quality == Quality.MISSING)))
    again = FakeModbus(bench_registers(), fixed_port=port)
    try:
        run.until(fresh)
    finally:
        again.close()


@pytest.mark.slow
def test_problems_at_the_start_are_named(server: FakeModbus) -> None:
    server.silent.add(2)
    del server.units[1][6]
    driver = Run(parse_machine(modbus(server.port, timeout_s=1.0))).driver
    problems = driver.start()
    driver.stop()
    assert len(problems) == 2
    assert "unit 1 (j1.angle, j1.head)" in problems[0]
    assert "exception 2 (illegal register address) for holding registers 6 to 7" in problems[0]
    assert "unit 2 (j1.rod)" in problems[1] and "does not answer in time" in problems[1]


def test_no_device_answers_at_the_start(server: FakeModbus) -> None:
    port = server.port
    server.close()
    run = Run(parse_machine(modbus(port)))
    try:
        problems = run.driver.start()
        assert len(problems) == 2 and "cannot be reached" in problems[0]
        assert np.all(run.once().quality == Quality.MISSING)
    finally:
        run.driver.stop()


def test_against_pymodbus_own_server() -> None:
    loop = asyncio.new_event_loop()
    ready = threading.Event()
    found: list[ModbusTcpServer] = []

    async def serve() -> None:
        devices = [
            SimDevice(1, [SimData(2, values=[50.0, 0.0, 0.3], datatype=DataType.FLOAT32)]),
            SimDevice(2, [SimData(4, values=[215], datatype=DataType.INT16)]),
        ]
        server = ModbusTcpServer(devices, address=("127.0.0.1", 0))
        await server.listen()
        found.append(server)
        ready.set()
        await server.serving

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()), daemon=True)
    thread.start()
    assert ready.wait(10)
    port = found[0].transport.sockets[0].getsockname()[1]
    run = Run(parse_machine(modbus(port)))
    try:
        assert run.driver.start() == ()
        np.testing.assert_allclose(run.until(fresh).raw, [0.3, 50.0, 215.0], rtol=1e-6)
    finally:
        run.driver.stop()
        asyncio.run_coroutine_threadsafe(found[0].shutdown(), loop).result(10)
        thread.join(10)
        loop.close()


@pytest.mark.slow
def test_a_serial_line_survives_a_silent_unit() -> None:
    line = FakeSerialModbus(bench_registers())
    run = Run(parse_machine(modbus_serial(line.port)), period=0.05)
    try:
        run.driver.start()
        run.until(fresh)
        line.silent.add(2)
        run.until(lambda s: s.quality[ROD] == Quality.MISSING)
        # It is asked ever more rarely, so that the other unit has the line again.
        run.until(lambda s: s.quality[HEAD] == Quality.FRESH and run.driver.statistics().counts["timeouts"] >= 4)
        line.silent.clear()
        run.until(fresh)
    finally:
        run.driver.stop()
        line.close()


def test_the_checksum_of_the_test_line() -> None:
    # Modbus over serial line V1.02, appendix B: slave 02, function 07 gives 41 12.
    assert crc(b"\x02\x07") == b"\x41\x12"


def members(text: str) -> list[tuple[int, object]]:
    machine = parse_machine(text)
    return list(enumerate(channels_by_bus(machine)["mb"]))


def test_blocks_cover_what_is_needed() -> None:
    text = modbus(502).replace("unit: 2, register: 4", "unit: 1, register: 400")
    text = text.replace("register: 2, data_type", "register: 2, table: input, data_type")
    found = [(b.table, b.address, b.count) for b in blocks(members(text))]  # type: ignore[arg-type]
    assert found == [("holding", 6, 2), ("holding", 400, 1), ("input", 2, 2)]
    assert BLOCK_REGISTERS < 400 - 6


@pytest.mark.parametrize("patience", [0.0, 5.0])
def test_in_lockstep_a_slow_answer_is_waited_for(server: FakeModbus, patience: float) -> None:
    server.delay_s = 0.15  # three time-outs of the machine file
    run = Run(parse_machine(modbus(server.port, timeout_s=0.05)), patience=patience)
    try:
        assert (run.driver.start() == ()) is (patience > 0)
    finally:
        run.driver.stop()
