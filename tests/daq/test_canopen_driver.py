"""The CANopen driver against nodes on a virtual bus: commissioning, capture, and every fault a bus has to offer."""

from __future__ import annotations

import struct
import threading
import time
from types import SimpleNamespace

import can as python_can
import numpy as np
import pytest
from bench_machines import can
from canopen_test_bench import ANGLE, HEAD, PERIOD, ROD, Bench, fresh

from daq import Machine, MachineFileError, Quality, parse_machine
from daq.drivers.base import Problem
from daq.drivers.canopen import link as canopen_link
from daq.drivers.canopen.link import CanLink
from daq.drivers.canopen.mapping import map_node


def nmt(messages: list[python_can.Message], node: int) -> list[int]:
    """Commands that were sent to a node; it may hear them later."""
    return [m.data[0] for m in messages if m.arbitration_id == 0 and m.data[1] == node]


def test_commissioning_writes_the_mapping_that_the_channels_need(bench: Bench) -> None:
    assert bench.driver.start() == ()
    log = bench.pressure.log
    assert nmt(bench.sent(), 6) == [0x80, 0x01]  # pre-operational first, operational last
    off = [(i, s, v) for i, s, v in log if 0x1800 <= i <= 0x1803 and s == 1]
    assert [v[3] & 0x80 for _, _, v in off] == [0x80, 0x80, 0]  # two PDOs that were on are off, then one is on
    mapping = [(s, int.from_bytes(v, "little")) for i, s, v in log if i == 0x1A00]
    assert mapping == [(0, 0), (1, 0x6130_0120), (2, 0x6130_0220), (0, 2)]  # CiA 301: 0 entries while it changes
    assert (0x1800, 2, b"\x01") in log  # at every SYNC
    assert (0x1017, 0, struct.pack("<H", 300)) in log
    assert (0x61A1, 1, struct.pack("<H", 3)) in log
    order = [i for i, _, _ in log]
    assert order.index(0x1A00) < order.index(0x1017) < order.index(0x61A1)


def test_frames_bring_raw_values_sampled_at_sync(bench: Bench) -> None:
    bench.driver.start()
    samples = bench.until(lambda s: fresh(s) and not s.cycles_ago.any())
    assert samples.raw.tolist() == [123456.0, 50.0, 20.5]
    assert samples.after_sync_s.tolist() == [0.0, 0.0, 0.0]
    bench.pressure.set(0x6130, 1, struct.pack("<f", 51.0))
    assert bench.until(lambda s: s.raw[HEAD] == 51.0).raw[ROD] == 20.5


def test_nothing_but_nmt_sync_and_sdo_to_own_nodes_is_ever_sent(bench: Bench) -> None:
    bench.driver.start()
    for _ in range(5):
        bench.once()
    bench.pressure.boot()
    bench.until(lambda s: bench.state(6) == "running" and fresh(s))
    bench.driver.stop()
    from_nodes = {0x700 + n for n in (5, 6)} | {0x580 + n for n in (5, 6)} | {0x185, 0x186}
    others = [m for m in bench.sent() if m.arbitration_id not in from_nodes]
    assert {m.arbitration_id for m in others} == {0x000, 0x080, 0x605, 0x606}
    assert {m.data[1] for m in others if m.arbitration_id == 0} == {5, 6}  # no command to all nodes
    assert all(len(m.data) == 0 for m in others if m.arbitration_id == 0x080)
    assert not any(m.is_extended_id for m in others)
    assert nmt(others, 5)[-1] == 0x80  # left quiet


