"""A full disk, a store that takes no writes, a clock that was set: nothing is lost, and it goes on by itself."""

from __future__ import annotations

import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import sqlalchemy as sa
from dbos import DBOS
from postgresql_server import PostgreSQL
from recalibration_fakes import setting
from service_fakes import API, MACHINE, Fakes, motion, ran, running_service

from daq import parse_machine, write_recording
from daq.acquisition.journal import journal_path
from daq.errors import DiskFullError
from server.composition.declarations import TABLES
from server.jobs import execution
from server.machines.acquisition import Acquisition
from server.platform.database.engine import Database, utc_now
from server.platform.database.patience import away
from server.recordings import recording_sessions
from server.recordings.recording_resource import FREE, RECORDER
from server.recordings.recording_sessions import RecordOrder
from server.schedules.schedule_store import Schedules


def nothing() -> None:
    """Nobody waits for changes here."""


def pragma(connection: sqlite3.Connection, text: str) -> None:
    connection.execute(f"PRAGMA {text}")


def test_the_error_of_a_refused_write_holds_no_lock(tmp_path: Path) -> None:
    # A full disk ends the statement, not the transaction, where a statement writes several rows.
    many = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 1000) INSERT INTO revisions "
    place = tmp_path / "store.sqlite"
    database = Database(place, TABLES, changed=nothing)
    with pytest.raises(sa.exc.DBAPIError) as caught, database.write() as connection:
        connection.exec_driver_sql("PRAGMA max_page_count=1")
        half_read = connection.execute(sa.text("SELECT 1 UNION ALL SELECT 2"))
        assert half_read.fetchone() == (1,)
        connection.exec_driver_sql(f"{many} SELECT i || hex(randomblob(500)), 1 FROM n")
    assert away(caught.value), "and its traceback holds the statements"
    with closing(sqlite3.connect(place, timeout=0.1)) as other:
        other.execute("BEGIN IMMEDIATE")
    database.close()


@pytest.mark.parametrize("text", ["query_only=ON", "max_page_count=1"])
def test_a_store_that_takes_no_writes_is_away_and_not_broken(tmp_path: Path, text: str) -> None:
    database = Database(tmp_path / "store.sqlite", TABLES, changed=nothing)
    refuse = database._engine
    refuse.dispose()
    listener = lambda connection, _record: pragma(connection, text)  # noqa: E731
    sa.event.listen(refuse, "connect", listener)
    with pytest.raises(sa.exc.DBAPIError) as caught, database.write() as connection:
        for number in range(1000):  # more than the pages that there are
            row = {"resource": f"{number} {'x' * 1000}", "number": 1}
            connection.execute(sa.text("INSERT INTO revisions VALUES (:resource, :number)"), row)
    assert away(caught.value) and caught.value.connection_invalidated, "the workflow engine waits for it, too"
    sa.event.remove(refuse, "connect", listener)
    with database.write("jobs"):
        pass
    assert database.revisions() == {"jobs": 1}
    database.close()


@contextmanager
def read_only(place: PostgreSQL | None) -> Iterator[None]:
    """Of all sessions of this process: SQLite's by a pragma, or those of the whole server."""
    if place is not None:
        place.set("default_transaction_read_only", "on")
        try:
            yield
        finally:
            place.set("default_transaction_read_only", None)
        return
    refusing = [True]

    def begun(connection: sa.Connection) -> None:
        # Before the transaction: the listener of the engine itself comes later.
        raw = connection.connection.dbapi_connection
        if isinstance(raw, sqlite3.Connection):
            pragma(raw, f"query_only={'ON' if refusing[0] else 'OFF'}")

    sa.event.listen(sa.Engine, "begin", begun)
    try:
        yield
    finally:
        refusing[0] = False
        # It stays, so that connections that were told so are told otherwise.


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_job_outlives_a_store_that_is_read_only_when_its_stage_ends(
    tmp_path: Path, csv: bytes, kind: str, request: pytest.FixtureRequest
) -> None:
    server = request.getfixturevalue("postgresql") if kind == "postgresql" else None
    url = None if server is None else server.new_database()
    with running_service(tmp_path / "data", Fakes(), database_url=url) as running:
        order = running.order(csv, block="cylinder_stage")
        running.follow(order.job, lambda event: event["text"] == "Half of cylinder_stage")
        directory = running.service.files.identifications / order.id
        with read_only(server):
            (directory / "go").touch()
            deadline = time.monotonic() + 60
            refused = 0
            while refused < 3 and time.monotonic() < deadline:  # long enough for the end of the stage to be refused
                answer = running.client.post(f"{API}/machines", content=MACHINE.replace("rate_hz: 50", "rate_hz: 40"))
                refused += answer.status_code == 503
                time.sleep(0.5)
            assert refused == 3
            assert running.client.get("/livez").status_code == 200
        assert running.follow(order.job)[-1]["state"] == "done"
        assert ran(running, order.id) == ["check", "cylinder_stage", "report"]


