"""Numbers that are more than a number: encoders that wrap, bits of a word, decimals that the device tells itself.

Raw values are worked out by hand; the simulated devices encode by code of their own.
"""

from __future__ import annotations

import struct
import time
from functools import cache

import numpy as np
import pytest
from bench_machines import can, modbus
from canopen_test_bench import Bench
from hypothesis import given
from hypothesis import strategies as st
from modbus_test_server import FakeModbus

from daq import Machine, MachineFileError, Quality, parse_machine
from daq.acquisition.assembly import Assembler
from daq.drivers import DriverContext, Samples
from daq.drivers.base import nothing
from daq.drivers.canopen.driver import canopen_driver
from daq.drivers.modbus.driver import ModbusTcpDriver
from daq.frames.channels import channel_table
from daq.frames.clock import Tick
from sim_backends.devices.canopen_device import SimulatedNode
from sim_backends.devices.wiring import wire

ENCODER = "object: 0x6004, data_type: uint32, scale: 1.0e-6"


@cache
def machine_with(source: str, more: str = "") -> Machine:
    """The bench machine whose angle comes from ``source``, a string of keys."""
    return parse_machine(can("nowhere").replace(ENCODER, source) + more)


def angle(machine: Machine, raw: float) -> tuple[float, int]:
    """Value and quality that a raw value of the angle becomes."""
    table = channel_table(machine)
    samples = nothing(3)
    samples.raw[0], samples.quality[0] = raw, Quality.FRESH
    frame = Assembler(table, [table.names], 50.0).frame(Tick(0, 0.0, 0, 0, 0), 0, 0, [samples])
    return float(frame.values[0]), int(frame.quality[0])


WRAP = "object: 0x6004, data_type: uint16, scale: 0.001, modulo: 4000, zero: 3900"  # 4 rad a turn, 0 at 3900


@pytest.mark.parametrize(
    ("raw", "expected"),
    [(3900, 0.0), (3999, 0.099), (0, 0.1), (900, 1.0), (2900, -1.0), (1899, 1.999), (1900, -2.0)],
)
def test_an_encoder_goes_through_its_wrap_the_short_way_round_from_its_zero(raw: int, expected: float) -> None:
    assert angle(machine_with(WRAP), raw)[0] == pytest.approx(expected, abs=1e-12)


@given(raw=st.integers(0, 3999), turns=st.integers(-3, 3))
def test_an_encoder_whole_turns_further_has_the_same_angle(raw: int, turns: int) -> None:
    machine = machine_with(WRAP)
    assert angle(machine, raw + 4000 * turns)[0] == pytest.approx(angle(machine, raw)[0], abs=1e-9)


@pytest.mark.parametrize(
    ("data_type", "mask", "raw", "expected"),
    [
        ("uint16", "0x0FF0", 0xF12F, 0x12),  # bits 4 to 11
        ("int16", "0x0FF0", 0x0FEA, -2),  # 0xFE in two's complement
        ("uint32", "0x00FFFFFF", 0xAB000001, 1),  # status bits in the highest byte
        ("int24", "0xFFF000", -4096, -1),  # all bits from 12 on
        ("int16", "0x7FFF", -32768, 0),  # only the bit outside is set
    ],
)
def test_a_mask_takes_its_bits_of_a_word_with_their_sign(data_type: str, mask: str, raw: int, expected: int) -> None:
    assert angle(machine_with(f"object: 0x6004, data_type: {data_type}, mask: {mask}"), raw)[0] == expected


def test_zero_and_decimals_without_a_wrap() -> None:
    assert angle(machine_with("object: 0x6004, data_type: int16, zero: 250, decimals: 2"), 175)[0] == -0.75


def test_a_sentinel_is_what_was_sent_not_what_its_bits_hold() -> None:
    machine = machine_with("object: 0x6004, data_type: uint16, mask: 0x0FFF, sentinels: [0x8FFF]")
    assert angle(machine, 0x8FFF)[1] == Quality.INVALID
    assert angle(machine, 0x0FFF) == (4095.0, Quality.FRESH)


@pytest.mark.parametrize(
    ("source", "line"),
    [
        ("data_type: float32, mask: 0xFF", "mask is for integers"),
        ("data_type: uint8, mask: 0x1FF", "has more bits than uint8"),
        ("data_type: uint8, mask: 0x05", "has a gap"),
        ("data_type: uint8, mask: what", "write it as 0x00FFFFFF"),
        ("data_type: int16, decimals_object: nothing", "write it as"),
        ('data_type: int16, decimals_object: "0x6132:1", decimals: 2', "do not go together"),
        ("data_type: uint16, scale: 0.001, modulo: 1000", "begins anew at -0.5 and 0.5, and j1 moves from -1 to 1"),
    ],
)
def test_impossible_encodings_are_refused_in_one_line(source: str, line: str) -> None:
    with pytest.raises(MachineFileError, match=line) as caught:
        machine_with(f"object: 0x6004, {source}")
    assert "\n" not in str(caught.value)


# What simulated devices send


POWERED: dict[int, SimulatedNode] = {}


def simulated(machine: Machine) -> SimulatedNode:
    """The node that the angle comes from, powered; one per machine."""
    if id(machine) in POWERED:
        return POWERED[id(machine)]
    plan = next(plan for plan in wire(machine).nodes if plan.node == 5)
    node = SimulatedNode(plan, lambda cob_id, data: None, 50.0)
    node.power_on(0.0)
    return POWERED.setdefault(id(machine), node)


