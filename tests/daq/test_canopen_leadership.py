"""One way to become the leader of a CANopen bus, and none back: the state machine as a model, then on a bus."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import can as python_can
import pytest
from bench_machines import can, listening
from canopen_test_bench import ANGLE, HEAD, ROD, Bench, fresh
from canopen_test_node import OPERATIONAL, PRE_OPERATIONAL
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from daq import BusError, Quality, parse_machine
from daq.drivers import DriverContext
from daq.drivers.canopen.leadership import Leadership, NotLeadingError, State
from daq.drivers.canopen.listening import ListeningDriver
from daq.drivers.found_setups import FoundSetups
from daq.frames.clock import NS
from daq.machine.machine_file import CanopenBus

OWN, STRANGER = 5, 9
LISTEN_S, AGAIN_S = 2.0, 1.0  # the first time; when a bus that was led is opened again
#: Frames that only a master sends, or that nodes send only when a master made them (CiA 301, 7.2 and 7.3).
SIGNS = (
    (0x000, b"\x01\x00"), (0x000, b"\x81\x05"), (0x080, b""), (0x605, b"\x40\x00\x10\x00\0\0\0\0"), (0x67F, bytes(8)),
    (0x709, b"\x05"), (0x189, bytes(4)), (0x489, bytes(8)), (0x205, bytes(2)), (0x509, bytes(8)), (0x7E5, bytes(8)),
)  # fmt: skip
#: Frames of a bus that nobody leads.
INNOCENT = (
    (0x709, b"\x00"), (0x709, b"\x7f"), (0x085, b"\x00\x10\x01\0\0\0\0\0"), (0x089, bytes(8)), (0x585, bytes(8)),
    (0x705, b"\x00"), (0x100, bytes(6)),
)  # fmt: skip


@cache
def listened(seconds: float) -> CanopenBus:
    """A bus that is listened to for so long before it is led."""
    (bus,) = parse_machine(can("none").replace("listen_s: 0", f"listen_s: {seconds}")).buses
    assert isinstance(bus, CanopenBus)
    return bus


class Frames(RuleBasedStateMachine):
    """A bus whose every frame is here, and a clock that is turned by hand."""

    @initialize(seconds=st.sampled_from([0.5, LISTEN_S]))
    def bus(self, seconds: float) -> None:
        self.now = 1_000 * NS
        self.leadership = Leadership(listened(seconds), DriverContext(0.02, 0.0, lambda: self.now), [OWN])
        self.listen = seconds
        self.led = self.foreign = False
        self.silent_until = self.now + round(seconds * NS)
        self.state = PRE_OPERATIONAL  # of our node
        self.sent: list[int] = []
        self.open()

    @rule()
    def open(self) -> None:
        """At the start, and after every fault of the interface."""
        self.leadership.opened()
        listen = min(self.listen, AGAIN_S) if self.led else self.listen
        self.silent_until = self.now + round(listen * NS)

    @rule(seconds=st.floats(0.001, 3.0))
    def time_passes(self, seconds: float) -> None:
        self.now += round(seconds * NS)

    @rule(stopped=st.booleans())
    def lead(self, stopped: bool) -> None:
        def pause(seconds: float) -> bool:
            self.now += round(seconds * NS)
            return stopped

        led = self.leadership.lead(pause)
        assert led == (not self.foreign and self.now >= self.silent_until)
        self.led |= led

    @rule(frame=st.sampled_from(SIGNS))
    def a_foreign_frame(self, frame: tuple[int, bytes]) -> None:
        self.foreign = True
        self.leadership.received(*frame, self.now)
        assert self.leadership.state is State.GUEST

    @rule(identifier=st.integers(0x701, 0x77F))
    def node_guarding(self, identifier: int) -> None:
        self.foreign = True
        self.leadership.received(identifier, b"", self.now, remote=True)

    @rule(frame=st.sampled_from(INNOCENT))
    def an_innocent_frame(self, frame: tuple[int, bytes]) -> None:
        self.leadership.received(*frame, self.now)

    @rule(identifier=st.sampled_from([0x080, 0x000, 0x605]), command=st.sampled_from([0x01, 0x02, 0x80]))
    def we_send(self, identifier: int, command: int) -> None:
        """Whoever wants to send asks; that is the only way to the bus."""
        data = bytes((command, OWN)) if identifier == 0 else b""
        try:
            self.leadership.permit(python_can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        except NotLeadingError:
            return
        self.sent.append(self.now)
        assert not self.foreign, "after a foreign frame"
        assert self.now >= self.silent_until, "within the listening time"
        if identifier == 0:
            self.state = {0x01: OPERATIONAL, 0x02: 0x04, 0x80: PRE_OPERATIONAL}[command]
            self.now += 1_000_000  # the node hears it

    @precondition(lambda self: self.sent)
    @rule()
    def our_node_says_what_we_made_it(self) -> None:
        """Neither what it does by our command nor its answers to us are another master's."""
        self.leadership.received(0x700 + OWN, bytes((self.state,)), self.now)
        if self.leadership.state is State.LEADING and self.state == OPERATIONAL:
            self.leadership.received(0x180 + OWN, bytes(4), self.now)

    @invariant()
    def a_guest_only_by_a_foreign_frame(self) -> None:
        if hasattr(self, "leadership"):
            assert (self.leadership.state is State.GUEST) == self.foreign


