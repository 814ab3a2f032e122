"""What a service finds at its start of what another one left behind (kills are in test_server_process)."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest
from acquired_machines import acquire
from dbos import DBOS
from service_fakes import API, MACHINE, Fakes, Running, running_service

from server.jobs.claims import Claim, Claims
from server.jobs.job_runner import JobRunner
from server.jobs.job_store import Jobs
from server.machines.acquisition import Acquisition
from server.platform.database.engine import Database
from server.recordings.recording_store import RecordingRow, Recordings, recordings

pytestmark = pytest.mark.slow

RECORDINGS = f"{API}/recordings"


def test_stopping_the_service_seals_what_is_being_recorded(tmp_path: Path) -> None:
    with running_service(tmp_path, Fakes()) as first:
        acquire(first, "lever")
        id = first.client.post(RECORDINGS, json={"machine": "lever", "role": "train"}).json()["id"]
        assert first.client.get(f"{RECORDINGS}/{id}").json()["statistics"] == {"rows": 1}
    with running_service(tmp_path, Fakes()) as second:
        assert second.client.get(f"{RECORDINGS}/{id}").json()["state"] == "sealed"
        # A machine that was acquired is acquired again.
        assert second.service[Acquisition].names() == ("lever",)


def test_a_cut_recording_is_recovered_at_the_next_start(tmp_path: Path) -> None:
    with running_service(tmp_path, Fakes()) as first:
        first.client.post(f"{API}/machines", content=MACHINE)
        row = RecordingRow(
            id="rec-cut",
            machine="lever",
            machine_version=1,
            role="train",
            label="",
            state="recording",
            origin="recorded",
            format="parquet",
            created="2026-01-01T00:00:00.000Z",
        )
        first.service[Recordings].add(row)
        (first.service.files.recordings / "rec-cut.journal").touch()
    with running_service(tmp_path, Fakes()) as second:
        cut = second.client.get(f"{RECORDINGS}/rec-cut").json()
        assert (cut["state"], cut["statistics"]) == ("sealed", {"rows": 500, "recovered": True})
        second.service[Recordings].add(row.but(id="rec-empty"))
        # Killed when the file was whole, before the store knew.
        second.service[Recordings].add(row.but(id="rec-whole", machine="lever", role="validate", state="failed"))
        with second.service.database.write() as connection:
            connection.execute(recordings.update().where(recordings.c.id == "rec-whole").values(state="recording"))
        directory = second.service.files.recordings
        (directory / "rec-whole.parquet").write_bytes((directory / "rec-cut.parquet").read_bytes())
    with running_service(tmp_path, Fakes()) as third:
        empty = third.client.get(f"{RECORDINGS}/rec-empty").json()
        assert empty["state"] == "failed"
        assert "record it again" in empty["error"]
        whole = third.client.get(f"{RECORDINGS}/rec-whole").json()
        assert (whole["state"], whole["statistics"]) == ("sealed", {"rows": 500, "recovered": True})


def outcome(running: Running, job: str) -> dict[str, Any]:
    """The job once it has ended."""
    running.follow(job)
    return dict(running.client.get(f"{API}/jobs/{job}").json())


def test_a_job_whose_workflow_broke_off_is_not_running_for_ever(
    tmp_path: Path, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running_service(tmp_path, Fakes()) as first:

        def break_off(*_: object, **__: object) -> bool:
            raise RuntimeError("a bug")

        with monkeypatch.context() as patch:
            patch.setattr(Jobs, "finish", break_off)
            order = first.order(csv)
            with pytest.raises(Exception, match="a bug"):
                DBOS.get_result(order.job)
    with running_service(tmp_path, Fakes()) as second:
        job = outcome(second, order.job)
        assert (job["state"], job["error"]) == ("failed", "the job broke off unexpectedly; order it again")


def test_a_job_that_was_stored_but_never_queued_is_taken_up(
    tmp_path: Path, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running_service(tmp_path, Fakes()) as first, monkeypatch.context() as patch:
        # As if the server had been killed between the two.
        patch.setattr(first.service[JobRunner], "enqueue", lambda job: None)
        order = first.order(csv)
        assert first.service[Jobs].get(order.job).state == "queued"
    with running_service(tmp_path, Fakes()) as second:
        assert outcome(second, order.job)["state"] == "done"


def test_the_store_is_not_closed_before_the_job_that_has_just_ended_is_left(
    tmp_path: Path, csv: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    leaving, closed, left = threading.Event(), threading.Event(), list[bool]()
    give_back, close = Claims.give_back, Database.close

    def late(claims: Claims, claim: Claim) -> None:
        leaving.set()
        closed.wait(3)
        give_back(claims, claim)
        left.append(closed.is_set())

    def noted(database: Database) -> None:
        closed.set()
        close(database)

    monkeypatch.setattr(Claims, "give_back", late)
    with running_service(tmp_path, Fakes()) as running:
        monkeypatch.setattr(Database, "close", noted)
        assert running.follow(running.order(csv).job)[-1]["state"] == "done"
        assert leaving.wait(60)
    assert left == [False]


def test_two_services_in_one_process_are_refused(tmp_path: Path) -> None:
    with (
        running_service(tmp_path / "one", Fakes()),
        pytest.raises(RuntimeError, match="once per process"),
        running_service(tmp_path / "two", Fakes()),
    ):
        raise AssertionError("the second one started")