@pytest.mark.slow
def test_a_stage_that_found_the_disk_full_is_begun_again_when_there_is_room(
    tmp_path: Path, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = [2**40]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free[0]))
    steer = tmp_path / "data" / "steer.json"
    with running_service(tmp_path / "data", Fakes()) as running:
        running.choices(csv)
        free[0] = 0
        steer.write_text('{"crash": "cylinder_stage"}')
        order = running.order(csv)
        running.follow(order.job, lambda event: event["text"] == execution.NO_ROOM)
        steer.unlink()
        free[0] = 2**40
        assert running.follow(order.job)[-1]["state"] == "done"
        assert ran(running, order.id)[-2:] == ["cylinder_stage", "report"]
        # And one that waits can be cancelled.
        steer.write_text('{"crash": "cylinder_stage"}')
        free[0] = 0
        second = running.order(csv)
        running.follow(second.job, lambda event: event["text"] == execution.NO_ROOM)
        running.client.post(f"{API}/jobs/{second.job}/cancel")
        assert running.follow(second.job)[-1]["state"] == "cancelled"
        until(lambda: DBOS.get_workflow_status(second.job).status == "SUCCESS")


@pytest.mark.slow
def test_a_service_that_starts_on_a_full_disk_waits_for_room(
    tmp_path: Path, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    register = DBOS.register_queue
    refused: list[Any] = []

    def refusing(*names: Any, **settings: Any) -> Any:
        if len(refused) < 2:
            refused.append(names)
            raise sa.exc.OperationalError("INSERT", {}, sqlite3.OperationalError("database or disk is full"))
        return register(*names, **settings)

    monkeypatch.setattr(DBOS, "register_queue", refusing)
    with running_service(tmp_path / "data", Fakes()) as running:
        assert len(refused) == 2
        assert running.follow(running.order(csv).job)[-1]["state"] == "done"


class FullRecorder:
    """Writes a journal, and finds the disk full until there is room."""

    def __init__(self) -> None:
        self.room, self.free = False, 2**40

    def record(self, order: RecordOrder) -> dict[str, Any]:
        order.report({"rows": 500})
        self.free = 0
        journal_path(order.path).write_bytes(b"rows")
        raise DiskFullError(f"{order.path}: sealing failed (the disk is full)", "sealing")

    def recover(self, directory: Path) -> Mapping[Path, int]:
        found = {}
        for journal in directory.glob("*.journal") if self.room else ():
            path = journal.with_suffix("")
            write_recording(path, parse_machine(MACHINE), "train", *motion(10))
            journal.unlink()
            found[path] = 500
        return found


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize("restarted", [False, True])
def test_counted_rows_are_sealed_once_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, restarted: bool
) -> None:
    monkeypatch.setattr(recording_sessions, "PAUSE_S", 0.05)
    fakes, recorder = Fakes(), FullRecorder()
    fakes.parts |= {RECORDER: recorder, FREE: lambda: recorder.free}
    data = tmp_path / "data"
    with running_service(data, fakes) as running:
        running.client.post(f"{API}/machines", content=MACHINE)
        running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": True})
        until(lambda: running.service[Acquisition].running("lever"))
        body = {"machine": "lever", "role": "train"}
        started = running.client.post(f"{API}/recordings", json=body)
        place = f"{API}/recordings/{started.json()['id']}"
        assert running.client.get(place).json()["state"] == "recording", started.text
        if not restarted:
            recorder.room = True
            until(lambda: running.client.get(place).json()["state"] == "sealed")
    if restarted:
        with running_service(data, fakes) as running:
            assert running.client.get(place).json()["state"] == "recording"
            recorder.room = True
            until(lambda: running.client.get(place).json()["state"] == "sealed")
            assert running.client.get(place).json()["statistics"] == {"rows": 500, "recovered": True}


def test_the_clock_of_the_service_is_that_of_the_computer() -> None:
    assert abs(utc_now() - datetime.now(UTC)) < timedelta(minutes=1) and utc_now().tzinfo is UTC


@pytest.mark.slow
def test_a_clock_that_was_wrong_by_years_stops_no_schedule_and_gives_no_slot_a_second_turn(tmp_path: Path) -> None:
    with setting(tmp_path / "data") as site:
        schedule = site.schedule()
        right = site.time
        assert len(site.later(1.0)) == 1
        site.running.client.post(f"{API}/jobs/{site.service[Schedules].slots(schedule.id, 1)[0].job}/cancel")
        until(lambda: not site.service[Schedules].busy("lever"))
        site.time = right + timedelta(days=900)
        assert len(site.clock.look()) == 1
        site.running.client.post(f"{API}/jobs/{site.service[Schedules].slots(schedule.id, 1)[0].job}/cancel")
        until(lambda: not site.service[Schedules].busy("lever"))
        site.time = right  # somebody sets it right
        assert site.clock.look() == ()
        assert site.later(1.5) == (), "this slot had its turn"
        assert len(site.later(1.0)) == 1, "and the next one has it"


@pytest.mark.slow
def test_a_disk_that_was_full_while_a_stage_ran_is_why_it_failed(
    tmp_path: Path, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = [2**40]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free[0]))
    with running_service(tmp_path / "data", Fakes()) as running:
        running.choices(csv)
        steer = tmp_path / "data" / "steer.json"
        steer.write_text('{"block": "cylinder_stage", "fail": ["cylinder_stage", 1, "odd"]}')
        order = running.order(csv)
        running.follow(order.job, lambda event: event["text"] == "Half of cylinder_stage")
        free[0] = 0
        time.sleep(1.0)  # some looks of the runner
        free[0] = 2**40
        steer.unlink()
        (running.service.files.identifications / order.id / "go").touch()
        assert running.follow(order.job)[-1]["state"] == "done"
        assert ran(running, order.id) == ["check", "cylinder_stage", "cylinder_stage", "report"]
