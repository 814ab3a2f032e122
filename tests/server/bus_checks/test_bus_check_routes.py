"""The bus check over REST: what frames, statistics and a node's own words tell, against what was put into them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from acquired_machines import MACHINES, acquire
from service_fakes import Fakes, Running, running_service

from daq import Machine
from daq.acquisition.cycles import AcquisitionStatistics
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.commissioning.check import MachineCheck
from daq.commissioning.delays import BusDelay, PairDelay
from daq.frames.frame import Frame, row_dtype
from daq.quality import Quality
from server.bus_checks.bus_check_resource import shown
from server.machines.machine_resource import LAUNCH

pytestmark = pytest.mark.slow
RATE, NOISE_DEG, DRIFT_PER_MINUTE, LATE_MS = 50, 0.02, 6.0, 1.5
CHECK = f"{MACHINES}/lever/bus-check"
#: Of node 1: a CiA 406 encoder, with texts. Node 2 was asked nothing, and is silent.
SAID = {"0x1000:0": 0x0001_0196, "0x1018:1": 0x2A, "0x1018:4": 0x1234, "0x1008:0": "RE-20", "0x100A:0": "1.7"}
BUSES = [
    {
        "bus": "can",
        "devices": [
            {"name": "node 1", "state": "running", "detail": "", "latency_ms": (LATE_MS, 0.25), "objects": SAID},
            {"name": "node 2", "state": "silent", "detail": "no heartbeat", "latency_ms": None, "objects": {}},
        ],
    }
]


class Feed:
    """An acquisition that has been running for a while: an angle at rest, and a torque whose device is silent."""

    alive = True

    def __init__(self, ring_name: str, seconds: float) -> None:
        self.ring_name = ring_name
        rng = np.random.default_rng(3)
        writer = RingWriter(ring_name)
        for cycle in range(round(RATE * seconds)):
            angle = np.radians(30.0 + rng.normal(0.0, NOISE_DEG))
            effort = 20.0 + DRIFT_PER_MINUTE * cycle / RATE / 60 + rng.normal(0.0, 0.1)
            quality = [Quality.FRESH, Quality.FRESH if cycle % 2 else Quality.MISSING]
            values = np.array([angle, effort if cycle % 2 else np.nan])
            frame = Frame(
                cycle, cycle, cycle, cycle / RATE, values, np.array([0.0, 0.004]), np.array(quality, dtype=np.uint8)
            )
            writer.write(frame)
        writer.close()

    def check(self) -> None:
        pass

    def statistics(self) -> AcquisitionStatistics:
        return AcquisitionStatistics(state="running", cycles=1000, skipped=2, worst_late_ms=3.5, buses=BUSES)


def service_of(directory: Path, seconds: float) -> Any:
    @contextmanager
    def launch(machine: Machine) -> Iterator[Feed]:
        with ring_buffer(row_dtype(len(machine.channels)), 60 * RATE) as name:
            yield Feed(name, seconds)

    fakes = Fakes()
    fakes.parts[LAUNCH] = launch
    return running_service(directory, fakes)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with service_of(tmp_path, 30.0) as made:
        acquire(made, "lever")
        yield made


def test_devices_say_who_they_are_and_how_soon_they_answer(running: Running) -> None:
    found = running.client.get(CHECK).json()
    node, silent = found["devices"]
    assert node["identity"] == {
        "device": "RE-20", "profile": "encoder (CiA 406)", "firmware": "1.7", "vendor": "0x0000002A",
        "serial number": "0x00001234",
    }  # fmt: skip
    assert (node["latency_ms"], node["jitter_ms"], node["state"]) == (LATE_MS, 0.25, "running")
    assert node["mapping"].startswith("TPDO1 0x181: 0x")
    assert (silent["latency_ms"], silent["identity"]) == (None, {})
    assert "can node 2: no heartbeat" in found["findings"]
    assert (found["cycles"], found["skipped"], found["worst_late_ms"]) == (1000, 2, 3.5)
    assert found["delays"] == [], "there is one bus"


def test_channels_at_rest(running: Running) -> None:
    found = running.client.get(CHECK).json()
    assert found["seconds"] == 20.0
    angle, torque = found["channels"]
    assert (angle["unit"], angle["share"], angle["moved"]) == ("deg", 1.0, False)
    assert angle["value"] == pytest.approx(30.0, abs=0.01)
    assert angle["noise"] == pytest.approx(NOISE_DEG, rel=0.1)
    assert torque["others"] == {"missing": 500} and torque["share"] == pytest.approx(0.5)
    assert torque["drift"] == pytest.approx(DRIFT_PER_MINUTE, abs=4 * torque["drift_std"])
    assert torque["age_ms"] == pytest.approx(4.0)
    assert any(line.startswith("joint1.torque: 50.0 % of the cycles") for line in found["findings"])


def test_the_check_covers_the_seconds_that_were_asked_for(running: Running) -> None:
    assert running.client.get(f"{CHECK}?seconds=5").json()["seconds"] == 5.0
    assert running.client.get(f"{CHECK}?seconds=50").json()["seconds"] == 30.0, "no more than there are"
    assert running.client.get(f"{CHECK}?seconds=1").status_code == 422


def test_a_machine_without_enough_frames_cannot_be_checked(tmp_path: Path) -> None:
    with service_of(tmp_path, 1.0) as running:
        assert running.client.get(CHECK).status_code == 404
        acquire(running, "lever")
        young = running.client.get(CHECK)
        assert young.status_code == 503 and "less than 2 s" in young.json()["detail"]
        running.client.put(f"{MACHINES}/lever/acquisition", json={"enabled": False})
        off = running.client.get(CHECK)
        assert off.status_code == 409 and "is not being acquired" in off.json()["detail"]


def test_delays_are_given_in_milliseconds_with_what_each_joint_says() -> None:
    pair = PairDelay("boom", ("boom.head", "boom.rod"), "boom.angle", "effort", 0.0129, 0.0015, 0.95)
    delay = BusDelay("modbus", "can", 0.0123, 0.0012, (pair,))
    found = MachineCheck("crane", "2026-03-01 08:00 UTC", 20.0, 50.0, 5000, 0, 3.2, (), (), (delay,), ())
    (told,) = shown(found).delays
    assert (told.bus, told.reference) == ("modbus", "can")
    assert (told.delay_ms, told.std_ms) == pytest.approx((12.3, 1.2))
    (by,) = told.told_by
    assert (by.joint, by.kind, by.delay_ms, by.std_ms) == ("boom", "effort", pytest.approx(12.9), pytest.approx(1.5))
