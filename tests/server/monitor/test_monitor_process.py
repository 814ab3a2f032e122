"""The monitor from a ring buffer to an alarm: quiet for long, a change of friction found, nothing learnt twice."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from live_lever import COULOMB, RATE, handed_over, recording, session, signals
from service_fakes import MACHINE

from daq import write_recording
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.frames.frame import frame_from_row, row_dtype
from fitting.pipeline.stage_program import load_request
from fitting.pipeline.stages import STAGES, run_stage
from server.alarms.alarm_desk import Alarms
from server.composition.declarations import TABLES
from server.identifications.live_model import LiveModel, NotLiveError
from server.monitor import monitor_child as child
from server.monitor import monitor_supervisor
from server.monitor.followed import Efforts
from server.monitor.monitor_child import watch
from server.monitor.monitor_order import Order, Rules
from server.monitor.monitor_supervisor import Monitors
from server.monitor.residual_blocks import Windows
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, UnavailableError
from server.platform.files import DataDirectory
from server.platform.processes.children import ChildResult

NAMES = ("joint1.angle", "joint1.torque")
RULES = Rules(learn=40, block_s=2.0)


def rows(seconds: float, seed: int, **change: Any) -> np.ndarray:
    t, values = signals(seconds, seed, **change)
    table = np.zeros(len(t), dtype=row_dtype(2))
    table["time"], table["cycle"] = t, np.arange(len(t))
    table["values"] = np.column_stack([values[name] for name in NAMES])
    return table


@pytest.fixture(scope="module")
def live() -> LiveModel:
    made = session()
    return LiveModel(handed_over(made))


def watched(live: LiveModel, table: np.ndarray, memory: Path) -> list[dict[str, Any]]:
    cutter = Windows(live.overlap, live.block_samples(RULES.block_s))
    order = Order("identification", Path("r"), Path("m"), "ring", memory, RULES)
    said: list[dict[str, Any]] = []
    watch(
        Efforts(live, RULES), NAMES, order, cutter.push(table), lambda found: said.append(json.loads(json.dumps(found)))
    )
    return said


@pytest.mark.slow
def test_it_is_quiet_for_long_and_finds_a_change_of_friction(live: LiveModel, tmp_path: Path) -> None:
    """Twenty minutes without a word; then two thirds of a newton metre more friction, a tenth of what there was."""
    coulomb = np.where(np.arange(1500 * 50) < 1200 * 50, COULOMB, COULOMB * 1.1)
    said = watched(live, rows(1500, 11, coulomb=coulomb), tmp_path / "memory.json")
    states = [found["state"] for found in said]
    times = np.array([found["time"] for found in said])
    assert set(states) == {"learning", "watching", "drift"}
    first = times[states.index("drift")]
    assert 1200 < first < 1290
    assert said[states.index("drift")]["joints"][0]["statistic"] == "direction"
    assert said[states.index("drift")]["drifting"] == ["joint1"]
    assert said[-1]["joints"][0]["unit"] == "N m"
    assert said[-1]["joints"][0]["false_alarms_per_year"] == pytest.approx(1.0)


@pytest.mark.slow
def test_what_was_learnt_is_not_learnt_again(live: LiveModel, tmp_path: Path) -> None:
    memory = tmp_path / "memory.json"
    first = watched(live, rows(200, 12), memory)
    assert first[-1]["state"] == "watching"
    assert watched(live, rows(30, 13), memory)[0]["state"] == "watching"
    for torn in ("torn {", "[]", '{"series": {"joint1/offset": 1}, "drifting": []}'):
        memory.write_text(torn)
        assert watched(live, rows(30, 13), memory)[0]["state"] == "learning"


def test_a_silent_channel_is_a_pause_and_no_drift(live: LiveModel, tmp_path: Path) -> None:
    table = rows(60, 14)
    table["quality"][500:600, 1] = 1
    said = watched(live, table, tmp_path / "memory.json")
    assert [found["joints"][0]["residual"] for found in said].count(None) >= 1
    assert all(found["state"] == "learning" for found in said)


def test_an_order_is_the_same_after_json() -> None:
    order = Order("valves", Path("/a/request.json"), Path("/b/1.yaml"), "ring", Path("/c.json"), RULES)
    assert Order.from_json(order.to_json()) == order


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data directory with one finished identification, as the jobs leave it."""
    root = tmp_path_factory.mktemp("data")
    files = DataDirectory(root)
    output = files.identifications / "ident-1"
    output.mkdir()
    machine = files.machine_file("lever", 1)
    machine.parent.mkdir()
    machine.write_text(MACHINE)
    made = session()
    recordings = []
    for seed, (role, seconds) in enumerate([("train", 60.0), ("validate", 40.0)], start=1):
        data = recording(seconds, seed, role)
        path = write_recording(files.recordings / f"{role}.parquet", made.machine, role, data.time, dict(data.values))
        recordings.append([role, str(path)])
    content = {
        "machine": str(machine),
        "recordings": recordings,
        "output": str(output),
        "options": {"loop": False, "bandwidth_hz": 3.0},
    }
    (output / "request.json").write_text(json.dumps(content))
    for stage in STAGES:
        run_stage(stage, load_request(output / "request.json"))
    return root


@pytest.mark.slow
def test_a_stored_identification_gives_the_model_that_was_fitted(identified: Path, live: LiveModel) -> None:
    loaded = LiveModel.load(identified / "identifications" / "ident-1")
    t, values = signals(20, 21)
    (first,), (second,) = loaded.evaluate(t, values) or (), live.evaluate(t, values) or ()
    np.testing.assert_allclose(first.residual, second.residual, atol=1e-3)


def test_a_lost_result_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(NotLiveError, match="identify again"):
        LiveModel.load(tmp_path)


