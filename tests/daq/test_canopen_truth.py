"""CANopen: a value is never called fresh when it is not, whatever nodes and strangers on the bus do."""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections.abc import Callable

import can as python_can
import numpy as np
import pytest
from canopen_test_bench import ANGLE, HEAD, PERIOD, ROD, Bench, Untimed, fresh
from canopen_test_node import FakeNode
from hypothesis import given
from hypothesis import strategies as st

from daq import Quality
from daq.drivers import Samples
from daq.drivers.base import DriverContext
from daq.drivers.bus_driver import Keeper
from daq.drivers.can.health import BusHealth
from daq.drivers.can.port import ArrivalTimes
from daq.drivers.canopen.driver import COUNTS, CanopenDriver
from daq.drivers.canopen.mapping import Mapping
from daq.drivers.canopen.node import Node
from daq.drivers.canopen.tpdo import UNANSWERED, Cycle, Tpdo
from daq.frames.events import EventLog
from daq.machine.machine_file import CanNode

NS = 1_000_000_000


def detail(bench: Bench, number: int) -> str:
    return next(d.detail for d in bench.driver.statistics().devices if d.name == f"node {number}")


def events(bench: Bench) -> list[tuple[str, str]]:
    return [(event["device"], event["what"]) for event in bench.driver.context.events.published()]


# NaN


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_is_invalid_and_counted(bench: Bench, value: float) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.pressure.set(0x6130, 1, struct.pack("<f", value))
    samples = bench.until(lambda s: s.quality[HEAD] == Quality.INVALID)
    assert np.isnan(samples.raw[HEAD])
    assert samples.quality[ROD] == Quality.FRESH and samples.raw[ROD] == 20.5
    assert bench.driver.statistics().counts["not_a_number"] >= 1
    bench.pressure.set(0x6130, 1, struct.pack("<f", 50.0))
    bench.until(fresh)


# Late TPDOs


class Numbered:
    """The angle is the number of the SYNC at which it was sampled: what is called fresh is of this cycle's SYNC."""

    def __init__(self, bench: Bench) -> None:
        bench.angle.numbered = (0x6004, 0)
        bench.driver.start()
        bench.until(fresh)
        self.bench = bench
        self.before = bench.angle.syncs - bench.cycle
        bench.patience = 0.03  # nobody has to be waited for: what comes too late is what is looked at

    def once(self) -> Samples:
        samples = self.bench.once()
        if samples.quality[ANGLE] == Quality.FRESH:
            assert samples.cycles_ago[ANGLE] == 0 and self.own_cycle(samples)
        return samples

    def own_cycle(self, samples: Samples) -> bool:
        """Whether the angle is that of the cycle that it is credited to.

        What is late may be credited wrongly until its node is started anew: a frame that is lost makes the next ones
        look older, and one that a busy computer keeps back for more than four cycles younger.
        """
        return bool(samples.raw[ANGLE] == self.before + self.bench.cycle - samples.cycles_ago[ANGLE])

    def until(self, done: Callable[[Samples], bool]) -> Samples:
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            if done(samples := self.once()):
                return samples
        raise AssertionError(f"not in 120 s; {self.bench.driver.statistics()}")


@pytest.mark.slow
@pytest.mark.parametrize("lag", [1, 2])
def test_tpdos_that_are_periods_late_are_late_and_of_their_own_cycle(bench: Bench, lag: int) -> None:
    numbered = Numbered(bench)
    bench.angle.lag = lag  # from now on each comes shortly after a later SYNC than its own, as if it were in time

    def told(samples: Samples) -> bool:
        assert samples.quality[ANGLE] != Quality.FRESH
        # It was started anew, and is still late: it is slow, and says so.
        slow = samples.cycles_ago[ANGLE] == lag and "ms after SYNC" in detail(bench, 5)
        return slow and samples.quality[ANGLE] == Quality.LATE and numbered.own_cycle(samples)

    numbered.until(told)
    assert bench.driver.statistics().counts["started_anew"] >= 1
    bench.angle.lag = 0
    numbered.until(fresh)


def test_a_lost_tpdo_never_makes_a_wrong_value_fresh_and_is_overcome(bench: Bench) -> None:
    numbered = Numbered(bench)
    bench.angle.lose = 1
    samples = numbered.once()
    assert samples.quality[ANGLE] == Quality.MISSING
    numbered.until(fresh)
    assert bench.driver.statistics().counts["boot_up"] == 0  # nothing but a pause and a start


