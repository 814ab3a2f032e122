"""The drivers on AF_CAN: the kernel's own CAN sockets, on a virtual bus ``vcan0``.

Where this computer has none, ``make test-socketcan`` runs this file in user-mode Linux. What is asserted of the CANopen
driver stands in the files that these tests come from; here their nodes are on another bus.
"""

from __future__ import annotations

import math
import os
import random
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can as python_can
import cantools.database
import numpy as np
import pytest
from bench_machines import can, socketcand
from canopen_test_bench import ANGLE, HEAD, ROD, Bench, fresh
from signals_test_bench import DBC, OIL, TEMPERATURES, signals, written
from signals_test_bench import HEAD_PRESSURE as SIGNAL
from socketcand_test_hub import TestHub
from test_canopen_driver import test_a_killed_node_is_noticed_by_the_watchdog_and_comes_back as test_a_killed_node
from test_canopen_driver import test_a_late_tpdo_is_late_and_not_fresh as test_a_late_tpdo
from test_canopen_driver import test_a_node_that_boots_in_service_is_commissioned_again as test_a_boot_in_service
from test_canopen_driver import test_commissioning_writes_the_mapping_that_the_channels_need as test_commissioning
from test_canopen_driver import test_frames_bring_raw_values_sampled_at_sync as test_values_at_sync
from test_canopen_driver import test_nothing_but_nmt_sync_and_sdo_to_own_nodes_is_ever_sent as test_what_is_sent
from test_canopen_truth import test_a_storm_of_emergencies_is_counted_to_the_last_one as test_a_storm_of_emergencies
from test_canopen_truth import test_bus_off_is_shown_and_the_bus_is_opened_again as test_bus_off
from test_canopen_truth import test_extended_frames_are_another_protocols as test_extended_frames
from test_canopen_truth import test_tpdos_that_are_periods_late_are_late_and_of_their_own_cycle as test_lagging_tpdos

from daq import BusError, Quality, load_machine, parse_machine
from daq.drivers import DriverContext, Samples, make_driver
from daq.drivers.base import Driver
from daq.drivers.canopen.listening import ListeningDriver
from daq.drivers.listening import Listener

BUS = "vcan0"
TRIES = 50  # of what a computer that is busy may mark late
NO_BUS = f"no {BUS} on this computer; make test-socketcan brings its own"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not Path("/sys/class/net", BUS).exists(), reason=NO_BUS)]
__all__ = [
    "test_a_boot_in_service",
    "test_a_killed_node",
    "test_a_late_tpdo",
    "test_a_storm_of_emergencies",
    "test_bus_off",
    "test_commissioning",
    "test_extended_frames",
    "test_lagging_tpdos",
    "test_values_at_sync",
    "test_what_is_sent",
]


@pytest.fixture
def bench() -> Iterator[Bench]:
    """The CANopen bench, its nodes and its driver behind sockets of the kernel."""
    made = Bench(BUS, interface="socketcan")
    yield made
    made.close()


class Listening:
    """A driver of a bus that is somebody else's, and a socket to be that somebody with."""

    def __init__(self, make: Callable[[DriverContext], Driver], period_s: float = 10.0) -> None:
        self.wire = python_can.Bus(interface="socketcan", channel=BUS)
        # What is older than one and a half periods is late: longer than a busy computer keeps this test from running.
        driver = make(DriverContext(period_s, 0.0, time.monotonic_ns, start_s=0.01))
        assert isinstance(driver, Listener)
        self.driver = driver
        self.cycle = 0
        self.driver.start()  # says that nothing comes yet

    def send(self, identifier: int, data: bytes, *, extended: bool = False, remote: bool = False) -> None:
        """Send a frame, and wait until it has come."""
        before = self.driver.statistics().counts["frames"]
        self.wire.send(
            python_can.Message(arbitration_id=identifier, data=data, is_extended_id=extended, is_remote_frame=remote)
        )
        deadline = time.monotonic() + 60
        while self.driver.statistics().counts["frames"] == before:
            assert time.monotonic() < deadline, "the frame did not come"
            time.sleep(0.001)

    def settle(self) -> None:
        """Send what nobody reads, without a rhythm, until the driver is sure of when frames come.

        A rhythm would be that of this kernel's timers, whose frames prove nothing for as long as it lasts.
        """
        deadline = time.monotonic() + 60
        while self.driver.port is None or self.driver.port.sure_ns == math.inf:
            assert time.monotonic() < deadline, "never sure of when frames come"
            time.sleep(random.uniform(0.0, 0.02))
            self.send(0x321, bytes(8))

    def once(self) -> Samples:
        self.driver.trigger(self.cycle)
        self.cycle += 1
        return self.driver.collect(0)

    def close(self) -> None:
        self.driver.stop()
        answers = []
        while (message := self.wire.recv(0)) is not None:
            answers.append(message)
        self.wire.shutdown()
        assert answers == [], "whatever came, nothing was ever sent"


