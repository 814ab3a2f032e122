"""Every installed driver passes the conformance check, and the check finds drivers that do not conform."""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import EntryPoint
from pathlib import Path

import can as python_can
import cantools.database
import numpy as np
import pytest
from bench_machines import can, modbus, modbus_serial
from canopen_test_node import FakeNode
from modbus_test_serial import FakeSerialModbus
from modbus_test_server import FakeModbus, float_registers
from signals_test_bench import DBC, TEMPERATURES, signals, written

from daq import Channel, InputError, MachineFileError, parse_machine
from daq.drivers import Driver, DriverContext, DriverStatistics, Samples, make_driver, nothing
from daq.drivers.base import DeviceStatus
from daq.drivers.conformance import ConformanceError, check_driver
from daq.machine.buses import BUS_TYPES
from daq.machine.machine_file import OtherBus
from daq.seams import DRIVERS

Bench = tuple[str, dict[str, float], Callable[[], None], Callable[[], None]]
REGISTERS = {1: float_registers({2: 50.0, 4: 0.0, 6: 0.3}), 2: {4: 215}}
SIGNAL_VALUES = {"j1.angle": 12.5, "j1.head": 50.0, "j1.rod": 2050.0, "supply": 210.0, "tank": 1.25, "oil": 43.0}
MODBUS_VALUES = {"j1.angle": 0.3, "j1.head": 50.0, "j1.rod": 215.0}


class Speaker:
    """Sends the messages of the bench of plain CAN, every 10 ms."""

    def __init__(self) -> None:
        self.channel = uuid.uuid4().hex
        self._database = cantools.database.load_string(DBC, "dbc")
        self._bus = python_can.Bus(interface="virtual", channel=self.channel)
        self._ended, self._speaking = threading.Event(), threading.Event()
        self.quiet, self.loud = self._speaking.clear, self._speaking.set
        self.loud()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        boom = {"Angle": 12.5, "HeadPressure": 50.0, "RodPressure": 2050.0, "Roll": 0.0}
        frames = [
            (291, self._database.encode_message("Boom", boom)),
            (292, self._database.encode_message("Slow", {"Page": 0, "Supply": 210.0})),
            (292, self._database.encode_message("Slow", {"Page": 1, "Tank": 1.25})),
            (TEMPERATURES, self._database.encode_message("Temperatures", {"OilTemperature": 43.0})),
        ]
        while not self._ended.wait(0.01):
            for identifier, data in frames if self._speaking.is_set() else ():
                extended = identifier > 0x7FF
                self._bus.send(python_can.Message(arbitration_id=identifier, data=data, is_extended_id=extended))

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._bus.shutdown()


@pytest.fixture
def benches(tmp_path: Path) -> Iterator[Callable[[str], Bench]]:
    """Makes the test bench of a driver by its bus's type."""
    close: list[Callable[[], None]] = []

    def make(name: str) -> Bench:
        if name == "can_signals":
            speaker = Speaker()
            close.append(speaker.close)
            return written(tmp_path, signals(speaker.channel)).read_text(), SIGNAL_VALUES, speaker.quiet, speaker.loud
        if name == "canopen":
            channel = uuid.uuid4().hex
            angle = FakeNode(channel, 5, {(0x6004, 0): struct.pack("<I", 123456)})
            pressure = FakeNode(
                channel,
                6,
                {(0x6130, 1): struct.pack("<f", 50.0), (0x6130, 2): struct.pack("<f", 20.5), (0x61A1, 1): b"\0\0"},
            )
            close.extend([angle.close, pressure.close])

            def silence() -> None:
                angle.silent = pressure.silent = True

            def restore() -> None:
                angle.silent = pressure.silent = False

            return can(channel), {"j1.angle": 123456.0, "j1.head": 50.0, "j1.rod": 20.5}, silence, restore
        server: FakeModbus | FakeSerialModbus
        if name == "modbus_tcp":
            server = FakeModbus(REGISTERS)
            text = modbus(server.port, timeout_s=2.0)
        elif name == "modbus_rtu":
            server = FakeSerialModbus(REGISTERS)
            text = modbus_serial(server.port)
        else:
            raise AssertionError(f"driver '{name}' has no bench here: add one")
        close.append(server.close)
        return text, MODBUS_VALUES, lambda: server.silent.update({1, 2}), server.silent.clear

    yield make
    for function in close:
        function()


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*BUS_TYPES, *DRIVERS.names()}))
def test_every_installed_driver_conforms(name: str, benches: Callable[[str], Bench], tmp_path: Path) -> None:
    text, expected, silence, restore = benches(name)
    machine = parse_machine(text, folder=tmp_path)
    check_driver(
        lambda context: make_driver(machine.buses[0], machine.channels, context),
        expected,
        period_s=0.1,  # half of it is in time: a busy computer keeps threads from running for longer than 10 ms
        silence=silence,
        restore=restore,
    )


