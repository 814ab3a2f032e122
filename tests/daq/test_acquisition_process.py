"""The cycle with its clock and drivers in hand, and the whole process against Modbus devices."""

from __future__ import annotations

import os
import signal
import struct
import threading
import time
import uuid
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_machines import modbus, plain, socketcand
from canopen_test_node import FakeNode
from fake_clock import FakeClock
from modbus_test_server import FakeModbus, float_registers
from socketcand_test_hub import TestHub

from daq import AcquisitionError, InputError, Machine, MachineFileError, Quality, parse_machine
from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.acquisition_child import request_fifo
from daq.acquisition.cycles import Cycles, run_cycles
from daq.acquisition.recorder import Recorder
from daq.acquisition.ring import RingReader, RingWriter, ring_buffer
from daq.drivers import DriverStatistics, Samples, nothing
from daq.frames.channels import channel_table
from daq.frames.clock import Tick
from daq.frames.events import EventLog, RecordedEvents
from daq.frames.frame import frame_from_row
from daq.messages import Sentence
from daq.recordings.recording_files import read_table

MACHINE = parse_machine(modbus(502))


class Scripted:
    """A driver that writes down when it is called; a number in ``lost`` is a cycle in which nothing comes."""

    def __init__(self, name: str, channels: tuple[str, ...], log: list[str], *, leads: bool = False) -> None:
        self.name, self.channels, self.log, self.leads = name, channels, log, leads
        self.lost: set[int] = set()
        self.cycle = -1

    def start(self) -> tuple[str, ...]:
        return ()

    def trigger(self, cycle: int) -> None:
        self.cycle = cycle
        self.log.append(f"{self.name} trigger {cycle}")

    def collect(self, until_ns: int) -> Samples:
        self.log.append(f"{self.name} collect")
        samples = nothing(len(self.channels))
        if self.cycle not in self.lost:
            samples.raw[:], samples.quality[:] = self.cycle, Quality.FRESH
        return samples

    def statistics(self) -> DriverStatistics:
        return DriverStatistics(self.name, ())

    def stop(self) -> None:
        pass


def run(cycles: Cycles, count: int) -> tuple[np.ndarray, dict[str, object]]:
    """Run ``count`` cycles; the rows in the ring and the published statistics."""
    with ring_buffer(cycles.table.dtype, 256) as name, RingWriter(name) as writer, RingReader(name) as reader:
        left = iter(range(count + 1))
        run_cycles(cycles, writer, lambda: next(left) == count)
        return reader.read().rows, reader.info()


def test_sync_leads_and_everything_is_triggered_before_anything_is_waited_for() -> None:
    log: list[str] = []
    polled = Scripted("polled", ("j1.head",), log)
    other = Scripted("other", ("j1.rod",), log)
    leading = Scripted("sync", ("j1.angle",), log, leads=True)
    rows, info = run(Cycles(MACHINE, channel_table(MACHINE), [polled, leading, other], FakeClock(50)), 2)
    one = [
        "sync trigger {0}",
        "polled trigger {0}",
        "other trigger {0}",
        "sync collect",
        "polled collect",
        "other collect",
    ]
    assert log == [line.format(cycle) for cycle in (0, 1) for line in one]
    frames = [frame_from_row(row) for row in rows]
    assert [frame.cycle for frame in frames] == [0, 1]
    assert [frame.time for frame in frames] == [0.0, 0.02]
    np.testing.assert_allclose(frames[1].values, [1.0, 1e5, 1e4 - 1e5])
    assert info["state"] == "stopped" and info["cycles"] == 2


def test_skipped_cycles_are_counted_and_leave_a_hole_in_the_numbers() -> None:
    clock = FakeClock(50)
    cycles = Cycles(MACHINE, channel_table(MACHINE), [Scripted("a", channel_table(MACHINE).names, [])], clock)
    with ring_buffer(cycles.table.dtype, 16) as name, RingWriter(name) as writer, RingReader(name) as reader:
        cycles.once(writer)
        clock.skip(3)
        cycles.once(writer)
        assert reader.read().rows["cycle"].tolist() == [0, 4]
    statistics = cycles.statistics("running", fifo=False, warnings=())
    assert (statistics.cycles, statistics.skipped) == (2, 3)


