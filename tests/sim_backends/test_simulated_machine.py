"""The machine as a whole: its processes, its controller, its faults, and what it keeps to itself."""

from __future__ import annotations

import json
import os
import signal
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import can
import machine_faults as faults
import numpy as np
import pytest
from sim_bus_client import SYNC, connect, receive

from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.recorder import Recorder
from daq.errors import InputError
from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from sim_backends import (
    EffectSpec,
    Motion,
    Plant,
    SimulatedMachine,
    SimulationError,
    Truth,
    default_machine,
    folding_arm,
    random_motion,
    read_motion,
    simulated_machine,
    write_motion,
)

pytestmark = pytest.mark.slow

MACHINE, TRUTH = default_machine()
NODE = 31


def alive(pid: int) -> bool:
    """Whether the process runs (and is no zombie)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@contextmanager
def pacemaker(machine: SimulatedMachine, period: float = 0.002) -> Iterator[can.BusABC]:
    """Something that sends SYNC, so that machine time goes on."""
    ended = threading.Event()
    with connect(machine) as bus:

        def beat() -> None:
            while not ended.wait(period):
                bus.send(SYNC)

        thread = threading.Thread(target=beat)
        thread.start()
        try:
            yield bus
        finally:
            ended.set()
            thread.join()


@pytest.fixture(scope="module")
def machine(tmp_path_factory) -> Iterator[SimulatedMachine]:
    workdir = tmp_path_factory.mktemp("own-machine")
    with SimulatedMachine(MACHINE, TRUTH, "demo", seed=3, speed=4.0, workdir=workdir) as running:
        yield running


def test_its_machine_file_is_whole_and_has_the_addresses_of_this_run(machine):
    found = load_machine(machine.machine_path)
    assert found.simulation.speed == 4.0 and found.simulation.lockstep
    can_bus, modbus = found.buses
    assert (can_bus.interface, can_bus.options) == ("socketcand", {"host": "127.0.0.1", "port": machine.can_port})
    assert (modbus.host, modbus.port) == ("127.0.0.1", machine.modbus_ports["modbus"])
    assert found.joints == MACHINE.joints and found.channels == MACHINE.channels


def test_it_starts_idle_and_follows_motion_files_in_their_order(machine):
    one = random_motion(MACHINE, np.random.default_rng(0), 2.0, rods="unpinned")
    two = random_motion(MACHINE, np.random.default_rng(1), 2.0)
    assert machine.controller_status()["state"] == "idle"
    with pacemaker(machine):
        write_motion(machine.inbox / "one.csv", one)
        assert machine.wait_following("one.csv")["rods"] == "unpinned"
        write_motion(machine.inbox / "two.csv", two)
        status = machine.wait_done("two")
    first, second = status["followed"]["one"], status["followed"]["two"]
    assert first[1] - first[0] + 1 == 100, "two seconds at 50 Hz"
    assert second[1] - second[0] + 1 == 100
    assert second[0] > first[1], "pistons go back to where pins fit, and the arm to its start, in between"
    assert (status["state"], status["queue"]) == ("done", [])
    assert {path.name for path in (machine.workdir / "accepted").iterdir()} >= {"one.csv", "two.csv"}


def test_a_bad_motion_file_is_refused_and_said_so(machine):
    with pacemaker(machine):
        (machine.inbox / "bad.csv").write_text("not a motion")
        with pytest.raises(InputError, match=r"bad\.csv:1: not a motion file"):
            machine.wait_following("bad")
        beyond = Motion("folding-arm", "pinned", ("joint1",), np.arange(10) * 0.1, np.linspace(0, 3, 10)[:, None])
        write_motion(machine.inbox / "beyond.csv", beyond)
        with pytest.raises(InputError, match=r"joint1 goes from .* beyond its"):
            machine.wait_following("beyond")
    assert {path.name for path in (machine.workdir / "rejected").iterdir()} == {"bad.csv", "beyond.csv"}


def test_without_sync_time_stands_still(machine):
    write_motion(machine.inbox / "never.csv", random_motion(MACHINE, np.random.default_rng(2), 1.0))
    with pytest.raises(SimulationError, match="only advances with SYNC"):
        machine.wait_following("never", timeout=0.2)
    with pacemaker(machine):
        machine.wait_done("never")


def test_undeclared_effects_are_known_to_the_plant_only(machine):
    """Arguments, environment, files, and everything that a client of the hub sees."""
    name = "position_dependent_friction"
    for process, pid in machine.pids.items():
        for where in ("cmdline", "environ"):
            assert name.encode() not in Path(f"/proc/{pid}/{where}").read_bytes(), (process, where)
    for path in machine.workdir.rglob("*"):
        if path.is_file():
            assert name.encode() not in path.read_bytes(), path
    assert "undeclared" not in machine.machine_path.read_text()


def read_identity(bus: can.BusABC, timeout: float) -> bytes | None:
    """Device type of the node by SDO, None without an answer."""
    request = [0x40, 0, 0x10, 0, 0, 0, 0, 0]
    bus.send(can.Message(arbitration_id=0x600 + NODE, is_extended_id=False, data=request))
    while (message := bus.recv(timeout)) is not None:
        if message.arbitration_id == 0x580 + NODE:
            return bytes(message.data[4:])
    return None


def start_node(bus: can.BusABC) -> None:
    """Transmission type 1 and operational."""
    data = struct.pack("<BHBB3x", 0x2F, 0x1800, 2, 1)
    bus.send(can.Message(arbitration_id=0x600 + NODE, is_extended_id=False, data=data))
    receive(bus, lambda m: m.arbitration_id == 0x580 + NODE)
    bus.send(can.Message(arbitration_id=0, is_extended_id=False, data=[1, NODE]))


def tpdo(bus: can.BusABC, timeout: float = 5.0) -> bytes | None:
    """The node's TPDO at the next SYNC."""
    bus.send(SYNC)
    while (message := bus.recv(timeout)) is not None:
        if message.arbitration_id == 0x180 + NODE:
            return bytes(message.data)
    return None