class Honest:
    """A driver of one channel without a bus, that conforms."""

    channels = ("a",)
    leads = False

    def __init__(self, context: DriverContext) -> None:
        self.stopped = False

    def start(self) -> tuple[str, ...]:
        return ()

    def trigger(self, cycle: int) -> None:
        pass

    def collect(self, until_ns: int) -> Samples:
        samples = nothing(1)
        if not self.stopped:
            samples.raw[:], samples.quality[:] = 1.0, 0
        return samples

    def statistics(self) -> DriverStatistics:
        return DriverStatistics("none", (DeviceStatus("one", "running"),))

    def stop(self) -> None:
        self.stopped = True


class Plugged(Honest):
    """The same as another package would bring it: made from a bus and its channels."""

    def __init__(self, bus: OtherBus, channels: Sequence[Channel], context: DriverContext) -> None:
        super().__init__(context)
        assert bus.options == {"nic": "eth1"}
        self.channels = tuple(channel.name for channel in channels)


def test_a_driver_of_another_package_is_found_by_its_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = OtherBus(name="field", type="ethercat", options={"nic": "eth1"})
    channel = Channel(name="a", quantity="oil_temperature", unit="K")
    context = DriverContext(0.02, 0.0, time.monotonic_ns)
    with pytest.raises(MachineFileError, match="'field': no driver for type 'ethercat'"):
        make_driver(bus, [channel], context)
    entry = EntryPoint("ethercat", f"{__name__}:Plugged", DRIVERS.group)
    monkeypatch.setattr("daq.seams.entry_points", lambda group: [entry])
    check_driver(lambda context: make_driver(bus, [channel], context), {"a": 1.0}, period_s=0.0001)
    broken = EntryPoint("ethercat", f"{__name__}:Nobody", DRIVERS.group)
    monkeypatch.setattr("daq.seams.entry_points", lambda group: [broken])
    with pytest.raises(InputError, match="driver 'ethercat'"):
        make_driver(bus, [channel], context)


class WrongValue(Honest):
    def collect(self, until_ns: int) -> Samples:
        samples = super().collect(until_ns)
        samples.raw[:] *= 2
        return samples


class WrongShape(Honest):
    def collect(self, until_ns: int) -> Samples:
        return nothing(2)


class FreshNaN(Honest):
    def collect(self, until_ns: int) -> Samples:
        samples = super().collect(until_ns)
        samples.raw[:] = np.nan
        samples.quality[:] = 0
        return samples


class Lossy(Honest):
    count = 0

    def collect(self, until_ns: int) -> Samples:
        self.count += 1
        return nothing(1) if self.count % 3 == 0 else super().collect(until_ns)


class Nameless(Honest):
    def statistics(self) -> DriverStatistics:
        return DriverStatistics("none", ())


class Complaining(Honest):
    def start(self) -> tuple[str, ...]:
        return ("device one: does not answer",)


def run(driver: Callable[[DriverContext], Driver]) -> None:
    check_driver(driver, {"a": 1.0}, period_s=0.0001)


def test_the_check_accepts_a_driver_that_conforms() -> None:
    run(Honest)


@pytest.mark.parametrize("driver", [WrongValue, WrongShape, FreshNaN, Lossy, Nameless, Complaining])
def test_the_check_refuses_a_driver_that_does_not_conform(driver: Callable[[DriverContext], Driver]) -> None:
    with pytest.raises(ConformanceError):
        run(driver)


def test_the_check_refuses_a_driver_that_hides_silence() -> None:
    with pytest.raises(ConformanceError, match="silence"):
        check_driver(Honest, {"a": 1.0}, period_s=0.0001, silence=lambda: None, restore=lambda: None)