TestFrames = Frames.TestCase
TestFrames.settings = settings(max_examples=300, stateful_step_count=40, deadline=None)
TestFrames.pytestmark = [pytest.mark.slow]


def leader(listen_s: float = LISTEN_S, started: tuple[int, ...] = ()) -> tuple[Leadership, list[int]]:
    now = [1_000 * NS]
    made = Leadership(listened(listen_s), DriverContext(0.02, 0.0, lambda: now[0]), [OWN], started)
    now[0] += round(listen_s * NS)
    return made, now


def command(made: Leadership, number: int, node: int = OWN) -> None:
    made.permit(python_can.Message(arbitration_id=0, data=bytes((number, node)), is_extended_id=False))


def test_a_state_that_we_did_not_ask_for_is_another_masters() -> None:
    made, now = leader()
    assert made.lead()
    command(made, 0x01)
    for number, state in enumerate((0x7F, 0x05, 0x05, 0x7F, 0x05, 0x7F, 0x7F)):  # the first: from before the command
        now[0] += 100_000_000
        assert made.received(0x705, bytes((state,)), now[0]) == (number == 6)
    assert "did not ask for (0x705)" in made.reason


@pytest.mark.parametrize("why", [(0x705, b"\x00"), (0x085, b"\x30\x81\x11\0\0\0\0\0")], ids=["boot-up", "its error"])
def test_a_node_that_boots_or_fails_changes_its_state_by_itself(why: tuple[int, bytes]) -> None:
    made, now = leader()
    made.lead()
    command(made, 0x01)
    made.received(0x705, b"\x05", now[0] + 1)
    made.received(*why, now[0] + 2)
    for number in range(5):
        made.received(0x705, b"\x7f", now[0] + 3 + number)
    assert made.state is State.LEADING and made.excused(OWN)


def test_what_an_earlier_run_started_is_no_sign() -> None:
    made, _ = leader(started=(OWN,))
    made.received(0x705, b"\x05", 1)
    assert made.state is State.LISTENING
    made.received(0x185, bytes(4), 1)  # but nobody asked for this one
    assert made.state is State.GUEST


def test_listen_only_permits_nothing_ever() -> None:
    (bus,) = parse_machine(can("none").replace("listen_s: 0", "listen_only: true")).buses
    made = Leadership(bus, DriverContext(0.02, 0.0, lambda: 0), [OWN])  # type: ignore[arg-type]
    made.opened()
    assert not made.lead()
    with pytest.raises(NotLeadingError):
        command(made, 0x01)


# On a bus


@contextmanager
def plc(bench: Bench) -> Iterator[Callable[[int, bytes], None]]:
    """Another controller on the same bus."""
    bus = python_can.Bus(interface=bench.interface, channel=bench.channel)
    try:
        yield lambda identifier, data: bus.send(
            python_can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
        )
    finally:
        bus.shutdown()


def events(bench: Bench) -> list[tuple[str, str]]:
    return [(event["what"], event["text"]) for event in bench.driver.context.events.published()]


NODES_OWN = {0x585, 0x586, 0x705, 0x706, 0x185, 0x186, 0x085, 0x086}  # what only the nodes send


@pytest.mark.slow
@pytest.mark.parametrize(
    ("identifier", "data", "word"),
    [
        (0x080, b"", "SYNC (0x080)"),
        (0x000, b"\x80\x00", "NMT commands (0x000)"),
        (0x605, b"\x40\x00\x10\x00\0\0\0\0", "SDO requests (0x605)"),
    ],
    ids=["sync", "nmt", "sdo"],
)
def test_another_master_in_service_ends_our_sending(bench: Bench, identifier: int, data: bytes, word: str) -> None:
    bench.driver.start()
    bench.until(fresh)
    with plc(bench) as send:
        send(identifier, data)
        deadline = time.monotonic() + 60
        while bench.driver._leadership.state is State.LEADING:  # the receive thread took it
            assert time.monotonic() < deadline
            time.sleep(0.001)
        bench.sent()
        for _ in range(30):
            bench.once()
        assert {m.arbitration_id for m in bench.sent()} <= NODES_OWN
        ((_, text),) = [event for event in events(bench) if event[0] == "second_master"]
        assert word in text and "start again" in text and "\n" not in text
        bench.driver.stop()
        assert {m.arbitration_id for m in bench.sent()} <= NODES_OWN  # nor does the end touch its nodes