def with_a_command(channel: str) -> str:
    """The bench whose node 6 is a valve's amplifier: in its first object stands what the valve is told."""
    text = can(channel).replace("name: j1.head, quantity: head_pressure", "name: j1.command, quantity: command")
    text = text.replace(
        "joint: j1, unit: bar,\n    source: {bus: can0, node: 6, object: 0x6130, subindex: 1",
        "joint: j1, unit: mA,\n    source: {bus: can0, node: 6, object: 0x6130, subindex: 1",
    )
    return text.replace("quantity: rod_pressure, joint: j1", "quantity: supply_pressure").replace(
        "stroke: 0.3,", "stroke: 0.3, valve: {unit: mA, range: [0, 100], neutral: 50},"
    )


def test_a_valves_command_is_read_and_nothing_ever_writes_it(bench: Bench) -> None:
    bench.driver = bench.make(with_a_command(bench.channel))
    bench.driver.start()
    bench.until(lambda s: fresh(s) and s.raw[HEAD] == 50.0)
    bench.pressure.boot()  # and is commissioned again
    bench.until(lambda s: bench.state(6) == "running" and fresh(s))
    bench.driver.stop()
    asked = {m.arbitration_id for m in bench.sent()} - {0x705, 0x706, 0x585, 0x586, 0x185, 0x186}
    assert asked == {0x000, 0x080, 0x605, 0x606}, "no PDO of ours, to nobody"
    written = {index for index, _, _ in (*bench.pressure.log, *bench.angle.log)}
    assert written <= {*range(0x1000, 0x2000), 0x61A1}, "communication, and the settings that the file asks for"


@pytest.mark.slow
def test_a_node_that_is_not_there_costs_only_itself(bench: Bench) -> None:
    bench.angle.silent = True
    problems = bench.driver.start()
    assert len(problems) == 1
    assert "node 5 (j1.angle)" in problems[0] and "does not answer" in problems[0]
    samples = bench.until(lambda s: s.quality[HEAD] == Quality.FRESH)
    assert samples.quality[ANGLE] == Quality.MISSING
    bench.angle.silent = False
    bench.until(fresh)  # tried again by itself


@pytest.mark.slow
def test_who_stops_does_not_ask_a_silent_node_again(bench: Bench) -> None:
    bench.angle.silent = True
    bench.driver = bench.make(start_s=0.0)
    asked: list[python_can.Message] = []
    bench.driver.start()
    while not asked:
        asked = [m for m in bench.sent() if m.arbitration_id == 0x605]
    bench.driver.stop()
    asked += [m for m in bench.sent() if m.arbitration_id == 0x605]
    assert [m.data[0] for m in asked] == [0x40, 0x80], "a request, and that its answer is no more waited for"


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ((0x1000, 0), 0x0008_0196, ("device type", "0x00080196", "0x00080194")),
        ((0x1018, 1), 0x2B, ("vendor-ID", "0x0000002B", "0x0000002A")),
        ((0x1018, 2), 8, ("product code", "product_code")),
    ],
)
def test_another_device_is_not_configured(
    bench: Bench, key: tuple[int, int], value: int, words: tuple[str, ...]
) -> None:
    bench.angle.objects[key] = struct.pack("<I", value)
    problems = bench.driver.start()
    assert len(problems) == 1
    for word in ("node 5", "another device", *words):
        assert word in problems[0]
    assert bench.angle.log == []  # nothing was written to it
    assert 0x01 not in bench.angle.commands


def test_a_mapping_that_does_not_stay_is_found_by_reading_back(bench: Bench) -> None:
    bench.angle.frozen[0x1A00, 1] = b""
    (problem,) = bench.driver.start()
    assert "0x1A00:01" in problem and "0x60040020" in problem and "manual" in problem


def test_a_refused_object_is_named(bench: Bench) -> None:
    bench.angle.refused.add((0x1A00, 1))
    (problem,) = bench.driver.start()
    assert "node 5" in problem and "refuses to write 0x1A00:01" in problem


