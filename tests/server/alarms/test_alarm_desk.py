"""Alarms as the service keeps them: over restarts, over HTTP, and what watches raise them."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from service_fakes import API, MACHINE, Running

from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_resource import WARNING, Watch, named, stale_channels
from server.composition.declarations import TABLES
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, UnavailableError
from server.platform.files import RESERVE_BYTES, free_bytes, require_room
from server.recordings.recording_sessions import Sessions


class Bench:
    """A desk with clocks that a test turns."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seconds = 0.0
        self.wall = datetime(2026, 1, 1, tzinfo=UTC)
        self.changes = 0
        self._open()

    def restart(self) -> None:
        self.database.close()
        self._open()

    def _open(self) -> None:
        self.database = Database(self.path, TABLES, clock=lambda: self.wall, changed=lambda: None)
        self.desk = Alarms(self.database, lambda: self.seconds)

    def wait(self, seconds: float) -> None:
        self.seconds += seconds
        self.wall += timedelta(seconds=seconds)

    def report(self, on: bool, kind: str = "channel_stale", machine: str | None = "lever") -> None:
        self.desk.report(machine, kind, "no measurement", "warning", on)

    def all(self) -> list[tuple[str, int]]:
        return [(alarm.state, alarm.count) for alarm in self.desk.list(50).items]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "store.sqlite")
    yield bench
    bench.database.close()


def test_an_alarm_is_raised_and_cleared_after_its_delays(bench: Bench) -> None:
    for seconds, on, expected in [
        (0, True, []),
        (2.9, True, []),
        (0.2, True, [("active", 1)]),
        (0, False, [("active", 1)]),
        (5, False, [("cleared", 1)]),
        (0, True, [("cleared", 1)]),
        (3, True, [("active", 2)]),
    ]:
        bench.wait(seconds)
        bench.report(on)
        assert bench.all() == expected


def test_a_repeated_report_of_an_alarm_writes_nothing(bench: Bench) -> None:
    bench.report(True, "residual_drift")
    before = bench.database.revisions()
    for _ in range(5):
        bench.wait(1)
        bench.report(True, "residual_drift")
    assert bench.database.revisions() == before == {"alarms": 1}


def test_machines_kinds_and_the_service_as_a_whole_are_apart(bench: Bench) -> None:
    bench.report(True, "residual_drift", "lever")
    bench.report(True, "residual_grew", "lever")
    bench.report(True, "residual_drift", "other")
    bench.report(True, "disk_full", None)
    bench.report(False, "residual_drift", "other")
    active = {(alarm.machine, alarm.kind) for alarm in bench.desk.active()}
    assert active == {("lever", "residual_drift"), ("lever", "residual_grew"), (None, "disk_full")}
    assert [a.machine for a in bench.desk.list(50, machines=("other",)).items] == ["other"]


def test_an_alarm_outlives_a_restart_and_goes_when_its_cause_has(bench: Bench) -> None:
    bench.report(True, "residual_drift")
    bench.restart()
    assert bench.all() == [("active", 1)]
    bench.report(False, "residual_drift")
    assert bench.all() == [("cleared", 1)]


def test_a_clock_that_is_set_shortens_no_delay(bench: Bench) -> None:
    bench.report(True)
    bench.wall += timedelta(days=365)
    bench.report(True)
    assert bench.all() == []


def test_an_expired_shelf_is_ended_by_the_sweep(bench: Bench) -> None:
    bench.report(True, "residual_drift")
    id = bench.desk.active()[0].id
    bench.desk.shelve(id, "Ada", "known", 60)
    bench.wait(59)
    bench.desk.sweep()
    assert bench.desk.get(id).shelved_until is not None
    bench.wait(1)
    bench.desk.sweep()
    assert bench.desk.get(id).shelved_until is None


class Acquisitions:
    """Machines in the states that a test gives them."""

    def __init__(self) -> None:
        self.states = {"lever": "running"}
        self.quality = {"joint1.angle": "fresh", "joint1.torque": "late"}

    def names(self) -> tuple[str, ...]:
        return tuple(self.states)

    def statistics(self, name: str) -> dict[str, Any]:
        return {"state": self.states[name], "error": "the bus is gone"}

    def latest(self, name: str) -> dict[str, Any]:
        if not self.quality:
            raise UnavailableError("nothing yet")
        return {"channels": {name: {"quality": quality} for name, quality in self.quality.items()}}


class Surroundings(Bench):
    """A watch whose world a test makes."""

    def _open(self) -> None:
        super()._open()
        self.acquisitions = Acquisitions()
        self.free = 10 * 2**30
        self.ended = 0
        self.watch = Watch(
            self.acquisitions,
            self.desk,
            lambda: self.free,
            self._end,
            wall=lambda: self.wall.timestamp(),
            monotonic=lambda: self.seconds,
        )

    def _end(self) -> None:
        self.ended += 1

    def look(self, times: int = 20) -> list[tuple[str, str]]:
        for _ in range(times):
            self.wait(1)
            for look in (self.watch.disk, self.watch.acquisitions, self.watch.clock):
                look()
        return sorted((alarm.kind, alarm.severity) for alarm in self.desk.active())


