"""Modbus: an answer belongs to its own request and its own cycle, and one dead thing costs only itself."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from bench_machines import modbus, modbus_serial
from modbus_test_serial import FakeSerialModbus, crc
from modbus_test_server import FakeModbus, bench_registers, float_registers

from daq import Machine, MachineFileError, Quality, parse_machine
from daq.drivers import DriverContext
from daq.drivers.base import Problem
from daq.drivers.modbus.client import Answer, ModbusConnection
from daq.drivers.modbus.driver import ModbusTcpDriver, Poller
from daq.drivers.modbus.unit import Unit, blocks
from daq.drivers.wire import from_registers
from daq.machine.machine_file import ModbusRtuBus, ModbusTcpBus

NS = 1_000_000_000
PATIENCE_S = 30.0  # longer than a busy computer keeps a thread from running
ANGLE, HEAD, ROD = 0, 1, 2


@pytest.fixture
def line() -> Iterator[FakeSerialModbus]:
    made = FakeSerialModbus(bench_registers())
    yield made
    made.close()


def driver_of(machine: Machine, start_s: float | None = None) -> ModbusTcpDriver:
    context = DriverContext(0.02, 0.0, time.monotonic_ns, start_s=start_s)
    return ModbusTcpDriver(machine.buses[0], machine.channels, context)  # type: ignore[arg-type]


def serial(line: FakeSerialModbus, timeout_s: float = 0.2) -> ModbusConnection:
    """A busy computer may exceed the time-out: what one request brings is not asserted, but what comes in the end."""
    bus = parse_machine(modbus_serial(line.port)).buses[0]
    assert isinstance(bus, ModbusRtuBus)
    return ModbusConnection(bus, timeout_s)


# Answers and requests


@pytest.mark.parametrize("function", [1, 4, 6])
def test_an_answer_to_another_function_is_refused(server: FakeModbus, function: int) -> None:
    driver = driver_of(parse_machine(modbus(server.port)))
    try:
        driver.start()
        server.function = function
        driver.trigger(0)
        driver.trigger(1)
        samples = driver.collect(time.monotonic_ns() + 30 * NS)
        assert not np.any(samples.quality == Quality.FRESH)
        for cycle in range(2, 100):
            driver.trigger(cycle)
            driver.collect(time.monotonic_ns() + 2 * NS)
            if driver.statistics().counts["timeouts"] >= 2:
                break
        assert any("function" in d.detail or "answer" in d.detail for d in driver.statistics().devices)
    finally:
        driver.stop()


def test_the_wrong_function_is_named(server: FakeModbus) -> None:
    bus = parse_machine(modbus(server.port)).buses[0]
    assert isinstance(bus, ModbusTcpBus)
    connection = ModbusConnection(bus, PATIENCE_S)
    server.function = 4
    assert connection.read(1, "holding", 2, 2).failure == "answers with function 4 instead of 3"
    server.function = None
    assert connection.read(1, "holding", 2, 2).good
    connection.close()


def value(connection: ModbusConnection, count: int = 2) -> int | None:
    """The first register of unit 1, or None where there is no answer."""
    answer = connection.read(1, "holding", 2, count)
    return answer.registers[0] if answer.good else None


def answered(connection: ModbusConnection, count: int = 2) -> int:
    """The first answer of a unit that is asked until there is one."""
    for _ in range(300):
        if (found := value(connection, count)) is not None:
            return found
    raise AssertionError("300 requests brought nothing")


@pytest.mark.parametrize("count", [1, 2, 6])
def test_a_late_answer_is_never_taken_for_the_next_one(line: FakeSerialModbus, count: int) -> None:
    """It comes just when the next request is under way: the same unit, the same function, the same length."""
    connection = serial(line)
    try:
        assert answered(connection, count) == line.units[1][2]
        line.hold = 1
        assert value(connection, count) is None
        line.units[1][2] = 0x1234
        assert [answered(connection, count) for _ in range(4)] == [0x1234] * 4
    finally:
        connection.close()


def test_two_late_answers_are_never_taken_for_the_next_ones(line: FakeSerialModbus) -> None:
    connection = serial(line)
    try:
        assert answered(connection, 6) == line.units[1][2]
        line.hold = 3
        for number in range(8):
            line.units[1][2] = number
            assert value(connection, 6) in (None, number)
        assert answered(connection, 6) == 7
    finally:
        connection.close()


def test_an_answer_after_the_time_out_is_dropped_before_the_next_request(line: FakeSerialModbus) -> None:
    connection = serial(line)
    try:
        assert answered(connection) == line.units[1][2]
        line.hold = 1
        assert value(connection) is None
        line.let_go()  # nobody waits for it any more
        line.units[1][2] = 0x1234
        assert answered(connection) == 0x1234
    finally:
        connection.close()


def test_the_silent_interval_is_kept(line: FakeSerialModbus, monkeypatch: pytest.MonkeyPatch) -> None:
    connection = serial(line, PATIENCE_S)
    try:
        value(connection)
        assert connection._silence == pytest.approx(max(3.5 * 11 / 115200, 0.00175))
        slept: list[float] = []
        monkeypatch.setattr("daq.drivers.modbus.client.time", Clock(connection._spoke + 0.0005, slept))
        value(connection)
        assert slept[0] == pytest.approx(0.00125)
    finally:
        connection.close()


class Clock:
    """The time module as the client sees it, standing still."""

    def __init__(self, now: float, slept: list[float]) -> None:
        self.now, self.slept = now, slept

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)


# Who a unit is


def objects_of(driver: ModbusTcpDriver) -> dict[str, dict[str, object]]:
    return {device.name: dict(device.objects) for device in driver.statistics().devices}


def test_a_unit_that_tells_its_identity_is_named_and_one_that_refuses_is_not(server: FakeModbus) -> None:
    server.identities[1] = {0: b"ACME", 1: b"PT-40\0\0", 2: b"V2.1\n"}
    driver = driver_of(parse_machine(modbus(server.port)))
    try:
        assert driver.start() == ()
        assert objects_of(driver) == {
            "unit 1": {"vendor": "ACME", "product": "PT-40", "revision": "V2.1"}, "unit 2": {},
        }  # fmt: skip
        for cycle in range(5):
            driver.trigger(cycle)
            driver.collect(time.monotonic_ns() + 10 * NS)
        assert sorted(server.asked_identity) == [1, 2], "each is asked once"
    finally:
        driver.stop()


def test_no_unit_is_asked_its_identity_when_the_time_for_starting_is_over(server: FakeModbus) -> None:
    machine = parse_machine(modbus(server.port, timeout_s=5.0).replace("timeout_s", "connections: shared, timeout_s"))
    driver = driver_of(machine, start_s=1.0)  # a time-out is longer
    try:
        driver.start()
        for cycle in range(5):
            driver.trigger(cycle)
            driver.collect(time.monotonic_ns() + 10 * NS)
        assert server.asked_identity == [], "others wait for the same connection"
    finally:
        driver.stop()


@pytest.mark.slow
def test_a_unit_that_comes_back_is_asked_again_what_it_is(server: FakeModbus) -> None:
    server.identities[2] = {0: b"ACME", 1: b"PT-40"}
    driver = driver_of(parse_machine(modbus(server.port, timeout_s=2.0)))
    try:
        assert driver.start() == ()
        server.silent.add(2)
        cycle, deadline = 0, time.monotonic() + PATIENCE_S

        def cycles_until(wanted: object) -> None:
            nonlocal cycle
            while time.monotonic() < deadline:
                driver.trigger(cycle)
                driver.collect(time.monotonic_ns() + NS // 50)
                cycle += 1
                if wanted():  # type: ignore[operator]
                    return
            raise AssertionError("waited in vain")

        cycles_until(lambda: driver._units[1].failures >= 3)
        server.identities[2] = {0: b"ACME", 1: b"PT-60"}
        server.silent.clear()
        cycles_until(lambda: objects_of(driver)["unit 2"].get("product") == "PT-60")
    finally:
        driver.stop()


# A unit that is slower than the cycle


def test_a_slow_unit_gives_its_values_at_its_own_rate_with_their_age(server: FakeModbus) -> None:
    driver = driver_of(parse_machine(modbus(server.port, timeout_s=5.0)))
    gate = server.gates[1] = threading.Semaphore(2)
    try:
        assert driver.start() == ()
        block = driver._units[0].blocks[0]
        while gate.acquire(blocking=False):
            pass
        cycle = 0
        driver.trigger(cycle)
        asked_at_start = sum(unit == 1 for unit, *_ in server.requests)
        for number in range(12):
            with server.asked:  # the request of this cycle is with the unit
                assert server.asked.wait_for(
                    lambda n=number: sum(unit == 1 for unit, *_ in server.requests) > asked_at_start + n, timeout=30
                )
            for _ in range(3):  # three more cycles begin before it answers: 60 ms at 50 Hz
                assert driver.collect(0).quality[HEAD] == Quality.MISSING
                cycle += 1
                driver.trigger(cycle)
            asked = block.asked
            gate.release()
            deadline = time.monotonic() + 30
            while block.asked == asked:
                assert time.monotonic() < deadline
                time.sleep(0.001)
            samples = driver.collect(0)
            assert samples.raw[HEAD] == 50.0
            assert samples.cycles_ago[HEAD] >= 3  # so that the frame says late, whatever it is called here
            assert samples.after_sync_s[HEAD] > 0  # sampled after the SYNC of the cycle in which it was asked
            server.units[1].update(float_registers({2: 50.0}))
        assert samples.interval is not None and samples.interval[HEAD] >= 3
        unit = driver.statistics().devices[0]
        assert unit.state == "running" and "marked late" in unit.detail and "instead of 50" in unit.detail
        assert driver.statistics().counts["slow_units"] >= 1
        assert not driver._pollers[0].patience()  # the frame does not wait for it
    finally:
        gate.release(1000)
        driver.stop()


def with_source(text: str, old: str, new: str) -> Machine:
    assert old in text
    return parse_machine(text.replace(old, new))


def test_a_slow_channel_is_asked_at_its_own_rate(server: FakeModbus) -> None:
    machine = with_source(
        modbus(server.port, timeout_s=5.0), "unit: 2, register: 4", "unit: 2, rate_hz: 5, register: 4"
    )
    driver = driver_of(machine)
    try:
        assert driver.start() == ()
        server.requests.clear()
        found = []
        for cycle in range(40):
            driver.trigger(cycle)
            samples = driver.collect(time.monotonic_ns() + 10 * NS)
            found.append(int(samples.quality[ROD]))
            assert samples.interval is not None and samples.interval[ROD] == 10.0
            assert samples.quality[HEAD] == Quality.FRESH
        assert sum(unit == 2 for unit, *_ in server.requests) == found.count(Quality.FRESH) in (4, 5)
        assert driver.statistics().counts["missing"] == 0
    finally:
        driver.stop()


# One dead thing costs only itself


def test_a_gap_in_the_register_map_costs_only_what_is_in_it(server: FakeModbus) -> None:
    del server.units[1][4], server.units[1][5]  # between the two channels
    driver = driver_of(parse_machine(modbus(server.port)))
    try:
        assert driver.start() == ()
        driver.trigger(0)
        samples = driver.collect(time.monotonic_ns() + 30 * NS)
        assert samples.quality.tolist() == [Quality.FRESH] * 3
    finally:
        driver.stop()


def test_a_register_that_is_not_there_costs_only_its_channel(server: FakeModbus) -> None:
    del server.units[1][6]
    driver = driver_of(parse_machine(modbus(server.port)))
    try:
        (problem,) = driver.start()
        assert isinstance(problem, Problem) and problem.channels == ("j1.angle",)
        driver.trigger(0)
        samples = driver.collect(time.monotonic_ns() + 30 * NS)
        assert samples.quality.tolist() == [Quality.MISSING, Quality.FRESH, Quality.FRESH]
        assert driver.statistics().devices[0].state == "running"
    finally:
        driver.stop()


def test_the_maximum_gap_is_the_machine_files(server: FakeModbus) -> None:
    machine = with_source(modbus(502), "port: 502", "port: 502, maximum_gap: 1")
    bus = machine.buses[0]
    assert isinstance(bus, ModbusTcpBus)
    of_unit_1 = [(0, machine.channels[0]), (1, machine.channels[1])]
    assert [(b.address, b.count) for b in blocks(of_unit_1, bus.maximum_gap)] == [(2, 2), (6, 2)]
    assert [(b.address, b.count) for b in blocks(of_unit_1, 2)] == [(2, 6)]
    with pytest.raises(MachineFileError, match="maximum_gap"):
        with_source(modbus(502), "port: 502", "port: 502, maximum_gap: 126")


def test_a_gateway_with_one_connection_serves_all_units() -> None:
    server = FakeModbus(bench_registers(), one_at_a_time=True)
    machine = with_source(modbus(server.port), "type: modbus_tcp", "type: modbus_tcp, connections: shared")
    driver = driver_of(machine)
    try:
        assert driver.start() == ()
        driver.trigger(0)
        samples = driver.collect(time.monotonic_ns() + 30 * NS)
        assert samples.quality.tolist() == [Quality.FRESH] * 3
        assert server.refused == 0
    finally:
        driver.stop()
        server.close()


class Line:
    """A line on which only unit 1 answers, within 5 ms; time passes by what is asked and by :meth:`wait`."""

    def __init__(self) -> None:
        self.now_ns = 1_000 * NS
        self.timeout_s = 0.05
        self.asked: list[int] = []

    def read(self, unit: int, table: str, address: int, count: int) -> Answer:
        self.asked.append(unit)
        self.wait(0.005 if unit == 1 else self.timeout_s)
        return Answer(registers=(0,) * count) if unit == 1 else Answer(failure="does not answer in time")

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS)

    def close(self) -> None:
        pass


def test_silent_units_do_not_eat_up_a_shared_line() -> None:
    """Of twelve units on one connection eleven are dead; the living one is asked before them, and they now and then."""
    line = Line()
    channels = parse_machine(modbus(502)).channels
    dead = [Unit(number, f"unit {number}", f"mb/{number}", [(2, channels[2])], 125) for number in range(2, 13)]
    units = [*dead, Unit(1, "unit 1", "mb/1", [(0, channels[0]), (1, channels[1])], 125)]
    poller = Poller(line, units, DriverContext(0.02, 0.0, lambda: line.now_ns))  # type: ignore[arg-type]
    poller.start("line")
    try:
        cycles: list[list[int]] = []
        for cycle in range(400):
            began, before = line.now_ns, len(line.asked)
            poller.trigger(cycle, line.now_ns)
            assert poller.done.wait(PATIENCE_S)
            cycles.append(line.asked[before:])
            line.wait(max(0.0, 0.02 - (line.now_ns - began) / NS))
    finally:
        poller.stop()
    steady = cycles[-200:]  # all are known to be dead by now
    assert all(asked[0] == 1 and len(asked) <= 2 for asked in steady)  # the living first, one of the dead after it
    lost_s = line.timeout_s * sum(len(asked) - 1 for asked in steady)
    assert 0 < lost_s < 0.12 * 200 * 0.02  # a tenth of the time, and what a cycle more or less makes of it


def test_a_start_does_not_wait_for_the_dead(server: FakeModbus) -> None:
    server.silent.add(2)
    driver = driver_of(parse_machine(modbus(server.port, timeout_s=5.0)), start_s=0.1)
    try:
        problems = driver.start()
        # It did not sit out the time-out: then it would say that the unit does not answer.
        assert "unit 2" in problems[-1] and "has not answered yet" in problems[-1]
        deadline = time.monotonic() + 60
        cycle = 0
        while driver.collect(0).quality[HEAD] != Quality.FRESH:
            driver.trigger(cycle := cycle + 1)
            assert time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        server.close()
        driver.stop()


@pytest.mark.slow
def test_a_device_keeps_its_last_cause_when_it_is_back(server: FakeModbus) -> None:
    driver = driver_of(parse_machine(modbus(server.port, timeout_s=2.0)))
    try:
        driver.start()
        server.silent.add(2)
        cycle = 0
        while driver.statistics().devices[1].state == "running":
            driver.trigger(cycle := cycle + 1)
            driver.collect(time.monotonic_ns() + NS)
            assert cycle < 500
        server.silent.clear()
        while driver.statistics().devices[1].state != "running":
            driver.trigger(cycle := cycle + 1)
            driver.collect(time.monotonic_ns() + NS // 10)
            time.sleep(0.005)
            assert cycle < 5000
        assert "does not answer in time" in driver.statistics().devices[1].detail
        assert "it was away for" in driver.statistics().devices[1].detail
        (event,) = driver._context.events.published()
        assert (event["device"], event["what"], event["seconds"] > 0) == ("mb/unit 2", "silent", True)
    finally:
        driver.stop()


# Layouts


def test_bytes_and_words_may_be_swapped() -> None:
    big = list(struct.unpack(">HH", struct.pack(">f", 12.5)))
    swapped = list(struct.unpack("<HH", struct.pack(">f", 12.5)))
    assert from_registers("float32", big) == 12.5
    assert from_registers("float32", big[::-1], "little") == 12.5
    assert from_registers("float32", swapped, "big", "little") == 12.5
    assert from_registers("float32", swapped[::-1], "little", "little") == 12.5
    machine = with_source(modbus(502), "data_type: int16", "byte_order: little, data_type: int16")
    assert machine.channels[2].source.byte_order == "little"  # type: ignore[union-attr]


def test_unit_255_is_the_tcp_device_itself() -> None:
    server = FakeModbus({1: bench_registers()[1], 255: {4: 215}})
    driver = driver_of(with_source(modbus(server.port), "unit: 2", "unit: 255"))
    try:
        assert driver.start() == ()
    finally:
        driver.stop()
        server.close()


def test_serial_frames_over_tcp() -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    units = bench_registers()

    def serve() -> None:
        connection, _ = listener.accept()
        with connection:
            while start := connection.recv(2, socket.MSG_WAITALL):
                if start[1] == 0x2B:  # who it is: an unknown function
                    connection.recv(5, socket.MSG_WAITALL)
                    refusal = bytes((start[0], 0xAB, 1))
                    connection.sendall(refusal + crc(refusal))
                    continue
                request = start + connection.recv(6, socket.MSG_WAITALL)
                unit, function, address, count = struct.unpack_from(">BBHH", request)
                assert crc(request[:6]) == request[6:]
                words = [units[unit][address + i] for i in range(count)]
                body = struct.pack(f">BBB{count}H", unit, function, 2 * count, *words)
                connection.sendall(body + crc(body))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    text = modbus(listener.getsockname()[1])
    driver = driver_of(with_source(text, "type: modbus_tcp", "type: modbus_tcp, framing: rtu, connections: shared"))
    try:
        assert driver.start() == ()
        driver.trigger(0)
        samples = driver.collect(time.monotonic_ns() + 30 * NS)
        np.testing.assert_allclose(samples.raw, [0.3, 50.0, 215.0], rtol=1e-6)
    finally:
        driver.stop()
        thread.join(10)
        listener.close()