@pytest.mark.slow
def test_a_heartbeat_is_as_the_node_says_it(bench: Bench) -> None:
    """One that has no 0x1017 sends none and is watched by its TPDOs; one that rounds it is watched as it rounds."""
    bench.angle.refused.add((0x1017, 0))
    bench.pressure.values[0x1017, 0] = struct.pack("<H", 125)
    bench.pressure.set(0x1017, 0, struct.pack("<H", 125))
    bench.pressure.frozen[0x1017, 0] = b""
    assert bench.driver.start() == ()
    assert [bench.driver._nodes[number].heartbeat_ms for number in (5, 6)] == [0, 125]
    for _ in range(30):
        bench.until(fresh)
    assert bench.driver.statistics().counts["heartbeat_lost"] == bench.driver.statistics().counts["silent"] == 0
    bench.angle.silent = True
    bench.until(lambda s: bench.state(5) == "silent")
    bench.angle.silent = False
    bench.until(fresh)


@pytest.mark.slow
def test_a_node_that_is_not_there_is_not_waited_for_in_zero_seconds(bench: Bench) -> None:
    bench.driver = bench.make(can(bench.channel).replace("boot_up_s: 0.2", "boot_up_s: 0"))
    bench.angle.silent = True
    (problem,) = bench.driver.start()
    assert "does not answer; check its power" in problem and "0 s" not in problem