def test_faults_of_a_node(machine):
    with connect(machine) as bus:
        start_node(bus)
        assert len(tpdo(bus)) == 8
        faults.short_pdo(machine, NODE, 3)
        assert len(tpdo(bus)) == 3
        faults.short_pdo(machine, NODE, None)
        faults.freeze_node(machine, NODE)
        assert tpdo(bus) == tpdo(bus)
        faults.freeze_node(machine, NODE, on=False)
        assert tpdo(bus) != tpdo(bus)
        faults.silence_node(machine, NODE)
        assert tpdo(bus, 0.2) is None and read_identity(bus, 1.0) is not None
        faults.silence_node(machine, NODE, on=False)
        faults.emergency(machine, NODE, 0x5030, 0x81)
        message = receive(bus, lambda m: m.arbitration_id == 0x80 + NODE)
        assert struct.unpack_from("<HB", message.data) == (0x5030, 0x81)
        faults.reset_node(machine, NODE)
        assert bytes(receive(bus, lambda m: m.arbitration_id == 0x700 + NODE).data) == b"\0"
        faults.kill_node(machine, NODE)
        assert read_identity(bus, 0.2) is None
        faults.revive_node(machine, NODE)
        assert bytes(receive(bus, lambda m: m.arbitration_id == 0x700 + NODE).data) == b"\0"
        assert read_identity(bus, 1.0) == struct.pack("<I", 0x00020194)


def test_faults_of_the_bus(machine):
    bus = connect(machine)
    faults.error_frame(machine)
    assert receive(bus, lambda m: m.is_error_frame)
    assert faults.drop_can_clients(machine) >= 1
    with pytest.raises((can.CanError, OSError)):
        for _ in range(50):  # the first sends may still end in the kernel's buffer
            bus.send(SYNC)
            bus.recv(0.1)
    bus.shutdown()


def test_an_order_that_makes_no_sense_is_refused(machine):
    with pytest.raises(SimulationError, match="KeyError"):
        faults.kill_node(machine, 99)
    with pytest.raises(SimulationError, match="no fault"):
        machine.order("nodes", "fault", node=NODE, kind="melt")
    machine.check()


def test_a_process_that_dies_is_noticed_and_the_rest_ends_cleanly(tmp_path):
    with SimulatedMachine(MACHINE, TRUTH, workdir=tmp_path) as running:
        pids = running.pids
        assert len(set(pids.values())) == 4 and all(alive(pid) for pid in pids.values())
        os.kill(pids["plant"], signal.SIGKILL)
        os.waitid(os.P_PID, pids["plant"], os.WEXITED | os.WNOWAIT)
        with pytest.raises(SimulationError, match=r"plant: its process .* ended"):
            running.check()
    assert not any(alive(pid) for pid in pids.values())