@pytest.fixture
def world(tmp_path: Path) -> Iterator[Surroundings]:
    world = Surroundings(tmp_path / "store.sqlite")
    yield world
    world.database.close()


def test_a_sound_machine_raises_no_alarm(world: Surroundings) -> None:
    assert world.look() == []
    assert world.ended == 0


def test_a_silent_channel_is_named(world: Surroundings) -> None:
    world.acquisitions.quality["joint1.torque"] = "stale"
    assert world.look() == [("channel_stale", "warning")]
    assert "joint1.torque" in world.desk.active()[0].text
    assert world.desk.active()[0].machine == "lever"
    world.acquisitions.quality["joint1.torque"] = "fresh"
    assert world.look() == []


def test_acquisition_that_is_down_is_one_alarm_and_not_one_per_channel(world: Surroundings) -> None:
    world.acquisitions.states["lever"] = "waiting"
    world.acquisitions.quality["joint1.torque"] = "stale"
    assert world.look(14) == []
    assert world.look() == [("acquisition_down", "critical")]
    assert "the bus is gone" in world.desk.active()[0].text


def test_a_machine_that_is_no_longer_acquired_has_no_alarm(world: Surroundings) -> None:
    world.acquisitions.states["lever"] = "waiting"
    assert world.look(30)
    world.restart()
    world.acquisitions.states.clear()
    assert world.look() == []


def test_a_frame_that_is_not_there_yet_is_no_alarm(world: Surroundings) -> None:
    world.acquisitions.quality.clear()
    assert world.look() == []


def test_recordings_end_before_the_disk_is_full_and_the_alarm_has_a_dead_band(world: Surroundings) -> None:
    world.free = RESERVE_BYTES + round(WARNING.comes)
    assert world.look() == [("disk_full", "warning")]
    assert world.ended == 0
    world.free = RESERVE_BYTES + round((WARNING.comes + WARNING.goes) / 2)
    assert world.look() == [("disk_full", "warning")]
    world.free = RESERVE_BYTES
    assert world.look(1) == [("disk_full", "critical")]
    assert world.ended == 1
    world.free = 10 * 2**30
    assert world.look() == []


def test_a_clock_that_was_set_raises_one_alarm_only(world: Surroundings) -> None:
    world.look(1)
    world.wall += timedelta(hours=-3)
    assert world.look() == []
    told = world.desk.list(50).items
    assert [(alarm.kind, alarm.state, alarm.count) for alarm in told] == [("clock_jumped", "cleared", 1)]
    assert "-10800 s" in told[0].text


def test_journals_count_as_used_disk_space(tmp_path: Path) -> None:
    before = free_bytes(tmp_path)
    (tmp_path / "a.journal").write_bytes(b"x" * 2**20)
    assert free_bytes(tmp_path) <= before - 2**20 + 2**19  # others write to this disk too
    with pytest.raises(ConflictError, match="delete recordings"):
        require_room(RESERVE_BYTES)
    require_room(RESERVE_BYTES + 1)


def test_long_lists_of_channels_are_shortened() -> None:
    assert named(["a", "b"]) == "a, b"
    assert named("abcde") == "a, b, c and 2 more"
    frame = {
        "channels": {q: {"quality": q} for q in ("fresh", "late", "out_of_range", "stale", "missing", "bus_error")}
    }
    assert stale_channels(frame) == ("stale", "missing", "bus_error")


@pytest.mark.slow
def test_an_alarm_is_read_acknowledged_and_shelved_over_http(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    running.service[Alarms].report("lever", "residual_drift", "joint1 drifts", "warning", True)
    alarm = running.client.get(f"{API}/alarms", params={"machine": "lever", "state": "active"}).json()["items"][0]
    assert (alarm["kind"], alarm["acknowledged"], alarm["count"]) == ("residual_drift", False, 1)
    path = f"{API}/alarms/{alarm['id']}"
    assert running.client.post(f"{path}/acknowledge").json()["acknowledged"] is True
    shelved = running.client.post(f"{path}/shelve", json={"seconds": 60, "reason": "known"}).json()
    assert shelved["shelve_reason"] == "known"
    assert running.client.post(f"{path}/unshelve").json()["shelved_until"] is None
    assert running.client.get(path).json()["acknowledged_by"]
    for body in ({"seconds": 0, "reason": "x"}, {"seconds": 60, "reason": ""}, {"seconds": 1e9, "reason": "x"}, {}):
        assert running.client.post(f"{path}/shelve", json=body).status_code == 422
    for action in ("acknowledge", "unshelve"):
        assert running.client.post(f"{API}/alarms/alarm-none/{action}").status_code == 404


@pytest.mark.slow
def test_a_full_disk_refuses_a_recording_and_still_takes_an_acknowledgement(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    monkeypatch.setattr(running.service[Sessions], "free", lambda: 5)
    refused = running.client.post(f"{API}/recordings", json={"machine": "lever", "role": "train"})
    assert refused.status_code == 409
    assert "disk is full" in refused.json()["detail"]
    running.service[Alarms].report(None, "disk_full", "full", "critical", True)
    alarm = running.client.get(f"{API}/alarms", params={"state": "active"}).json()["items"][0]
    assert running.client.post(f"{API}/alarms/{alarm['id']}/acknowledge").status_code == 200