def test_a_short_pdo_is_found_at_the_start(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.drivers.canopen.driver.ANSWER_S", 0.1)  # nothing is to come
    bench.pressure.truncate = 4
    (problem,) = bench.driver.start()
    assert "node 6" in problem and "TPDO1 has 4 bytes instead of 8" in problem


@pytest.mark.slow
def test_a_short_pdo_in_service_is_never_taken_for_a_value(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.pressure.truncate = 4
    bench.once()  # a whole one may still have been under way
    for _ in range(10):
        assert np.isnan(bench.once().raw[[HEAD, ROD]]).all()
    bench.until(lambda s: bench.driver.statistics().counts["short_pdo"] >= 3 and s.quality[ANGLE] == Quality.FRESH)
    bench.pressure.truncate = 0
    bench.until(fresh)


def test_a_node_that_boots_in_service_is_commissioned_again(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.pressure.log.clear()
    bench.pressure.boot()
    bench.until(lambda s: s.quality[HEAD] != Quality.FRESH and s.quality[ANGLE] == Quality.FRESH and booted(bench))
    samples = bench.until(fresh)
    assert samples.raw[HEAD] == 50.0
    assert (0x1A00, 1, struct.pack("<I", 0x6130_0120)) in bench.pressure.log
    assert booted(bench) == 1


def booted(bench: Bench) -> int:
    return bench.driver.statistics().counts["boot_up"]


@pytest.mark.slow
def test_a_killed_node_is_noticed_by_the_watchdog_and_comes_back(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.pressure.silent = True
    bench.until(lambda s: bench.state(6) == "silent")
    detail = next(d.detail for d in bench.driver.statistics().devices if d.name == "node 6")
    assert "no heartbeat" in detail
    samples = bench.until(lambda s: s.quality[ANGLE] == Quality.FRESH)
    assert samples.quality[HEAD] == Quality.MISSING
    bench.pressure.silent = False
    bench.until(fresh)


def test_an_emergency_marks_the_nodes_values_until_it_is_reset(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.pressure.emergency(0x5000)
    samples = bench.until(lambda s: s.quality[[HEAD, ANGLE]].tolist() == [Quality.EMERGENCY, Quality.FRESH])
    assert samples.raw[HEAD] == 50.0
    assert "emergency 0x5000" in [d.detail for d in bench.driver.statistics().devices]
    assert bench.driver.statistics().counts["emergency"] == 1
    bench.pressure.emergency(0x0000)
    bench.until(fresh)


def test_a_late_tpdo_is_late_and_not_fresh(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.angle.holding = bench.pressure.holding = True
    bench.driver.trigger(bench.cycle)
    bench.driver.collect(0)  # the deadline has passed already: whatever comes now belongs to this cycle, too late
    bench.angle.let_go()
    bench.pressure.let_go()
    tpdos = [tpdo for node in bench.driver._nodes.values() for tpdo in node.tpdos]
    deadline = time.monotonic() + 60
    while any(
        tpdo.latest is None or tpdo.latest.cycle != bench.cycle for tpdo in tpdos
    ):  # until the receive thread has them
        assert time.monotonic() < deadline
        time.sleep(0.001)
    bench.cycle += 1  # and nothing comes for the next one
    bench.patience = 0.0
    samples = bench.once()
    assert samples.cycles_ago.tolist() == [1, 1, 1]
    assert samples.quality.tolist() == [Quality.LATE] * 3
    assert samples.raw.tolist() == [123456.0, 50.0, 20.5]


def test_a_bus_that_fails_is_rebuilt(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.driver.start()
    bench.until(fresh)
    link = bench.driver._lead.link
    assert link is not None

    def broken(*_: object) -> None:
        raise python_can.CanOperationError("controller is bus-off")

    monkeypatch.setattr(link._bus, "send", broken)
    samples = bench.until(lambda s: bool(np.all(s.quality == Quality.BUS_ERROR)))
    assert np.isnan(samples.raw).all()
    devices = bench.driver.statistics().devices
    assert all(device.state == "failed" and device.detail for device in devices)
    bench.until(fresh)
    assert bench.driver.statistics().counts["bus_rebuilt"] == 1


def test_error_frames_are_counted(bench: Bench) -> None:
    bench.driver.start()
    bench.listener.send(python_can.Message(is_error_frame=True, is_extended_id=False))
    bench.until(lambda s: bench.driver.statistics().counts["error_frames"] == 1)


def test_a_bus_that_cannot_be_opened_is_named(bench: Bench) -> None:
    text = can(bench.channel)
    absent = text.replace("interface: virtual", "interface: socketcand\n  options: {host: 127.0.0.1, port: 1}")
    for described, words in (
        (absent, "nothing answers at 127.0.0.1:1"),
        (text.replace("interface: virtual", "interface: pcan"), "pcan"),
    ):
        driver = bench.make(described)
        try:
            (problem,) = driver.start()
            assert "bus 'can0'" in problem and words in problem
            assert isinstance(problem, Problem) and problem.channels == driver.channels
            driver.trigger(0)
            assert driver.collect(0).quality.tolist() == [Quality.BUS_ERROR] * 3
            assert driver.statistics().state == "down"
        finally:
            driver.stop()


def channels_of(objects: list[tuple[int, int, str]]) -> Machine:
    text = can("x")
    head = text[: text.index("channels:")]
    bus = text[text.index("buses:") :]
    quantities = [
        "joint_position",
        "piston_position",
        "head_pressure",
        "rod_pressure",
        "cylinder_force",
        "joint_effort",
    ]
    units = ["rad", "m", "bar", "bar", "N", "N m"]
    lines = [
        f"- {{name: c{i}, quantity: {quantities[i]}, joint: j1, unit: {units[i]}, source: {{bus: can0, node: 5, "
        f"object: {index}, subindex: {sub}, data_type: {kind}}}}}"
        for i, (index, sub, kind) in enumerate(objects)
    ]
    return parse_machine(head + "channels:\n" + "\n".join(lines) + "\n" + bus)


def test_objects_are_packed_into_tpdos() -> None:
    machine = channels_of(
        [
            (0x6004, 0, "uint32"),
            (0x6020, 1, "uint32"),
            (0x7130, 1, "int16"),
            (0x6130, 1, "float64"),
            (0x6004, 0, "uint32"),
        ]
    )
    first, second, third = map_node(5, list(enumerate(machine.channels)), "node 5")
    assert (first.cob_id, first.length) == (0x185, 8)
    assert first.entries == (0x6004_0020, 0x6020_0120)
    assert first.positions == ((0, 4), (1,))  # one object may feed two channels
    assert (second.cob_id, second.length, second.entries) == (0x285, 2, (0x7130_0110,))
    assert (third.cob_id, third.length, third.entries) == (0x385, 8, (0x6130_0140,))
    assert first.decoder.unpack(b"\x01\0\0\0\x02\0\0\0") == (1, 2)


def test_what_does_not_fit_four_tpdos_is_refused() -> None:
    machine = channels_of([(0x6130, sub, "float64") for sub in range(1, 6)])
    with pytest.raises(MachineFileError, match="node 5: its 5 objects do not fit 4 TPDOs"):
        map_node(5, list(enumerate(machine.channels)), "node 5")
    machine = channels_of([(0x6004, 0, "uint32"), (0x6004, 0, "int32"), (0x6130, 1, "float32"), (0x6130, 2, "float32")])
    with pytest.raises(MachineFileError, match="0x6004:0 is uint32 and int32"):
        map_node(5, list(enumerate(machine.channels)), "node 5")


@pytest.mark.slow
def test_nobody_is_silent_by_what_this_process_was_too_busy_to_hear(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    port = bench.driver.port
    assert isinstance(port, CanLink)
    goes_on, dispatch = threading.Event(), port.dispatch
    port.dispatch = lambda message, at_ns: (goes_on.wait(), dispatch(message, at_ns))[1]  # type: ignore[method-assign]
    patience, bench.patience = bench.patience, PERIOD  # nothing comes that could be waited for
    for _ in range(60):  # 1.2 s, and a heartbeat is missed after 0.75 s
        bench.once()
    bench.patience = patience
    goes_on.set()
    bench.until(fresh)
    counts = bench.driver.statistics().counts
    assert counts["silent"] == counts["heartbeat_lost"] == 0 and counts["commissioned"] == 2


def test_a_node_that_is_back_by_itself_is_left_alone(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    keeper, cared = bench.driver._cares[5].keeper, threading.Event()
    care = keeper._care
    keeper._care = lambda: (care(), cared.set())[0]
    bench.sent()
    keeper.soon()  # as for one that was silent
    assert cared.wait(60)
    told = [m for m in bench.sent() if m.arbitration_id == 0x000 or (m.arbitration_id == 0x605 and m.data[0] >> 5 == 1)]
    assert not told, "neither a command nor a download; what it is may still be read"
    assert bench.state(5) == "running"


def test_a_tpdo_that_is_late_but_of_its_own_cycle_does_not_stop_its_node(bench: Bench) -> None:
    bench.driver.start()
    bench.until(fresh)
    look = bench.driver._look
    look._late_ns = -1.0  # whatever comes is late
    for _ in range(15):
        bench.once()
    line = next(d.detail for d in bench.driver.statistics().devices if d.name == "node 5")
    assert "ms after SYNC, so they are marked late" in line
    look._late_ns = 0.5e9 * PERIOD
    bench.until(fresh)
    assert bench.driver.statistics().counts["started_anew"] == 0
    assert not any("marked late" in device.detail for device in bench.driver.statistics().devices)


def test_only_answers_beyond_what_was_asked_lately_are_a_second_device(bench: Bench) -> None:
    now = [0]
    client = canopen_link._Client(None, 5, lambda: now[0])
    client.network = SimpleNamespace(send_message=lambda identifier, data: None)
    for _ in range(2):
        client.send_request(bytes((0x40, 0, 0x10, 0, 0, 0, 0, 0)))
        client.send_request(bytes((0x80, *bytes(7))))  # an abort has no answer
    for surplus in (0, 0, 1, 2):  # two late answers, then two of somebody else
        client.receive(bytearray(8), 1_000_000_000)
        assert client.surplus == surplus
    client.send_request(bytes((0x40, 0, 0x10, 0, 0, 0, 0, 0)))
    client.receive(bytearray(8), 10_000_000_000)  # the one that was asked is lost by now
    assert client.surplus == 3