@pytest.fixture
def plain(tmp_path: Path) -> Iterator[Listening]:
    """Plain CAN and J1939 by a DBC file."""
    machine = load_machine(written(tmp_path, signals(BUS).replace("interface: virtual", "interface: socketcan")))
    made = Listening(lambda context: make_driver(machine.buses[0], machine.channels, context))
    yield made
    made.close()


@pytest.fixture
def foreign() -> Iterator[Listening]:
    """CANopen nodes that another master leads with its SYNC, their PDOs as they are."""
    text = can(BUS, interface="socketcan").replace("listen_s: 0", "listen_only: true\n  sync: external")
    text = text.replace("object: 0x6004,", "object: 0x6004, cob_id: 0x185,")
    text = text.replace("subindex: 1,", "subindex: 1, cob_id: 0x186,")
    machine = parse_machine(text.replace("subindex: 2,", "subindex: 2, cob_id: 0x186, byte: 4,"))
    made = Listening(lambda context: make_driver(machine.buses[0], machine.channels, context))
    yield made
    made.close()


def test_signals_of_both_identifier_lengths(plain: Listening) -> None:
    database = cantools.database.load_string(DBC, "dbc")
    boom = {"Angle": 12.5, "HeadPressure": 100.0, "RodPressure": 2000.0, "Roll": 0.0}
    for _ in range(TRIES):
        plain.settle()
        plain.send(0x123, database.encode_message("Boom", boom))
        plain.send(TEMPERATURES, database.encode_message("Temperatures", {"OilTemperature": 43.0}), extended=True)
        samples = plain.once()
        assert samples.raw[[ANGLE, SIGNAL, OIL]] == pytest.approx([12.5, 100.0, 43.0])
        if set(samples.quality[[ANGLE, SIGNAL, OIL]]) == {Quality.FRESH}:
            return
    pytest.fail(f"never fresh: {samples.quality}")


def test_identifiers_of_the_other_length_are_none_of_ours(plain: Listening) -> None:
    plain.send(0x123, bytes(8), extended=True)
    plain.send(TEMPERATURES & 0x7FF, bytes(8))
    assert set(plain.once().quality) == {Quality.MISSING}


def test_another_masters_sync_leads_and_nothing_is_sent(foreign: Listening) -> None:
    assert isinstance(foreign.driver, ListeningDriver)
    for number in range(TRIES):
        foreign.settle()
        foreign.send(0x080, b"")
        at_ns = foreign.driver.next_sync(time.monotonic_ns())
        assert at_ns is not None and abs(at_ns - time.monotonic_ns()) < 60e9
        foreign.driver.trigger(number)
        foreign.send(0x185, struct.pack("<I", 7))
        foreign.send(0x186, struct.pack("<ff", 50.0, 20.5))
        foreign.send(0x186, b"", remote=True)
        samples = foreign.driver.collect(time.monotonic_ns())
        assert samples.raw[[ANGLE, HEAD, ROD]].tolist() == [7.0, 50.0, 20.5]
        if set(samples.quality) == {Quality.FRESH} and not samples.cycles_ago.any():
            return
    pytest.fail(f"never fresh: {samples.quality}")


def test_error_frames_of_the_kernel_tell_the_state(plain: Listening) -> None:
    """linux/can/error.h: controller problem, warning limit of the send counter; then active again."""
    for data, state in ((b"\0\x08" + bytes(6), "warning"), (b"\0\x20" + bytes(6), "passive"), (b"\0\x40", "active")):
        plain.wire.send(python_can.Message(arbitration_id=0x004, data=data, is_error_frame=True))
        deadline = time.monotonic() + 60
        while plain.driver.statistics().state != state:
            assert time.monotonic() < deadline, plain.driver.statistics()
            time.sleep(0.001)