def test_statistics_count_qualities_per_channel() -> None:
    driver = Scripted("a", channel_table(MACHINE).names, [])
    driver.lost = {3, 4}
    _, info = run(Cycles(MACHINE, channel_table(MACHINE), [driver], FakeClock(50)), 10)
    assert info["quality"] == {name: {"fresh": 8, "stale": 2} for name in driver.channels}


def test_frames_have_the_instant_of_sync() -> None:
    clock = FakeClock(50, origin_ns=0)
    driver = Scripted("a", channel_table(MACHINE).names, [])
    rows, _ = run(Cycles(MACHINE, channel_table(MACHINE), [driver], clock), 3)
    assert rows["monotonic_ns"].tolist() == [20_000_000, 40_000_000, 60_000_000]
    assert rows["utc_ns"].tolist() == [20_000_000, 40_000_000, 60_000_000]


@pytest.fixture
def server() -> Iterator[FakeModbus]:
    made = FakeModbus({1: float_registers({2: 50.0, 4: 0.0, 6: 0.3}), 2: {4: 215}})
    yield made
    made.close()


def machine_at(server: FakeModbus, extra: str = "") -> Machine:
    return parse_machine(modbus(server.port, timeout_s=1.0) + extra)


@pytest.mark.slow
def test_the_process_acquires_and_is_recorded(server: FakeModbus, tmp_path: Path) -> None:
    machine = machine_at(server)
    with AcquisitionProcess(machine) as acquisition:
        assert acquisition.alive
        recorder = Recorder(acquisition.ring_name, machine, "operation", tmp_path / "r.parquet")
        summary = recorder.record(0.6)
        acquisition.check()
        assert acquisition.statistics().state == "running"
    assert summary.rows == 30
    final = acquisition.stop()  # once more: the same answer
    assert final.state == "stopped"
    assert final.cycles >= 30
    assert set(final.quality) == {"j1.angle", "j1.head", "j1.rod"}
    devices = final.buses[0]["devices"]
    assert all(0 < device.pop("latency_ms")[0] < 1000 for device in devices)
    assert devices == [
        {"name": "unit 1", "state": "running", "detail": ""},
        {"name": "unit 2", "state": "running", "detail": ""},
    ]
    assert not acquisition.alive
    table = read_table(tmp_path / "r.parquet")
    known = np.isfinite(table.columns["j1.rod"])
    assert known.any()
    np.testing.assert_allclose(table.columns["j1.rod"][known], 20.5)  # bar: 0.1 x 215 - 1
    np.testing.assert_array_equal(np.diff(table.columns["cycle"]), 1)


@pytest.mark.slow
def test_in_lockstep_no_cycle_is_skipped_at_four_times_the_speed(server: FakeModbus) -> None:
    machine = machine_at(server, "simulation: {speed: 4, lockstep: true}\n")
    with AcquisitionProcess(machine) as acquisition, RingReader(acquisition.ring_name, from_start=True) as reader:
        rows = []
        while sum(map(len, rows)) < 100:
            assert reader.wait(30)
            rows.append(reader.read().rows)
    cycles = np.concatenate(rows)["cycle"]
    np.testing.assert_array_equal(cycles, np.arange(cycles[0], cycles[0] + len(cycles)))
    statistics = acquisition.stop()
    assert statistics.skipped == 0
    assert all(set(counts) == {"fresh"} for counts in statistics.quality.values())


@pytest.mark.slow
def test_devices_that_are_not_there_are_named(server: FakeModbus) -> None:
    server.silent.add(2)
    machine = parse_machine(modbus(server.port, timeout_s=2.0))
    with (
        pytest.raises(AcquisitionError, match=r"unit 2 \(j1\.rod\): does not answer in time"),
        AcquisitionProcess(machine),
    ):
        raise AssertionError("not reached")
    with AcquisitionProcess(machine, strict=False) as acquisition:
        pause = threading.Event()
        for _ in range(300):  # the process says what it counted now and then
            warnings = acquisition.statistics().warnings
            if warnings:
                break
            pause.wait(0.1)
    assert any("unit 2" in line for line in warnings)