def tpdo() -> tuple[Tpdo, Cycle]:
    cycle = Cycle()
    return Tpdo(Mapping(1, 0x185, (), 4, struct.Struct("<I"), ((0,),)), cycle), cycle


@given(delays=st.lists(st.integers(0, 2), min_size=1, max_size=60))
def test_in_any_order_of_delays_a_tpdo_is_credited_to_its_own_sync(delays: list[int]) -> None:
    """Delays in whole cycles, up to 45 ms at 50 Hz; a bus keeps the order of one identifier."""
    made, cycle = tpdo()
    due = [k + delay for k, delay in enumerate(delays)]
    due = [max(due[: k + 1]) for k in range(len(due))]
    for k in range(len(delays) + 3):
        cycle.begin(k, k * NS, {0x185})
        if k < len(delays):
            made.asked(k, k * NS)
        for number in (n for n, at in enumerate(due) if at == k):
            made.receive(bytearray(struct.pack("<I", number)), k * NS + 1000)
            assert made.latest is not None
            assert struct.unpack("<I", made.latest.data)[0] == number == made.latest.cycle
            assert made.latest.at_ns - made.latest.sync_ns == (k - number) * NS + 1000
    assert made.surplus == 0 and not made.ambiguous


def test_beyond_what_can_be_counted_nothing_is_fresh() -> None:
    made, _ = tpdo()
    for k in range(UNANSWERED):
        made.asked(k, k)
    assert not made.ambiguous
    made.asked(UNANSWERED, UNANSWERED)
    assert made.ambiguous


def test_later_than_half_a_period_is_late(bench: Bench) -> None:
    context = DriverContext(PERIOD, 0.0, time.monotonic_ns)
    driver = CanopenDriver(bench.machine.buses[0], bench.machine.channels, context)  # type: ignore[arg-type]
    node = driver._nodes[5]
    node.state = "running"
    for after_ms, quality in ((9.9, Quality.FRESH), (10.1, Quality.LATE)):
        driver._lead.cycle.begin(7, 0, set())
        node.operational = True
        node.tpdos[0].asked(7, 0)
        node.tpdos[0].receive(bytearray(struct.pack("<I", 1)), round(after_ms * 1e6))
        samples = driver._look.samples(driver._lead.cycle, round(after_ms * 1e6))
        assert samples.quality[ANGLE] == quality
        assert samples.after_sync_s[ANGLE] == pytest.approx(after_ms / 1e3 if quality == Quality.LATE else 0.0)


def test_arrival_is_when_the_frame_was_on_the_bus_not_when_a_thread_got_round_to_it() -> None:
    times = ArrivalTimes()
    offset = 1_700_000_000  # s between the two clocks
    assert times.of(0.0, 5 * NS) == 5 * NS  # no stamp: what there is
    for k in range(150):  # taken 1 ms after the stamp; how fast the other clock is takes two seconds to learn
        taken = (3 * NS) + k * 20_000_000
        assert times.of(offset + (taken - 1_000_000) / NS, taken) == pytest.approx(taken, abs=10_000)
    on_bus = 6 * NS
    taken = on_bus + 31_000_000  # the thread was kept from running for 30 ms
    assert times.of(offset + (on_bus / NS), taken) == pytest.approx(on_bus + 1_000_000, abs=300_000)
    later = 7 * NS  # the other clock was set back by an hour: learnt anew
    times.nothing_at(later - 15_000_000)
    assert times.of(offset - 3600 + later / NS, later) == later


# Strangers