@pytest.mark.slow
def test_a_guest_takes_what_nodes_answer_to_the_other_masters_sync(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    ended = threading.Event()
    with plc(bench) as send:

        def lead() -> None:
            due = time.monotonic()
            while not ended.wait(max(0.0, due - time.monotonic())):
                send(0x080, b"")
                due += 0.02

        thread = threading.Thread(target=lead)
        thread.start()
        try:
            bench.until(lambda s: bench.driver._guest is not None)
            samples = bench.until(fresh)
            assert samples.raw.tolist() == [123456.0, 50.0, 20.5]
            # At 50 Hz by a thread that may be late, and makes up for it: it fits all the same.
            bench.until(lambda s: bench.driver.external_sync)
            bench.pressure.boot()  # the mapping is not ours any more, whatever comes
            bench.until(lambda s: bench.driver.statistics().counts["boot_up"] == 1)
            send(0x186, struct.pack("<ff", 1.0, 2.0))
            bench.until(lambda s: s.quality[[HEAD, ROD]].tolist() == [Quality.INVALID] * 2)
            send(0x186, struct.pack("<ff", 1.0, 2.0))
            (line,) = bench.driver._guest.refused.values()  # type: ignore[union-attr]
            assert "booted" in line and "listen_only: true" in line
        finally:
            ended.set()
            thread.join()


@pytest.mark.slow
def test_a_guest_takes_nothing_of_a_node_that_the_other_master_maps_anew(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    with plc(bench) as send:
        send(0x080, b"")
        bench.until(lambda s: bench.driver._guest is not None)
        send(0x606, struct.pack("<BHBI", 0x2F, 0x1A00, 0, 0))
        send(0x186, struct.pack("<ff", 1.0, 2.0))
        bench.until(lambda s: s.quality[HEAD] == Quality.INVALID)
        send(0x185, struct.pack("<I", 77))
        came = (Quality.FRESH, Quality.LATE)  # a busy computer takes it late
        assert bench.until(lambda s: s.quality[ANGLE] in came).raw[ANGLE] == 77


@pytest.mark.slow
def test_a_rebuilt_bus_is_listened_to_first(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A PLC took the bus over while the interface was down."""
    bench.driver = bench.make(can(bench.channel).replace("listen_s: 0", "listen_s: 0.3"))
    bench.driver.start()
    bench.until(fresh)
    link = bench.driver._lead.link
    assert link is not None
    ended = threading.Event()
    with plc(bench) as send:

        def lead() -> None:
            while not ended.wait(0.02):
                send(0x080, b"")

        link.fail(python_can.CanOperationError("gone"))
        bench.once()
        bench.sent()
        thread = threading.Thread(target=lead)
        thread.start()
        try:
            bench.until(lambda s: bench.driver.statistics().counts["bus_rebuilt"] == 1)
            bench.until(lambda s: bench.driver._guest is not None)
            for _ in range(20):
                bench.once()
        finally:
            ended.set()
            thread.join()
    assert {m.arbitration_id for m in bench.sent()} <= NODES_OWN | {0x080}
    assert "second_master" in [what for what, _ in events(bench)]


@pytest.mark.slow
def test_a_bus_that_opens_late_is_listened_to_first(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.driver = bench.make(can(bench.channel).replace("listen_s: 0", "listen_s: 60"), start_s=0.01)
    refused = [True]
    real = python_can.Bus

    def opened(*args: object, **kwargs: object) -> object:
        if refused[0]:
            raise OSError("no such device")
        return real(*args, **kwargs)  # type: ignore[arg-type]

    with plc(bench) as send:
        monkeypatch.setattr("daq.drivers.can.port.can.Bus", opened)
        (problem,) = bench.driver.start()
        assert "cannot be opened" in problem
        refused[0] = False
        bench.until(lambda s: bench.driver.port is not None)
        send(0x705, b"\x05")  # a PLC that sends no SYNC: its nodes are operational
        bench.until(lambda s: bench.driver._guest is not None)
        for _ in range(10):
            assert bench.once().quality.tolist() != [Quality.FRESH] * 3
    assert {m.arbitration_id for m in bench.sent()} <= NODES_OWN


@pytest.mark.slow
def test_a_start_reports_while_a_bus_is_listened_to_for_long(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine file may say a minute: other buses are not kept waiting, and nothing is sent before it is over."""
    monkeypatch.setattr("daq.drivers.canopen.driver.FIRST_S", 0.01)
    bench.driver = bench.make(can(bench.channel).replace("listen_s: 0", "listen_s: 0.5"), start_s=0.01)
    (problem,) = bench.driver.start()
    assert problem == "bus 'can0': is still listened to"
    assert problem.channels == bench.driver.channels
    assert {m.arbitration_id for m in bench.sent()} <= NODES_OWN
    bench.until(fresh)
    assert bench.driver.statistics().counts["bus_rebuilt"] == 0


@pytest.mark.parametrize(
    ("identifier", "data", "word"),
    [(0x705, b"\x05", "operational"), (0x185, bytes(4), "TPDOs"), (0x205, bytes(8), "RPDOs")],
)
def test_a_master_without_sync_is_a_master(bench: Bench, identifier: int, data: bytes, word: str) -> None:
    bench.driver = bench.make(can(bench.channel).replace("listen_s: 0", "listen_s: 60"))
    ended = threading.Event()
    with plc(bench) as send:

        def speak() -> None:
            while not ended.wait(0.01):
                send(identifier, data)

        thread = threading.Thread(target=speak)
        thread.start()
        try:
            with pytest.raises(BusError, match=f"another master leads it .*{word}"):
                bench.driver.start()
        finally:
            ended.set()
            thread.join()
    assert {m.arbitration_id for m in bench.sent()} <= NODES_OWN | {identifier}


@pytest.mark.slow
def test_a_node_that_leaves_operation_is_left_to_who_did_it(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    writes = len(bench.pressure.log)
    bench.pressure.state = PRE_OPERATIONAL
    bench.until(lambda s: bench.driver._guest is not None)
    assert len(bench.pressure.log) == writes
    assert any("did not ask for (0x706)" in text for _, text in events(bench))


@pytest.mark.slow
def test_a_node_that_leaves_operation_because_of_an_error_is_brought_back(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    commissioned = bench.driver.statistics().counts["commissioned"]
    bench.pressure.emergency(0x8130)
    bench.pressure.state = PRE_OPERATIONAL
    bench.until(lambda s: bench.driver.statistics().counts["commissioned"] > commissioned)
    bench.pressure.emergency(0)
    bench.until(fresh)


@pytest.mark.slow
def test_a_transfer_in_flight_ends_without_a_frame(bench: Bench) -> None:
    bench.driver.start()
    link = bench.driver._lead.link
    assert link is not None
    bench.pressure.silent = True
    ended = threading.Event()

    def ask() -> None:
        with pytest.raises(BusError, match="nothing may be sent: 1 SYNC"):
            link.sdo(6).read(0x1000)
        ended.set()

    thread = threading.Thread(target=ask)
    thread.start()
    with plc(bench) as send:
        while not any(m.arbitration_id == 0x606 for m in bench.sent()):
            time.sleep(0.001)
        send(0x080, b"")
        assert ended.wait(60)
    thread.join()
    assert not [m for m in bench.sent() if m.arbitration_id == 0x606 and m.data[0] == 0x80]  # no abort


@pytest.mark.slow
def test_nodes_of_a_run_that_was_killed_are_led_again(bench: Bench, tmp_path: Path) -> None:
    found = FoundSetups(tmp_path, "bench")
    bench.driver = bench.make(found=found)
    bench.driver.start()
    bench.until(fresh)
    link, bench.driver._lead.link = bench.driver._lead.link, None
    assert link is not None and found.started("can0") == {5, 6}
    bench.driver.stop()  # as good as killed: it sends nothing, and puts nothing back
    assert bench.pressure.state == OPERATIONAL
    text = can(bench.channel).replace("listen_s: 0", "listen_s: 1.0")  # more than two heartbeats
    bench.driver = bench.make(text, found=found)
    assert bench.driver.start() == ()
    bench.until(fresh)
    bench.driver.stop()
    assert found.started("can0") == frozenset()
    while bench.pressure.commands[-1] != 0x80:  # pre-operational, as it was before either run
        time.sleep(0.01)


def test_a_listener_cannot_send_whoever_tries() -> None:
    machine = parse_machine(listening("cob_id: 0x286"))
    driver = ListeningDriver(
        machine.buses[0], machine.channels, DriverContext(0.02, 0.0, time.monotonic_ns, start_s=0.01)
    )  # type: ignore[arg-type]
    driver.start()
    try:
        assert driver.port is not None
        with pytest.raises(python_can.CanError, match="nothing may be sent"):
            driver.port.send(python_can.Message(arbitration_id=0x080, is_extended_id=False))
    finally:
        driver.stop()