@pytest.mark.slow
def test_a_bus_that_is_down_at_the_start_costs_only_itself(server: FakeModbus) -> None:
    """The gateway of the CAN bus is off; later it comes back at the same port, and with it its nodes."""
    channel = uuid.uuid4().hex
    hub = TestHub(channel)
    text = socketcand(hub.port).replace("rate_hz: 50", "rate_hz: 20")
    angle = text[text.index("    source: {bus: can0, node: 5") : text.index("- {name: j1.head")]
    text = text.replace(angle, "    source: {bus: mb, unit: 1, register: 6, data_type: float32}}\n")
    text += f"- {{name: mb, type: modbus_tcp, host: 127.0.0.1, port: {server.port}, timeout_s: 1.0}}\n"
    machine = parse_machine(text)
    port = hub.port
    hub.close()
    pressures = {(0x6130, 1): struct.pack("<f", 50.0), (0x6130, 2): struct.pack("<f", 20.5), (0x61A1, 1): b"\0\0"}
    node = FakeNode(channel, 6, pressures)

    def until(good: np.ndarray) -> None:
        for _ in range(2000):
            assert reader.wait(30)
            if np.array_equal(reader.read().rows["quality"][-1], good):
                return
        raise AssertionError(f"{acquisition.statistics().buses}")

    fresh, down = int(Quality.FRESH), int(Quality.BUS_ERROR)
    with pytest.raises(AcquisitionError, match="nothing answers") as refused, AcquisitionProcess(machine):
        raise AssertionError("not reached")
    assert isinstance(str(refused.value), Sentence)  # in this process too
    with (
        AcquisitionProcess(machine, strict=False, required=["j1.angle"]) as acquisition,
        RingReader(acquisition.ring_name) as reader,
    ):
        until(np.array([fresh, down, down]))
        hub = TestHub(channel, port)
        until(np.array([fresh, fresh, fresh]))
    statistics = acquisition.stop()
    node.close()
    hub.close()
    assert [bus["state"] for bus in statistics.buses] == ["active", "active"]
    lasted = {event["what"]: event["seconds"] for event in statistics.events}
    assert lasted["bus_down"] > 0


