"""The store: versions, uniqueness under concurrency, pages, progress that never goes back, files of another version."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from service_fakes import MACHINE, file_children

from daq.messages import Sentence, named
from server.composition.declarations import TABLES
from server.identifications.identification_store import Identification, Identifications
from server.jobs.job_store import Jobs
from server.machines.machine_store import Machines
from server.machines.machine_uploads import MachineReader, MachineUploads
from server.platform.database import schema
from server.platform.database.engine import Database
from server.platform.database.idempotency import IdempotencyKey
from server.platform.errors import ConflictError, StartError
from server.platform.files import DataDirectory
from server.recordings.recording_store import RecordingRow, Recordings

NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)


def nothing() -> None:
    """Nobody waits for changes here."""


@pytest.fixture
def files(tmp_path: Path) -> DataDirectory:
    return DataDirectory(tmp_path)


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def database(files: DataDirectory, request: pytest.FixtureRequest) -> Iterator[Database]:
    """The same store on either; a new one for each test."""
    sqlite = request.param == "sqlite"
    place = files.database if sqlite else request.getfixturevalue("postgresql").new_database()
    database = Database(place, TABLES, clock=lambda: NOON, changed=nothing)
    yield database
    database.close()


def recording(id: str, **changes: object) -> RecordingRow:
    values = {
        "id": id,
        "machine": "lever",
        "machine_version": 1,
        "role": "train",
        "label": "",
        "state": "recording",
        "origin": "recorded",
        "format": "parquet",
        "created": "2026-01-01T12:00:00.000Z",
    }
    return RecordingRow(**{**values, **changes})  # type: ignore[arg-type]


def at_once(count: int, action: Callable[[int], object]) -> list[object]:
    """Run ``action(0..count-1)`` in threads that start together; results or errors in order."""
    results: list[object] = [None] * count
    barrier = threading.Barrier(count)

    def run(number: int) -> None:
        barrier.wait(30)
        try:
            results[number] = action(number)
        except ConflictError as error:
            results[number] = error

    threads = [threading.Thread(target=run, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def test_sqlite_is_set_up_to_survive_a_power_cut(files: DataDirectory) -> None:
    with closing(Database(files.database, TABLES, changed=nothing)) as store, store.read() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "delete"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2  # FULL
        assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1


@pytest.mark.parametrize("began", ["before it is closed", "afterwards"])
def test_who_is_late_leaves_no_connection_of_a_closed_store_open(database: Database, began: str) -> None:
    if began == "afterwards":
        database.close()
    with database.read() as connection:
        driver = connection.connection.dbapi_connection
        errors = connection.dialect.loaded_dbapi.Error
        if began != "afterwards":
            database.close()
        assert connection.exec_driver_sql("SELECT 1").scalar() == 1, "what was begun is ended"
    assert driver is not None
    with pytest.raises(errors, match="closed"):
        driver.cursor().execute("SELECT 1")


@pytest.mark.slow
def test_uploads_at_once_get_versions_of_their_own(database: Database, files: DataDirectory) -> None:
    reader = MachineReader(files, file_children())
    uploads = MachineUploads(database, files, reader)
    texts = [MACHINE.replace("rate_hz: 50", f"rate_hz: {50 + number}").encode() for number in range(6)]
    at_once(6, lambda number: uploads.add(texts[number]))
    assert [row.version for row in Machines(database).versions("lever")] == [6, 5, 4, 3, 2, 1]
    stored = {files.machine_file("lever", version).read_bytes() for version in range(1, 7)}
    assert stored == set(texts)


def test_of_two_recordings_started_at_once_one_is_refused(database: Database) -> None:
    Machines(database).add("lever", 1, "hash")
    recordings = Recordings(database)
    results = at_once(4, lambda number: recordings.add(recording(f"rec-{number}")))
    assert sum(result is None for result in results) == 1
    assert all(result is None or "already" in str(result) for result in results)


def test_one_idempotency_key_makes_one_identification_also_at_once(database: Database) -> None:
    Machines(database).add("lever", 1, "hash")
    Recordings(database).add(recording("rec-1", state="sealed"))
    identifications, jobs = Identifications(database), Jobs(database)

    def order(number: int) -> object:
        new = Identification(
            id=f"idn-{number}",
            job=f"job-{number}",
            machine="lever",
            machine_version=1,
            label="",
            recordings=(("rec-1", "train"),),
            options={},
            created=database.now(),
        )
        return jobs.order(identifications, new, "identification", ("a",), IdempotencyKey("key", "same request"))

    assert len({str(result) for result in at_once(4, order)}) == 1
    assert len(jobs.list(10).items) == 1


def job(database: Database, id: str = "job-1") -> Jobs:
    jobs = Jobs(database)
    with database.write("jobs") as connection:
        jobs.insert(connection, id=id, kind="identification", label="", subject="idn", stages=("a", "b"))
    return jobs


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(fractions=st.lists(st.floats(-1, 2), max_size=8))
def test_progress_never_goes_back_and_events_have_no_hole(
    tmp_path_factory: pytest.TempPathFactory, fractions: list[float]
) -> None:
    with closing(Database(tmp_path_factory.mktemp("store") / "s.sqlite", TABLES, changed=nothing)) as store:
        jobs = job(store)
        for fraction in fractions:
            assert jobs.progress("job-1", "a", fraction, "works")
        assert jobs.finish("job-1", "done", "Done")
        assert not jobs.finish("job-1", "failed", "Failed"), "a job ends once"
        events = jobs.events("job-1")
        assert [event.number for event in events] == list(range(1, len(fractions) + 3))
        seen = [event.fraction for event in events]
        assert seen == sorted(seen)
        assert all(0 <= fraction <= 1 for fraction in seen)
        assert jobs.events("job-1", after=len(events) - 1) == events[-1:]
        assert not jobs.progress("job-1", "a", 0.5, "too late")


def test_a_page_ends_where_the_next_begins(database: Database) -> None:
    for number in range(5):
        job(database, f"job-{number}")
    jobs = Jobs(database)
    first = jobs.list(2)
    assert first.next is not None
    second = jobs.list(2, first.next)
    assert second.next is not None
    third = jobs.list(2, second.next)
    ids = [entry.id for page in (first, second, third) for entry in page.items]
    assert ids == ["job-4", "job-3", "job-2", "job-1", "job-0"]
    assert third.next is None


def test_times_are_utc(database: Database) -> None:
    assert database.now() == "2026-01-01T12:00:00.000Z"


def test_a_store_of_another_version_is_refused(database: Database, files: DataDirectory) -> None:
    with database.write() as connection:
        connection.execute(schema.store_version.update().values(version=99))
    place = files.database if database.is_sqlite else database.url
    with pytest.raises(StartError, match="version 99"):
        Database(place, TABLES, changed=nothing)


def test_a_file_that_is_no_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "hilfit.sqlite"
    path.write_text("hello " * 1000)
    with pytest.raises(StartError, match="cannot be opened as the store"):
        Database(path, TABLES, changed=nothing)


def test_sentences_are_kept_with_what_they_were_made_of(tmp_path: Path) -> None:
    with closing(Database(tmp_path / "store", TABLES, changed=nothing)) as database:
        jobs = Jobs(database)
        with database.write("jobs") as connection:
            jobs.insert(connection, id="job-1", kind="demo", label="", subject="s", stages=("a",))
        jobs.progress("job-1", "a", 0.1, "as somebody wrote it")
        assert (jobs.get("job-1").text_message, jobs.get("job-1").sentence("text")) == (None, "as somebody wrote it")
        error = named("arm.yaml", Sentence("server.took_longer", timeout_s=3.5))
        jobs.finish("job-1", "failed", Sentence("server.failed"), error)
        found = jobs.get("job-1")
        assert (found.text, found.error) == ("Failed", "arm.yaml: took longer than 3.5 s and was ended")
        again = found.sentence("error")
        assert (
            isinstance(again, Sentence) and again.worded("de") == "arm.yaml: dauerte länger als 3,5 s und wurde beendet"
        )
        messages = [event.text_message for event in jobs.events("job-1")]
        assert [None if own is None else own.code for own in messages] == ["server.waiting_turn", None, "server.failed"]