def test_frames_that_nobody_reads_wait_or_are_counted(plain: Listening) -> None:
    """The kernel keeps hundreds of frames by itself and forgets the others in silence; every one is accounted for."""
    before, burst = plain.driver.statistics().counts["frames"], 1500
    for _ in range(burst):
        plain.wire.send(python_can.Message(arbitration_id=0x321, data=bytes(8), is_extended_id=False))
    deadline = time.monotonic() + 60
    while (counts := plain.driver.statistics().counts)["frames"] + counts["lost_frames"] < before + burst:
        assert time.monotonic() < deadline, counts
        time.sleep(0.01)
    assert counts["frames"] + counts["lost_frames"] == before + burst
    assert os.geteuid() != 0 or counts["lost_frames"] == 0, "root has a queue that is long enough"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root takes an interface down")
def test_an_interface_that_goes_down_and_up(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    subprocess.run(["ip", "link", "set", BUS, "down"], check=True)
    try:
        samples = bench.until(lambda s: bool(np.all(s.quality == Quality.BUS_ERROR)))
        assert np.isnan(samples.raw).all() and bench.driver.statistics().state == "down"
    finally:
        subprocess.run(["ip", "link", "set", BUS, "up"], check=True)
    bench.until(lambda s: bench.driver.statistics().state == "active")


def test_a_second_hilfit_does_not_lead(bench: Bench) -> None:
    """Its first frames would be another master's to the first one: it listens, and is told."""
    bench.driver.start()
    bench.until(fresh)
    text = can(BUS, interface="socketcan").replace("listen_s: 0", "listen_s: 30")
    second = bench.make(text, start_s=30.0)
    refused: list[str] = []

    def start() -> None:
        try:
            second.start()
        except BusError as error:
            refused.append(str(error))

    thread = threading.Thread(target=start)
    thread.start()
    bench.until(lambda s: bool(refused))
    thread.join()
    assert "another master leads it" in refused[0] and "nothing was sent" in refused[0]
    bench.until(fresh)  # and the first one leads on
    assert bench.driver.statistics().counts["foreign_sync"] == 0
    second.stop()


def test_a_gateway_of_this_bus_that_restarts(bench: Bench) -> None:
    hub = TestHub(BUS, interface="socketcan")
    port = hub.port
    bench.driver = bench.make(socketcand(port))
    try:
        bench.driver.start()
        bench.until(fresh)
        hub.close()
        bench.until(lambda s: bool(np.all(s.quality == Quality.BUS_ERROR)))
        hub = TestHub(BUS, port, interface="socketcan")
        bench.until(fresh)
        assert bench.driver.statistics().counts["bus_rebuilt"] >= 1
    finally:
        bench.driver.stop()
        hub.close()


ERROR_FLAG = 0x2000_0000  # linux/can.h; classes of errors in linux/can/error.h


def report(identifier: int, data: bytes = bytes(8)) -> None:
    """What a controller's driver hands up (vcan has no controller)."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind((BUS,))
        raw.send(struct.pack("=IB3x8s", identifier | ERROR_FLAG, 8, data.ljust(8, b"\0")))


def test_error_frames_are_told_and_pass(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    report(0x004, b"\0\x20")  # error passive, sending
    bench.until(lambda s: bench.driver.statistics().state == "passive")
    report(0x004, b"\0\x40")  # active again
    bench.until(lambda s: bench.driver.statistics().state == "active")
    report(0x088)  # a protocol violation on the bus
    bench.until(lambda s: bench.driver.statistics().counts["error_frames"] >= 3)
    bench.until(fresh)
    assert bench.driver.statistics().counts["bus_rebuilt"] == 0


def test_a_controller_that_restarts_by_itself_after_bus_off(bench: Bench) -> None:
    """``restart-ms``: bus-off, then CAN_ERR_RESTARTED; the bus is opened again, and led on."""
    bench.driver.start()
    bench.until(fresh)
    report(0x040)
    bench.until(lambda s: bool(np.all(s.quality == Quality.BUS_ERROR)))
    report(0x100)
    bench.until(fresh)
    statistics = bench.driver.statistics()
    assert statistics.state == "active" and statistics.counts["bus_rebuilt"] >= 1