def test_what_cannot_be_acquired_is_refused_at_once(tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(plain())
    with pytest.raises(MachineFileError, match=r"arm\.yaml: buses: there are none"):
        AcquisitionProcess(file)
    with pytest.raises(InputError, match=r"no channel 'j1\.haed'; did you mean 'j1\.head'\?"):
        AcquisitionProcess(MACHINE, strict=False, required=["j1.haed"])


def test_real_time_scheduling_is_never_required(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("os.sched_setscheduler", refuse)
    granted, line = request_fifo()
    assert not granted
    assert "SCHED_FIFO" in line and "Operation not permitted" in line


def test_a_machine_is_acquired_once(server: FakeModbus) -> None:
    machine = machine_at(server)
    with ring_buffer(channel_table(machine).dtype, 16) as name, pytest.raises(AcquisitionError, match="already"):
        AcquisitionProcess(machine, name).start()


@pytest.mark.slow
def test_a_killed_process_is_noticed_and_leaves_nothing_behind(server: FakeModbus) -> None:
    acquisition = AcquisitionProcess(machine_at(server))
    with acquisition:
        name = acquisition.ring_name
        assert acquisition._process is not None
        os.kill(acquisition._process.pid, signal.SIGKILL)
        acquisition._process.wait(30)
        with pytest.raises(AcquisitionError, match="ended by itself"):
            acquisition.check()
        assert not acquisition.alive
        assert acquisition.statistics().state == "failed"
    with pytest.raises(AcquisitionError, match="no ring buffer"):
        RingReader(name)


@pytest.mark.slow
def test_a_recorder_notices_at_once_that_acquisition_was_killed(server: FakeModbus) -> None:
    """It is a zombie as long as its parent does not look, and still answers to its number."""
    with AcquisitionProcess(machine_at(server)) as acquisition, RingReader(acquisition.ring_name) as reader:
        assert acquisition._process is not None and reader.writer_alive
        os.kill(acquisition._process.pid, signal.SIGKILL)
        state = Path(f"/proc/{acquisition._process.pid}/stat")
        while ") Z" not in state.read_text():
            time.sleep(0.01)
        assert not reader.writer_alive


@pytest.mark.slow
def test_a_parent_that_is_gone_ends_the_process(server: FakeModbus) -> None:
    acquisition = AcquisitionProcess(machine_at(server))
    with acquisition:
        assert acquisition._control is not None
        assert acquisition._process is not None
        acquisition._control.close()  # what the child sees when its parent is killed
        assert acquisition._process.wait(30) == 0
        deadline = time.monotonic() + 30
        while acquisition.statistics().state != "stopped" and time.monotonic() < deadline:
            time.sleep(0.01)
        assert acquisition.statistics().state == "stopped"


class SetClock(FakeClock):
    """A computer's clock that is set; the monotonic one goes on."""

    offset_ns = 0

    def utc_ns(self) -> int:
        return super().utc_ns() + self.offset_ns


@pytest.mark.parametrize("jump_s", [3600.0, -0.2])
def test_a_clock_that_is_set_is_marked_and_machine_time_goes_on(jump_s: float) -> None:
    clock = SetClock(50)
    cycles = Cycles(MACHINE, channel_table(MACHINE), [Scripted("a", channel_table(MACHINE).names, [])], clock)
    with ring_buffer(cycles.table.dtype, 64) as name, RingWriter(name) as writer, RingReader(name) as reader:
        for cycle in range(20):
            if cycle == 10:
                clock.offset_ns = round(jump_s * 1e9)
            clock.offset_ns += 10_000  # it is steered by 500 ppm all the time, which is no jump
            cycles.once(writer)
        rows = reader.read().rows
    assert cycles.statistics("running", fifo=False, warnings=()).utc_jumps == 1
    told = [event for event in cycles.events.published() if event["what"] == "utc_jump"]
    assert len(told) == 1 and f"{jump_s:+.3f} s" in told[0]["text"]
    np.testing.assert_allclose(np.diff(rows["time"]), 0.02)
    assert np.all(np.diff(rows["monotonic_ns"]) == 20_000_000)


def test_events_of_a_recording_survive_a_clock_that_is_set_back(tmp_path: Path) -> None:
    now = [0, 10_000_000_000]  # monotonic, UTC
    log = EventLog(lambda: now[1], lambda: now[0])
    log.note("can/node 1", "emergency", "before")
    recorded = RecordedEvents(tmp_path / "r.parquet")
    now[1] += 5_000_000_000
    first = now[1]
    recorded.take(log.published(), first)
    now[:] = [now[0] + 2_000_000_000, 1_000_000_000]
    log.note("can/node 2", "boot_up", "after the clock was set")
    recorded.take(log.published(), first)
    assert [event["device"] for event in recorded.listed] == ["can/node 2"]


def test_lateness_is_a_histogram_of_all_cycles() -> None:
    class LateClock(FakeClock):
        late_ms = iter((0.05, 0.1, 0.3, 7.0, 7.0, 250.0))

        def wait(self) -> Tick:
            return replace(super().wait(), late_ns=round(next(self.late_ms) * 1e6))

    cycles = Cycles(MACHINE, channel_table(MACHINE), [Scripted("a", channel_table(MACHINE).names, [])], LateClock(50))
    with ring_buffer(cycles.table.dtype, 16) as name, RingWriter(name) as writer:
        for _ in range(6):
            cycles.once(writer)
    statistics = cycles.statistics("running", fifo=False, warnings=())
    counted = {bound: number for bound, number in statistics.lateness.items() if number}
    assert counted == {"0.1": 2, "0.5": 1, "10": 2, "inf": 1}
    assert statistics.lateness_ms == pytest.approx(264.45)