def sent(machine: Machine, position: float) -> float:
    """The angle's value after a simulated node sent it: written there, decoded here."""
    node = simulated(machine)
    item = node.plan.objects[0]
    node.latch((position, 0.0, 0.0))
    data = node.get_data(item.index, item.subindex)
    signed = not item.signal.data_type.startswith("u")
    return angle(machine, int.from_bytes(data, "little", signed=signed))[0]


@given(position=st.floats(-1.0, 1.0))
def test_simulated_encoders_wrap_too(position: float) -> None:
    assert sent(machine_with(WRAP), position) == pytest.approx(position, abs=0.00051)


@pytest.mark.slow
@given(position=st.floats(-1.0, 1.0))
@pytest.mark.parametrize("kind", ["int24", "int32, mask: 0x00FFFFF0", "uint24, zero: 2000000"])
def test_simulated_words_of_24_bits(kind: str, position: float) -> None:
    machine = machine_with(f"object: 0x2000, data_type: {kind}, scale: 4.0e-6")
    assert sent(machine, position) == pytest.approx(position, abs=2.1e-6)


INCLINED = "object: 0x6010, data_type: int16, scale: 1.7453292519943296e-4"  # 0.01 degrees


@given(position=st.floats(-1.0, 1.0))
def test_an_inclinometer_has_the_resolution_that_it_is_set_to(position: float) -> None:
    assert sent(inclined(), position) == pytest.approx(position, abs=0.9e-4)
    set_resolution(1000)  # 1 degree
    try:
        degrees = round(np.degrees(position))
        assert sent(inclined(), position) == pytest.approx(degrees * 1.7453292519943296e-4)
    finally:
        set_resolution(10)


@cache
def inclined() -> Machine:
    """The angle from an inclinometer."""
    text = can("nowhere").replace(ENCODER, INCLINED).replace("device_type: 0x00080194", "device_type: 0x0003019A")
    return parse_machine(text)


def set_resolution(thousandths: int) -> None:
    """CiA 410: 0x6000, in steps of 0.001 degrees."""
    simulated(inclined()).set_data(0x6000, 0, struct.pack("<H", thousandths), check_writable=True)


# Decimals that the device tells


def test_a_canopen_node_is_asked_for_its_decimals_at_commissioning() -> None:
    bench = Bench()
    try:
        bench.pressure.values[0x6132, 1] = b"\2"
        bench.pressure.values[0x7130, 1] = struct.pack("<h", 5025)
        bench.pressure.boot()
        source = "object: 0x6130, subindex: 1, data_type: float32"
        told = 'object: 0x7130, subindex: 1, data_type: int16, decimals_object: "0x6132:1", sentinels: [-999]'
        bench.driver = bench.make(can(bench.channel).replace(source, told))
        assert bench.driver.start() == ()

        def head(samples: Samples) -> bool:
            return bool(samples.quality[1] == Quality.FRESH)

        assert bench.until(head).raw[1] == pytest.approx(50.25)
        bench.pressure.set(0x7130, 1, struct.pack("<h", -999))
        invalid = bench.until(lambda samples: bool(samples.quality[1] == Quality.INVALID))
        assert np.isnan(invalid.raw[1])
    finally:
        bench.close()


def test_a_node_without_its_decimals_object_is_refused() -> None:
    bench = Bench()
    try:
        source = "object: 0x6004, data_type: uint32"
        text = can(bench.channel).replace(source, source + ', decimals_object: "0x6132:1"')
        bench.driver = bench.make(text)
        (problem,) = bench.driver.start()
        assert "refuses to read 0x6132:01" in problem
    finally:
        bench.close()


def test_nothing_is_asked_where_we_only_listen() -> None:
    source = 'data_type: uint32, cob_id: 0x185, decimals_object: "0x6132:1"'
    text = can("nowhere").replace("data_type: uint32", source).replace("listen_s: 0", "listen_only: true")
    bus = parse_machine(text).buses[0]
    with pytest.raises(MachineFileError, match="give decimals instead"):
        canopen_driver(bus, parse_machine(text).channels[:1], DriverContext(0.02, 0.0, lambda: 0))  # type: ignore[arg-type]


def test_a_modbus_unit_is_asked_for_its_decimals_at_the_start_and_after_a_reconnection(server: FakeModbus) -> None:
    text = modbus(server.port, timeout_s=0.2).replace(
        "register: 4, data_type: int16, scale: 0.1, offset: -1.0", "register: 4, data_type: int16, decimals_register: 9"
    )
    server.units[2] = {4: 215, 9: 1}
    machine = parse_machine(text)
    driver = ModbusTcpDriver(machine.buses[0], machine.channels, DriverContext(0.02, 0.0, time.monotonic_ns))  # type: ignore[arg-type]
    cycle = 0

    def rod(quality: Quality) -> float:
        nonlocal cycle
        for _ in range(200):
            driver.trigger(cycle)
            samples = driver.collect(time.monotonic_ns() + 1_000_000_000)
            cycle += 1
            if samples.quality[2] == quality:
                return float(samples.raw[2])
            time.sleep(0.02)
        raise AssertionError(driver.statistics())

    try:
        assert driver.start() == ()
        assert rod(Quality.FRESH) == 21.5
        server.silent.add(2)
        rod(Quality.MISSING)
        server.units[2][9] = 2
        server.silent.clear()
        assert rod(Quality.FRESH) == 2.15
        server.silent.add(2)
        rod(Quality.MISSING)
        server.units[2][9] = 77
        server.silent.clear()
        rod(Quality.MISSING)
        unit = next(device for device in driver.statistics().devices if device.name == "unit 2")
        assert unit.state == "silent"
    finally:
        driver.stop()