class World:
    """What monitors find around them, in a test's hands."""

    def __init__(self, root: Path) -> None:
        self.files = DataDirectory(root)
        self.database = Database(root / "monitor-test.sqlite", TABLES, changed=lambda: None)
        self.alarms = Alarms(self.database)
        self.calibration: str | None = "cal-1"
        self.ring_name: str | None = None
        self.asked: list[tuple[str, str]] = []
        self.monitors = Monitors(
            self,
            self,
            self,
            self.files,
            {"identification": lambda id: self.files.identifications / id / "model.json"},
            self.alarms,
            self.database.now,
            recalibrate=self._recalibrate,
            rules=RULES,
        )

    def active(self, machine: str, of: str) -> Any:
        return None if self.calibration is None else SimpleNamespace(id=self.calibration, source="ident-1")

    def names(self) -> tuple[str, ...]:
        return ("lever",)

    def running(self, name: str) -> bool:
        return self.ring_name is not None

    def feed(self, name: str) -> Any:
        if self.ring_name is None:
            raise UnavailableError("not running")
        return None, SimpleNamespace(ring_name=self.ring_name)

    def get(self, name: str) -> Any:
        return SimpleNamespace(version=1)

    def _recalibrate(self, machine: str, reason: str) -> None:
        self.asked.append((machine, reason))
        raise ConflictError("no schedule says how")

    def wait(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        pause = threading.Event()
        for _ in range(600):
            if condition(state := self.monitors.state("lever")):
                return state
            pause.wait(0.1)
        raise AssertionError(state)


@pytest.fixture
def world(identified: Path) -> Iterator[World]:
    made = World(identified)
    try:
        yield made
    finally:
        made.monitors.stop()
        made.database.close()
        (identified / "monitor-test.sqlite").unlink()


def test_a_monitor_that_is_off_says_why(world: World) -> None:
    world.monitors.look()
    reason, message = "the machine is not acquired at the moment", {"code": "server.not_acquired_now", "values": {}}
    assert world.monitors.state("lever") == {
        "state": "off",
        "reason": reason,
        "reason_message": message,
        "valves": {"state": "off", "reason": reason, "reason_message": message},
    }
    world.ring_name, world.calibration = "some", None
    world.monitors.look()
    state = world.monitors.state("lever")
    assert state["reason"] == "the machine has no active calibration"
    assert state["valves"]["reason"] == "the machine has no active calibration of its valves"


def test_its_reason_names_files_below_the_data_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(tmp_path)
    missing = world.files.identifications / "ident-1" / "model.json"
    result = ChildResult("input", error=f"{missing}: no such file")
    monkeypatch.setattr(monitor_supervisor, "run_child", lambda *command, **options: result)
    world.ring_name = "some"
    try:
        world.monitors._directory.mkdir(exist_ok=True)
        world.monitors.look()
        state = world.wait(lambda state: state["state"] == "off")
        assert state["reason"] == "identifications/ident-1/model.json: no such file"
    finally:
        world.monitors.stop()
        world.database.close()


@pytest.mark.slow
def test_from_a_ring_through_a_process_to_an_alarm(world: World) -> None:
    change = 160 * RATE
    coulomb = np.where(np.arange(400 * 50) < change, COULOMB, COULOMB * 1.5)
    table = rows(400, 31, coulomb=coulomb)
    with ring_buffer(row_dtype(2), 60000) as name, RingWriter(name) as writer:
        world.ring_name = name
        world.monitors.look()
        writer.write(frame_from_row(table[0]))  # the process sees what comes after it attached
        world.wait(lambda state: "delay_s" in state)
        for row in table[1:]:
            writer.write(frame_from_row(row))
        state = world.wait(lambda state: state["state"] == "drift")
        assert (state["calibration"], state["joints"][0]["statistic"]) == ("cal-1", "direction")
        # The state is there first, its alarm after it; an overload may come before both.
        world.wait(lambda _: any(alarm.kind == "residual_drift" for alarm in world.alarms.active()))
        alarm = next(alarm for alarm in world.alarms.active() if alarm.kind == "residual_drift")
        assert alarm.machine == "lever"
        assert "joint1" in alarm.text
        # The drift is shown before a recalibration is asked for. So much more friction is an overload as well.
        wanted = {"residual_drift", "recalibration_failed"}
        world.wait(lambda state: {a.kind for a in world.alarms.active()} - {"overload"} == wanted)
        assert [machine for machine, _ in world.asked] == ["lever"]
        world.calibration = None  # a new calibration is being made: the old one's drift is over
        world.monitors.look()
        assert {alarm.kind for alarm in world.alarms.active()} == {"recalibration_failed"}


def test_the_process_ends_with_the_ring(identified: Path, tmp_path: Path) -> None:
    said: list[Any] = []
    model = identified / "identifications" / "ident-1" / "model.json"
    with ring_buffer(row_dtype(2), 64) as name, RingWriter(name) as writer:
        writer.finish()
        order = Order(
            "identification", model, identified / "machines" / "lever" / "1.yaml", name, tmp_path / "m.json", RULES
        )
        child.run(order, said.append)
    assert [found["state"] for found in said] == ["learning"]


def test_a_channel_that_the_machine_lost_is_named(identified: Path, tmp_path: Path) -> None:
    changed = tmp_path / "machine.yaml"
    changed.write_text(MACHINE.replace("joint1.torque", "joint1.effort"))
    model = identified / "identifications" / "ident-1" / "model.json"
    with pytest.raises(NotLiveError, match=r"no channel joint1\.torque"):
        child.run(Order("identification", model, changed, "none", tmp_path / "m.json", RULES), lambda found: None)
