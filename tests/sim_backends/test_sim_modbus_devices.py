"""The Modbus transmitters with pymodbus's client, and the race that lockstep must not lose."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

import machine_faults as faults
import numpy as np
import pytest
from pymodbus.client import ModbusTcpClient
from sim_bus_client import SYNC

from daq.drivers import wire as encodings
from daq.machine.machine_file import ModbusSource
from sim_backends import default_machine
from sim_backends.devices.device_plans import RegisterSignal, Signal, units_from_dict
from sim_backends.devices.modbus_devices import _words
from sim_backends.devices.wiring import wire

UNITS = (4, 5, 6, 10)
MACHINE, _ = default_machine()


@pytest.fixture
def client(simulated) -> Iterator[ModbusTcpClient]:
    opened = ModbusTcpClient("127.0.0.1", port=simulated.modbus_ports["modbus"], timeout=60, retries=0)
    assert opened.connect()
    yield opened
    opened.close()


def pair(client: ModbusTcpClient, unit: int) -> tuple[float, float]:
    """Both float32 values of a transmitter, big endian at register 2."""
    answer = client.read_holding_registers(2, count=4, device_id=unit)
    assert not answer.isError()
    return struct.unpack(">ff", struct.pack(">4H", *answer.registers))


def expected(unit: int, state: np.ndarray) -> tuple[float, ...]:
    """What the unit has to say for a state, by the machine file."""
    found = []
    for column, channel in enumerate(MACHINE.channels):
        if isinstance(channel.source, ModbusSource) and channel.source.unit == unit:
            found.append(float(np.float32(MACHINE.conversion(channel).from_si(state[column]))))
    return tuple(found)


@pytest.mark.slow
def test_registers_hold_the_latched_state(simulated, client, bus, idle_states):
    bus.send(SYNC)
    values = {unit: pair(client, unit) for unit in UNITS}
    cycle = simulated.order("hub", "counts")["sync"]
    for unit in UNITS:
        assert values[unit] == pytest.approx(expected(unit, idle_states[cycle]), rel=1e-6)
    assert 15.0 < values[10][0] < 40.0, "oil in degC"
    assert 150.0 < values[10][1] < 250.0, "supply in bar"


def test_input_registers_are_the_same_and_nothing_can_be_written(client):
    holding = client.read_holding_registers(2, count=4, device_id=5).registers
    assert client.read_input_registers(2, count=4, device_id=5).registers == holding
    assert client.write_register(2, 1, device_id=5).isError()
    assert client.read_holding_registers(2, count=4, device_id=5).registers == holding
    answer = client.read_holding_registers(900, count=2, device_id=5)
    assert answer.isError() and answer.exception_code == 2


def test_a_request_after_a_sync_is_answered_with_its_state(simulated, client, bus, idle_states):
    """The race: SYNC and request travel on different connections to different processes. 300 times, no pause."""
    before = simulated.order("hub", "counts")["sync"]
    channel = idle_states[:, next(i for i, c in enumerate(MACHINE.channels) if c.name == "joint6.head_pressure")]
    for k in range(1, 301):
        bus.send(SYNC)
        head, _ = pair(client, 6)
        assert head == pytest.approx(float(np.float32(channel[before + k] * 1e-5)), rel=1e-6), k


def test_requests_of_several_clients_at_once_get_the_state_of_the_sync_before(simulated, bus, idle_states):
    clients = [
        ModbusTcpClient("127.0.0.1", port=simulated.modbus_ports["modbus"], timeout=60, retries=0) for _ in UNITS
    ]
    before = simulated.order("hub", "counts")["sync"]
    with ThreadPoolExecutor(len(UNITS)) as pool:
        assert all(c.connect() for c in clients)
        for k in range(1, 101):
            bus.send(SYNC)
            answers = list(pool.map(pair, clients, UNITS))
            for unit, answer in zip(UNITS, answers, strict=True):
                assert answer == pytest.approx(expected(unit, idle_states[before + k]), rel=1e-6)
        for c in clients:
            c.close()


@pytest.mark.parametrize(
    "data_type", ["int8", "uint8", "int16", "uint16", "int24", "uint24", "int32", "uint32", "float32", "float64"]
)
@pytest.mark.parametrize("word_order", ["big", "little"])
@pytest.mark.parametrize("raw", [-3.7, 0.0, 12345.6, 1e12, math.nan])
def test_registers_are_what_the_drivers_decode(data_type, word_order, raw):
    """Two encoders of one format, written apart from each other."""
    item = RegisterSignal(0, word_order, Signal("x", 0, 1.0, 0.0, data_type))
    taken = encodings.from_registers(data_type, _words(item, raw), word_order)
    assert taken == pytest.approx(encodings.decode(data_type, encodings.encode(data_type, raw)), rel=0, nan_ok=True)


def test_plans_are_the_same_after_json():
    units = wire(MACHINE).modbus["modbus"]
    assert units_from_dict([asdict(unit) for unit in units]) == units


def test_faults_of_a_unit(simulated, client):
    quick = ModbusTcpClient("127.0.0.1", port=simulated.modbus_ports["modbus"], timeout=0.2, retries=0)
    assert quick.connect()
    faults.exception_unit(simulated, "modbus", 4, 6)
    assert client.read_holding_registers(2, count=4, device_id=4).exception_code == 6
    faults.exception_unit(simulated, "modbus", 4, None)
    faults.override_unit(simulated, "modbus", 4, math.nan)
    assert all(math.isnan(value) for value in pair(client, 4))
    faults.override_unit(simulated, "modbus", 4, None)
    faults.silence_unit(simulated, "modbus", 4)
    with pytest.raises(Exception, match="No response"):
        quick.read_holding_registers(2, count=4, device_id=4)
    faults.silence_unit(simulated, "modbus", 4, on=False)
    faults.delay_unit(simulated, "modbus", 5, 0.3)
    with pytest.raises(Exception, match="No response"):
        quick.read_holding_registers(2, count=4, device_id=5)
    faults.delay_unit(simulated, "modbus", 5, 0.0)
    quick.close()
    assert pair(client, 4) and pair(client, 5)


def test_a_frozen_unit_repeats_itself(simulated, client, bus):
    before = pair(client, 6)
    faults.freeze_unit(simulated, "modbus", 6)
    for _ in range(5):
        bus.send(SYNC)
        assert pair(client, 6) == before
    faults.freeze_unit(simulated, "modbus", 6, on=False)
    assert pair(client, 6) != before
