"""Where another master leads the bus hilfit sends nothing: it is found before the first frame, or listened to."""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections.abc import Iterator

import can as python_can
import numpy as np
import pytest
from bench_machines import can
from canopen_test_bench import ANGLE, HEAD, ROD, Bench, fresh

from daq import BusError, MachineFileError, Quality, parse_machine
from daq.drivers import DriverContext, make_driver
from daq.drivers.can.port import CanPort
from daq.drivers.canopen.listening import ListeningDriver
from daq.drivers.conformance import check_driver
from daq.drivers.listening import INTERVALS

NS = 1_000_000_000


def listening(bench: Bench, seconds: float) -> Bench:
    bench.driver = bench.make(can(bench.channel).replace("listen_s: 0", f"listen_s: {seconds}"))
    return bench


@pytest.mark.parametrize(
    ("identifier", "data", "words"),
    [
        (0x080, b"", "SYNC"),
        (0x000, b"\x01\x00", "NMT commands"),
        (0x605, b"\x40\x00\x10\x00\0\0\0\0", "SDO requests"),
    ],
)
def test_another_master_is_found_before_anything_is_sent(
    bench: Bench, identifier: int, data: bytes, words: str
) -> None:
    listening(bench, 60)  # at most: the first frame is enough
    master = python_can.Bus(interface="virtual", channel=bench.channel)
    ended = threading.Event()

    def lead() -> None:
        while not ended.wait(0.01):
            master.send(python_can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    thread = threading.Thread(target=lead)
    thread.start()
    try:
        with pytest.raises(BusError, match=f"'can0': another master leads it .*{words}.*listen_only: true") as caught:
            bench.driver.start()
        assert "\n" not in str(caught.value)
        bench.driver.trigger(0)
        assert bench.driver.collect(0).quality.tolist() == [Quality.BUS_ERROR] * 3
        assert bench.driver.statistics().state == "down"
    finally:
        ended.set()
        thread.join()
        master.shutdown()
    bench.driver.stop()
    answers = {0x585, 0x586, 0x705, 0x706, 0x185, 0x186}  # the nodes', to the other master
    assert {m.arbitration_id for m in bench.sent()} - answers == {identifier}


def test_a_second_hilfit_on_the_same_bus_is_refused(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    second = bench.make(can(bench.channel).replace("listen_s: 0", "listen_s: 60"))
    ended = threading.Event()
    first = threading.Thread(target=lambda: [bench.once() for _ in iter(lambda: ended.is_set(), True)])
    first.start()
    try:
        with pytest.raises(BusError, match="another master leads it"):
            second.start()
    finally:
        ended.set()
        first.join()
        second.stop()
    bench.until(fresh)  # the first one never noticed
    assert bench.driver.statistics().counts["foreign_sync"] == bench.driver.statistics().counts["foreign_nmt"] == 0


def test_a_quiet_bus_is_led(bench: Bench) -> None:
    listening(bench, 0.1)
    assert bench.driver.start() == ()
    bench.until(fresh)


def silent_text(channel: str, **places: str) -> str:
    """Nobody is asked for a mapping: the PDOs are those that somebody else has set up."""
    text = can(channel).replace("listen_s: 0", "listen_only: true")
    text = text.replace("object: 0x6004,", "object: 0x6004, cob_id: 0x185,")
    text = text.replace("subindex: 1,", f"subindex: 1, cob_id: 0x186, {places.get('head', '')}")
    return text.replace("subindex: 2,", "subindex: 2, cob_id: 0x186, byte: 4,")


class Listening:
    """Somebody else's bus: PDOs are sent by hand."""

    def __init__(self, **places: str) -> None:
        self.channel = uuid.uuid4().hex
        self.wire = python_can.Bus(interface="virtual", channel=self.channel)
        machine = parse_machine(silent_text(self.channel, **places))
        # What is older than one and a half periods is late: longer than a busy computer keeps this test from running.
        self.context = DriverContext(10.0, 0.0, time.monotonic_ns, start_s=0.01)
        self.driver = make_driver(machine.buses[0], machine.channels, self.context)
        assert isinstance(self.driver, ListeningDriver)
        self.cycle = 0

    def send(self, identifier: int, data: bytes, extended: bool = False) -> None:
        before = self.driver.statistics().counts["frames"]
        self.wire.send(python_can.Message(arbitration_id=identifier, data=data, is_extended_id=extended))
        deadline = time.monotonic() + 60
        while self.driver.statistics().counts["frames"] == before:
            assert time.monotonic() < deadline
            time.sleep(0.001)

    def start(self) -> tuple[str, ...]:
        """Start; frames are taken for ones that came just now, also where a busy computer lets them wait."""
        problems = self.driver.start()
        assert isinstance(self.driver.port, CanPort)
        times = self.driver.port._times
        times.watched, times.sure_ns = False, 0.0
        return problems

    def once(self):  # type: ignore[no-untyped-def]
        self.driver.trigger(self.cycle)
        self.cycle += 1
        return self.driver.collect(0)


@pytest.fixture
def other() -> Iterator[Listening]:
    made = Listening()
    yield made
    made.driver.stop()
    made.wire.shutdown()


def test_listening_sends_nothing_at_all(other: Listening) -> None:
    problems = other.start()
    assert len(problems) == 2 and "0x185" in problems[0] and "does not come" in problems[0]
    for number in range(INTERVALS - 1):  # more might look like a period, which frames sent by hand do not keep
        other.send(0x185, struct.pack("<I", number))
        other.send(0x186, struct.pack("<ff", 50.0, 20.5))
        samples = other.once()
        assert samples.raw.tolist() == [number, 50.0, 20.5]
        assert samples.quality.tolist() == [Quality.FRESH] * 3
        assert np.all(samples.after_sync_s <= 0)  # it came before this cycle began: that is its age
    other.send(0x705, b"\x00")  # a node that boots is its master's to look after
    other.once()
    other.driver.stop()
    assert other.wire.recv(0) is None


def test_what_does_not_come_is_missing_and_said_so(other: Listening) -> None:
    other.start()
    other.send(0x185, struct.pack("<I", 7))
    assert other.once().quality.tolist() == [Quality.FRESH, Quality.MISSING, Quality.MISSING]
    assert other.once().quality.tolist() == [Quality.MISSING] * 3  # nothing is delivered twice
    node = other.driver.statistics().devices[1]
    assert node.state == "silent" and "0x186 does not come" in node.detail


def test_short_pdos_nan_unknown_nodes_and_emergencies(other: Listening) -> None:
    other.start()
    other.send(0x186, struct.pack("<f", 50.0))  # its mapping is another one: nothing of it is where it was
    assert other.once().quality[[HEAD, ROD]].tolist() == [Quality.INVALID] * 2
    assert "4 bytes instead of 8" in other.driver.statistics().devices[1].detail
    other.send(0x186, struct.pack("<ff", float("nan"), 20.5))
    assert other.once().quality[[HEAD, ROD]].tolist() == [Quality.INVALID, Quality.FRESH]
    other.send(0x185, struct.pack("<I", 666), extended=True)
    assert other.once().quality[ANGLE] == Quality.MISSING
    other.send(0x086, b"\x00\x50\x81\0\0\0\0\0")
    other.send(0x186, struct.pack("<ff", 50.0, 20.5))
    assert other.once().quality[[HEAD, ROD]].tolist() == [Quality.EMERGENCY] * 2
    other.send(0x086, bytes(8))
    other.send(0x186, struct.pack("<ff", 50.0, 20.5))
    assert other.once().quality[[HEAD, ROD]].tolist() == [Quality.FRESH] * 2


def test_a_channel_without_its_pdo_is_refused() -> None:
    machine = parse_machine(silent_text("x").replace("cob_id: 0x185,", ""))
    with pytest.raises(MachineFileError, match=r"'can0': is listen_only, so j1\.angle needs the PDO.*cob_id"):
        make_driver(machine.buses[0], machine.channels, DriverContext(0.02, 0.0, time.monotonic_ns))


@pytest.mark.slow
def test_listening_conforms() -> None:
    channel = uuid.uuid4().hex
    wire = python_can.Bus(interface="virtual", channel=channel)
    machine = parse_machine(silent_text(channel))
    ended, sending = threading.Event(), threading.Event()
    sending.set()

    def speak() -> None:
        while not ended.wait(0.01):
            if sending.is_set():
                wire.send(python_can.Message(arbitration_id=0x185, data=struct.pack("<I", 5), is_extended_id=False))
                pressures = struct.pack("<ff", 50.0, 20.5)
                wire.send(python_can.Message(arbitration_id=0x186, data=pressures, is_extended_id=False))

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        check_driver(
            lambda context: make_driver(machine.buses[0], machine.channels, context),
            {"j1.angle": 5.0, "j1.head": 50.0, "j1.rod": 20.5},
            period_s=0.1,
            silence=sending.clear,
            restore=sending.set,
        )
    finally:
        ended.set()
        thread.join()
        wire.shutdown()