def test_extended_frames_are_another_protocols(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    for identifier, data in ((0x185, struct.pack("<I", 666)), (0x705, b"\0"), (0x085, b"\x00\x50\x81\0\0\0\0\0")):
        bench.listener.send(python_can.Message(arbitration_id=identifier, data=data, is_extended_id=True))
    bench.listener.send(python_can.Message(arbitration_id=0x185, is_remote_frame=True, dlc=4, is_extended_id=False))
    bench.until(lambda s: bench.driver.statistics().counts["remote_frames"] == 1)
    assert [bench.until(fresh).raw[ANGLE] for _ in range(3)] == [123456.0] * 3
    counts = bench.driver.statistics().counts
    assert counts["extended_frames"] == 3
    assert counts["surplus"] == counts["boot_up"] == counts["emergency"] == 0


def test_foreign_masters_are_counted(bench: Bench) -> None:
    bench.driver.start()
    bench.listener.send(python_can.Message(arbitration_id=0, data=b"\x01\x63", is_extended_id=False))
    bench.until(lambda s: bench.driver.statistics().counts["foreign_nmt"] == 1)


# Two devices, one node-ID


def twin(bench: Bench) -> FakeNode:
    values = {(0x6130, 1): struct.pack("<f", 99.0), (0x6130, 2): struct.pack("<f", 88.0), (0x61A1, 1): b"\0\0"}
    return FakeNode(bench.channel, 6, values, boots_by_itself=False)


@pytest.mark.slow
def test_two_devices_with_one_node_id_are_refused_at_the_start(bench: Bench) -> None:
    other = twin(bench)
    try:
        (problem,) = bench.driver.start()
        assert "node 6" in problem and "two devices answer with this node-ID" in problem
        assert bench.pressure.log == [] == other.log  # nothing was written to either
        samples = bench.until(lambda s: s.quality[ANGLE] == Quality.FRESH)
        assert samples.quality[[HEAD, ROD]].tolist() == [Quality.MISSING] * 2
    finally:
        other.close()
    bench.until(fresh)  # the other one was unplugged


@pytest.mark.slow
def test_a_second_device_that_joins_in_service_is_found(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    other = twin(bench)
    try:
        other.boot()
        bench.until(lambda s: "two devices" in detail(bench, 6))
        for _ in range(20):
            assert bench.once().quality[HEAD] != Quality.FRESH
        bench.until(lambda s: s.quality[ANGLE] == Quality.FRESH)
        assert "two devices" in detail(bench, 6)
    finally:
        other.close()
    bench.until(fresh)


def test_doubled_tpdos_are_marked_and_then_refused(bench: Bench) -> None:
    """A second device that sends as well, however it came to be operational without anybody noticing."""
    bench.driver.start()
    bench.until(fresh)
    link = bench.driver._lead.link
    assert link is not None
    receive = link.handlers[0x186]

    both = threading.Semaphore(0)

    def twice(data: bytearray, at_ns: int) -> None:
        receive(data, at_ns)
        receive(bytearray(struct.pack("<ff", 99.0, 88.0)), at_ns)
        both.release()

    link.handlers[0x186] = twice
    seen = []
    while bench.state(6) == "running":
        bench.driver.trigger(bench.cycle)
        assert both.acquire(timeout=60)  # the second one, too, has come when the cycle is collected
        samples = bench.driver.collect(time.monotonic_ns() + 60 * NS)
        bench.cycle += 1
        seen.append(int(samples.quality[HEAD]))
        assert len(seen) < 20
    assert Quality.FRESH not in seen and Quality.INVALID in seen
    assert "more TPDOs than SYNCs" in detail(bench, 6)
    assert ("can0/node 6", "failed") in events(bench)


# Frames nobody should send


@pytest.mark.slow
@pytest.mark.parametrize(
    "babble", [b"", b"\x43", b"\x43\x00\x10", b"\xff" * 8, b"\x80", b"\x41\x00\x10\x00\xff\xff\xff\xff"]
)
def test_malformed_sdo_answers_cost_an_attempt_and_not_the_keeper(bench: Bench, babble: bytes) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.pressure.babble = babble
    bench.pressure.boot()
    bench.until(lambda s: bench.state(6) == "failed" and "node 6" in detail(bench, 6))
    bench.until(lambda s: s.quality[ANGLE] == Quality.FRESH)
    bench.pressure.babble = None
    bench.until(fresh)
    assert "it was away for" in detail(bench, 6)  # the last cause stays when it is back


def test_no_frame_ends_the_receive_thread(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)

    def send(identifiers: tuple[int, ...]) -> None:
        for identifier in identifiers:
            for data in (b"", b"\0", b"\xff" * 8):
                if (identifier, data) != (0x705, b"\0") and (identifier, data) != (0x706, b"\0"):
                    bench.listener.send(python_can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    send((0x085, 0x185, 0x586, 0x705, 0x706, 0x7FF))
    bench.until(fresh)
    send((0x000, 0x080, 0x606))  # a master's: from here on nothing is sent, and everything is heard
    frames = bench.driver.statistics().counts["frames"]
    bench.until(lambda s: bench.driver.statistics().counts["frames"] > frames)
    assert bench.driver.statistics().counts["bus_rebuilt"] == 0


def test_a_keeper_survives_what_its_care_lets_out() -> None:
    told: list[str] = []
    calls: list[int] = []
    done = Keeper.__new__(Keeper)

    def care() -> None:
        calls.append(1)
        if len(calls) < 3:
            raise struct.error("unpack requires a buffer of 8 bytes")
        done._stopping = True

    now = iter(range(0, 10**12, 10**10))  # ten seconds between two looks: no pause is waited for
    done.__init__("keeper", care, lambda error: told.append(str(error)), lambda: next(now))  # type: ignore[misc]
    done.soon()
    done.start()
    done._thread.join(30)
    assert len(calls) == 3 and told == ["unpack requires a buffer of 8 bytes"] * 2


def test_a_keeper_that_has_nothing_to_do_looks_at_nothing_until_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty keepers that looked now and then were a tenth of what acquisition costs."""
    cared = threading.Event()
    keeper = Keeper("keeper", cared.set, lambda error: None, time.monotonic_ns)
    wait, limits = keeper._condition.wait, []

    def noted(timeout: float | None = None) -> bool:
        limits.append(timeout)
        return wait(timeout)

    monkeypatch.setattr(keeper._condition, "wait", noted)
    keeper.start()
    keeper.soon()
    assert cared.wait(30)
    keeper.stop()
    assert not keeper._thread.is_alive()
    assert set(limits) <= {None}


# Emergencies, heartbeat


def test_a_storm_of_emergencies_is_counted_to_the_last_one(bench: Bench) -> None:
    bench.driver.start()
    for number in range(2000):
        bench.pressure.emergency(0x5000 if number % 4 else 0x8110)
    bench.until(lambda s: bench.driver.statistics().counts["emergency"] == 2000)
    counts = bench.driver.statistics().counts
    assert (counts["emergency 0x5000"], counts["emergency 0x8110"]) == (1500, 500)
    logged = [event for event in bench.driver.context.events.published() if event["what"] == "emergency"]
    assert sum(event["count"] for event in logged) == 2000
    assert len(logged) < 64  # only the log is limited


def test_made_up_codes_do_not_flood_the_statistics(bench: Bench) -> None:
    bench.driver.start()
    for number in range(300):
        bench.pressure.emergency(0x5000 + number)
    bench.until(lambda s: bench.driver.statistics().counts["emergency"] == 300)
    counts = bench.driver.statistics().counts
    codes = [name for name in counts if name.startswith("emergency 0x")]
    assert len(codes) == 16 and counts["emergency, other codes"] == 300 - 16


@pytest.mark.slow
def test_a_heartbeat_that_is_lost_while_tpdos_go_on_is_reported(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.pressure.heartbeats = False
    bench.until(lambda s: "TPDOs come, but no heartbeat" in detail(bench, 6) and s.raw[HEAD] == 50.0)
    assert bench.state(6) == "running"
    assert bench.driver.statistics().counts["heartbeat_lost"] == 1
    assert ("can0/node 6", "heartbeat_lost") in events(bench)
    bench.pressure.heartbeats = True
    bench.until(lambda s: "no heartbeat" not in detail(bench, 6))


def test_silence_is_told_from_a_lost_heartbeat_by_the_clock_alone() -> None:
    now = [10 * NS]
    log = EventLog(lambda: now[0], lambda: now[0])
    context = DriverContext(0.02, 0.0, lambda: now[0], events=log)
    counts = dict.fromkeys(COUNTS, 0)
    mappings = (Mapping(1, 0x186, (), 4, struct.Struct("<I"), ((0,),)),)
    node = Node(CanNode(node=6, heartbeat_ms=100), "can0", "node 6", mappings, Cycle(), context, counts)
    node.back()
    node.heartbeat_ns = node.tpdos[0].arrived_ns = now[0]
    now[0] += 240_000_000  # 2.5 heartbeats are 250 ms
    node.look(now[0])
    assert counts["heartbeat_lost"] == counts["silent"] == 0
    node.tpdos[0].arrived_ns = now[0]
    now[0] += 20_000_000
    node.look(now[0])
    assert counts["heartbeat_lost"] == 1 and node.state == "running"
    now[0] += 300_000_000
    node.look(now[0])
    assert counts["silent"] == 1 and node.state == "silent"
    node.heartbeat_ns, node.heartbeat_state = now[0], 5
    node.look(now[0])
    node.look(now[0])  # and with it its heartbeat is back
    assert node.state == "running" and "it was away for" in node.line()
    lasted = next(event for event in log.published() if event["what"] == "silent")
    assert lasted["seconds"] == 0.0 and lasted["device"] == "can0/node 6"


# State of the bus


@pytest.mark.parametrize(
    ("identifier", "data", "state"),
    [
        (0x004, b"\0\x08" + bytes(6), "warning"),  # linux/can/error.h: CAN_ERR_CRTL, TX_WARNING
        (0x004, b"\0\x04" + bytes(6), "warning"),
        (0x004, b"\0\x20" + bytes(6), "passive"),
        (0x204, b"\0\x08" + bytes(4) + b"\x80\0", "passive"),  # the counters know better
        (0x200, bytes(6) + b"\x60\0", "warning"),
        (0x040, bytes(8), "bus_off"),
        (0x088, bytes(8), "active"),  # a protocol error alone
        (0x008, b"\0", "active"),  # as socketcand hands it on, without details
    ],
)
def test_error_frames_tell_the_state_of_the_controller(identifier: int, data: bytes, state: str) -> None:
    log = EventLog()
    health = BusHealth("can0", log)
    health.on_error_frame(identifier, data, 0)
    assert health.state == state and health.error_frames == 1
    name = state if state == "bus_off" else f"bus_{state}"
    told = [(event["what"], event["seconds"]) for event in log.published()]
    assert told == ([] if state == "active" else [(name, None)])
    health.look(round(1.9 * NS))
    assert health.state == state
    health.look(round(2.1 * NS))
    assert health.state == ("bus_off" if state == "bus_off" else "active")
    health.on_error_frame(0x100, bytes(8), 3 * NS)
    assert health.state == "active" and not any(event["seconds"] is None for event in log.published())


@pytest.mark.slow
def test_bus_off_is_shown_and_the_bus_is_opened_again(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    assert bench.driver.statistics().state == "active"
    bench.listener.send(python_can.Message(arbitration_id=0x004, data=b"\0\x20", is_error_frame=True))
    bench.until(lambda s: bench.driver.statistics().state == "passive")
    assert "error passive" in bench.driver.statistics().detail
    bench.listener.send(python_can.Message(arbitration_id=0x040, data=bytes(8), is_error_frame=True))
    samples = bench.until(lambda s: bool(np.all(s.quality == Quality.BUS_ERROR)))
    assert np.isnan(samples.raw).all()
    bench.until(fresh)
    assert bench.driver.statistics().state == "active"
    assert {("can0", "bus_passive"), ("can0", "bus_off"), ("can0", "bus_down")} <= set(events(bench))


# Many nodes


@pytest.mark.slow
def test_dead_nodes_do_not_keep_the_others_waiting() -> None:
    """Twenty dead nodes answer nothing for 20 x 3 s if they are asked one after another."""
    channel = uuid.uuid4().hex
    bench = Bench(channel)
    try:
        bench.angle.silent = True
        context = Untimed(PERIOD, 0.0, time.monotonic_ns, start_s=0.2)
        text_nodes = bench.machine.buses[0]
        patient = text_nodes.model_copy(update={"nodes": (CanNode(node=5, boot_up_s=60.0), CanNode(node=6))})
        bench.driver = type(bench.driver)(patient, bench.machine.channels, context)  # type: ignore[arg-type]
        problems = bench.driver.start()  # returns although node 5 may take a minute to boot
        assert "node 5" in problems[0]
        bench.until(lambda s: s.quality[HEAD] == Quality.FRESH)
        bench.angle.silent = False
        bench.until(fresh)
    finally:
        bench.close()


def test_an_answer_that_comes_after_it_was_given_up_never_passes_for_fresh() -> None:
    """In lockstep a TPDO is waited for, then taken for lost; one that was only slow answers an older SYNC."""
    tpdo = Tpdo(Mapping(1, 0x186, (), 4, struct.Struct("<I"), ((0,),)), Cycle())
    tpdo.asked(1, 10)
    tpdo.give_up()
    tpdo.asked(2, 20)
    tpdo.receive(bytearray(4), 21)  # which of the two it answers nobody knows
    assert tpdo.latest is not None and tpdo.ambiguous
    tpdo.forget()  # started anew
    tpdo.asked(3, 30)
    tpdo.receive(bytearray(4), 31)
    tpdo.give_up()  # nothing is due
    assert not tpdo.ambiguous