def test_the_error_names_the_hub_that_did_not_start_and_not_its_clients(tmp_path, monkeypatch):
    monkeypatch.setitem(simulated_machine._MODULES, "hub", "sim_backends.there_is_no_such_module")
    with pytest.raises(SimulationError, match=r"^simulated hub: its process \d+ ended \(exit code 1\)") as caught:
        SimulatedMachine(MACHINE, TRUTH, workdir=tmp_path).__enter__()
    assert str(tmp_path / "log" / "hub.log") in str(caught.value)


def test_a_recording_over_the_buses_is_what_the_plant_did(tmp_path):
    """The real drivers, four times faster than real time: every value of every cycle, against the same plant here."""
    motion = random_motion(MACHINE, np.random.default_rng(4), 6.0)
    effect = EffectSpec("gas_spring", "joint2", 300.0)
    with SimulatedMachine(MACHINE, TRUTH, [effect], seed=9, speed=4.0, workdir=tmp_path) as running:
        declared = load_machine(running.machine_path)
        with AcquisitionProcess(declared) as acquisition:
            write_motion(running.inbox / "motion.csv", motion)
            recorder = Recorder(acquisition.ring_name, declared, "operation", tmp_path / "all.parquet")
            summary = recorder.record(9.0)
            began = running.controller_status()["followed"]["motion"][0]
    assert summary.missed_cycles == 0
    recording = read_recording(tmp_path / "all.parquet", declared, "operation")
    motion = read_motion(tmp_path / "accepted" / "motion.csv", MACHINE)  # positions have nine digits there
    states = expected_states(motion, effect, began, until=began + 600)
    angle = recording.values["joint1.angle"]
    # SYNCs that commissioning sent come before the first row; how many is the drivers' business.
    before = [k for k in range(40) if np.allclose(states[k : k + len(angle), 0], angle, atol=1e-9, rtol=0)]
    assert len(before) == 1
    rows = states[before[0] : before[0] + len(angle)]
    for column, channel in enumerate(MACHINE.channels):
        # Encoders send whole steps, pressures and temperatures 24 bits.
        np.testing.assert_allclose(recording.values[channel.name], rows[:, column], rtol=2e-7, atol=1e-9)


def expected_states(motion: Motion, effect: EffectSpec, began: int, until: int) -> np.ndarray:
    """States by cycle of the same plant, told of the motion in the same period as the controller's process was.

    That process computes ten periods at once, or up to the end of a segment, and looks into its inbox before.
    """
    plant = Plant(MACHINE, TRUTH, undeclared=[effect], rng=np.random.default_rng(9))
    rows, cycle, told = [plant.advance(1)], 0, False
    probe = Plant(MACHINE, TRUTH, rng=np.random.default_rng(0))
    probe.controller.follow(motion)
    moving = probe.controller.remaining // probe.steps.per_period
    while cycle < until:
        if not told and cycle + moving + 1 == began:
            plant.controller.follow(motion, "motion")
            told = True
        left = plant.controller.remaining // plant.steps.per_period
        rows.append(plant.advance(min(10, left) if left else 10))
        cycle += len(rows[-1])
    assert told, "motion files are taken between blocks"
    return np.concatenate(rows)


def test_what_cannot_be_simulated_is_refused(tmp_path):
    bare, truth = folding_arm(0)
    with pytest.raises(InputError, match="has 0 CANopen buses"):
        SimulatedMachine(bare, truth, workdir=tmp_path)
    with pytest.raises(InputError, match="speed 5: must be"):
        SimulatedMachine(MACHINE, TRUTH, speed=5, workdir=tmp_path)
    with pytest.raises(InputError, match="there is no joint 'joint7'"):
        SimulatedMachine(MACHINE, TRUTH, [EffectSpec("stribeck", "joint7", 1.0)], workdir=tmp_path)
    other = MACHINE.model_copy(update={"joints": bare.joints})
    with pytest.raises(InputError, match=r"what this machine weighs is not known.*--guess-truth"):
        SimulatedMachine(other, workdir=tmp_path)


def test_plant_parameters_are_the_same_after_json():
    assert Truth.from_dict(json.loads(json.dumps(TRUTH.to_dict()))) == replace(TRUTH)
