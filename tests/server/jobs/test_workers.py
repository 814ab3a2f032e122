"""PostgreSQL and workers: jobs run there, what a killed worker leaves is taken over, one server per database."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from dbos import DBOS
from postgresql_server import PostgreSQL
from service_fakes import Fakes, Running, ran, running_service
from sqlalchemy.exc import OperationalError, ProgrammingError

from server.composition.declarations import TABLES
from server.composition.worker import other_version, work
from server.identifications.identification_store import Identification
from server.jobs.claims import Claims
from server.jobs.executors import SILENT_S, Heartbeat, Silence, executors, hosts
from server.jobs.job_kinds import NUMERICAL
from server.jobs.job_runner import EXECUTOR, JobRunner
from server.jobs.job_store import Jobs, Result
from server.platform.database.engine import Database
from server.platform.database.patience import patiently
from server.platform.errors import StartError, TakenOver
from server.platform.settings import Settings

SCRIPT = Path(__file__).parents[1] / "work_with_fakes.py"


@contextmanager
def worker(data_dir: Path, url: str, name: str) -> Iterator[subprocess.Popen[bytes]]:
    """A worker process that takes jobs; killed at the end if it still runs."""
    command = [sys.executable, str(SCRIPT), str(data_dir), url, name]
    log = data_dir.parent / f"{name}.log"
    with log.open("ab") as errors, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n", log.read_text()
            yield process
        finally:
            process.kill()


HALF = "Half of cylinder_stage"


def in_the_middle(running: Running, csv: bytes) -> Identification:
    """An identification in the middle of its second stage, which goes on once there is a file ``go``."""
    order = running.order(csv, block="cylinder_stage")
    running.follow(order.job, lambda event: event["text"] == HALF)
    return order


def in_the_middle_again(running: Running, order: Identification, half: str) -> None:
    """Wait until a stage that says ``half`` in its middle has said so twice."""
    seen: list[str] = []

    def again(event: dict[str, Any]) -> bool:
        seen.append(event["text"])
        return seen.count(half) == 2

    running.follow(order.job, again)


def processes(directory: Path) -> list[int]:
    """Of the stages that ran, in order."""
    return [int(line.split()[1]) for line in (directory / "ran.txt").read_text().splitlines()]


@pytest.mark.slow
def test_what_a_killed_worker_was_doing_is_taken_over_without_doing_a_finished_stage_again(
    tmp_path: Path, csv: bytes, postgresql: PostgreSQL
) -> None:
    data_dir, url = tmp_path / "data", postgresql.new_database()
    with running_service(data_dir, Fakes(), database_url=url, local_jobs=False) as running:
        with worker(data_dir, url, "one") as process:
            order = in_the_middle(running, csv)
            stage = os.pidfd_open(processes(running.service.files.identifications / order.id)[-1])
            process.send_signal(signal.SIGKILL)
            process.wait()
            assert select.select([stage], [], [], 30)[0], "the stage has to die with its worker"
            os.close(stage)
        (running.service.files.identifications / order.id / "go").touch()
        assert running.service[JobRunner].take_over(lambda executor: executor == "server") == ()
        assert running.service[JobRunner].take_over(lambda executor: executor == "worker-one") == (order.job,)
        with worker(data_dir, url, "two") as process:
            assert running.follow(order.job)[-1]["state"] == "done"
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0
        assert ran(running, order.id) == ["check", "cylinder_stage", "cylinder_stage", "report"]
        assert running.client.get(f"/api/v1/identifications/{order.id}").json()["verdict"] == "nothing_missing"


@pytest.mark.slow
def test_a_worker_that_is_resumed_leaves_jobs_alone_that_another_took_over(
    tmp_path: Path, csv: bytes, postgresql: PostgreSQL
) -> None:
    data_dir, url = tmp_path / "data", postgresql.new_database()
    with running_service(data_dir, Fakes(), database_url=url, local_jobs=False) as running:
        runner, directory = running.service[JobRunner], running.service.files.identifications
        with worker(data_dir, url, "one") as one:
            order = in_the_middle(running, csv)
            stage = os.pidfd_open(processes(directory / order.id)[-1])
            one.send_signal(signal.SIGSTOP)  # its stage goes on
            assert runner.take_over(lambda executor: executor == "worker-one") == (order.job,)
            with worker(data_dir, url, "two") as two:
                in_the_middle_again(running, order, HALF)
                one.send_signal(signal.SIGCONT)
                assert select.select([stage], [], [], 30)[0], "whoever lost a job has to end its stage"
                os.close(stage)
                (directory / order.id / "go").touch()
                events = running.follow(order.job)
                assert [event["state"] for event in events if event["state"] != "running"] == ["queued", "done"]
                two.send_signal(signal.SIGTERM)
                assert two.wait(30) == 0
            assert ran(running, order.id) == ["check", "cylinder_stage", "cylinder_stage", "report"]
            # And it is well: there is nobody else now.
            second = running.order(csv)
            assert running.follow(second.job)[-1]["state"] == "done"
            one.send_signal(signal.SIGTERM)
            assert one.wait(30) == 0
        assert running.follow(order.job) == events, "nothing was added"


@pytest.mark.slow
@pytest.mark.parametrize("when", ["before the other one's end", "after it"])
def test_what_the_stage_of_a_stopped_worker_goes_on_to_write_changes_nothing_that_is_read(
    tmp_path: Path, csv: bytes, postgresql: PostgreSQL, when: str
) -> None:
    data_dir, url = tmp_path / "data", postgresql.new_database()
    with running_service(data_dir, Fakes(), database_url=url, local_jobs=False) as running:
        half = "Half of report"
        with worker(data_dir, url, "one") as one:
            order = running.order(csv, block="report", signed=True)
            running.follow(order.job, lambda event: event["text"] == half)
            directory = running.service.files.identifications / order.id
            late, its_own = processes(directory)[-1], None
            stage = os.pidfd_open(late)

            def let_it_write() -> None:
                (directory / f"go-{late}").touch()
                assert select.select([stage], [], [], 30)[0], "the late stage has to end"
                os.close(stage)

            def read() -> Any:
                (kept,) = (path for path in directory.iterdir() if path.is_dir())
                result = f"/api/v1/identifications/{order.id}"
                answers = [running.client.get(result + what).text for what in ("", "/report.json", "/report.html")]
                return answers, {path: path.read_bytes() for path in kept.rglob("*") if path.is_file()}

            one.send_signal(signal.SIGSTOP)  # its stage goes on
            assert running.service[JobRunner].take_over(lambda executor: executor == "worker-one") == (order.job,)
            with worker(data_dir, url, "two") as two:
                in_the_middle_again(running, order, half)
                mine = processes(directory)[-1]
                if when != "after it":
                    let_it_write()
                    (written,) = directory.rglob("report.json")
                    assert json.loads(written.read_text())["process"] == late
                    its_own = written.parent
                (directory / f"go-{mine}").touch()
                assert running.follow(order.job)[-1]["state"] == "done"
                two.send_signal(signal.SIGTERM)
                assert two.wait(30) == 0
            before = read()
            assert its_own not in {path.parent for path in before[1]}
            assert json.loads(before[0][1])["process"] == mine
            if when == "after it":
                let_it_write()
            assert read() == before
            one.send_signal(signal.SIGCONT)
            second = running.order(csv)  # it is well
            assert running.follow(second.job)[-1]["state"] == "done"
            one.send_signal(signal.SIGTERM)
            assert one.wait(30) == 0
        assert read() == before, "what the late one wrote is gone"


@pytest.mark.slow
def test_a_worker_that_starts_again_releases_what_somebody_else_was_given_meanwhile(
    tmp_path: Path, csv: bytes, postgresql: PostgreSQL
) -> None:
    data_dir, url = tmp_path / "data", postgresql.new_database()
    with running_service(data_dir, Fakes(), database_url=url, local_jobs=False) as running:
        with worker(data_dir, url, "one") as process:
            order = in_the_middle(running, csv)
            process.kill()
            process.wait()
        (running.service.files.identifications / order.id / "go").touch()
        # As when it was claimed once more between the claims of the silent and their workflows being taken away.
        DBOS.resume_workflow(order.job, queue_name=NUMERICAL)
        with worker(data_dir, url, "two"):
            pause = threading.Event()
            for _ in range(300):
                if getattr(DBOS.get_workflow_status(order.job), "executor_id", None) == "worker-two":
                    break
                pause.wait(0.1)
            assert running.client.get(f"/api/v1/jobs/{order.job}").json()["state"] == "running"
            with worker(data_dir, url, "one"):
                assert running.follow(order.job)[-1]["state"] == "done"
        assert ran(running, order.id) == ["check", "cylinder_stage", "cylinder_stage", "report"]


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def database(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Database]:
    """The same store on either."""
    sqlite = request.param == "sqlite"
    place = tmp_path / "s.sqlite" if sqlite else request.getfixturevalue("postgresql").new_database()
    database = Database(place, TABLES, changed=lambda: None)
    yield database
    database.close()


def queued(database: Database) -> Jobs:
    """A store with one job."""
    jobs = Jobs(database)
    with database.write() as connection:
        jobs.insert(connection, id="job-1", kind="k", label="", subject="idn-1", stages=("fit",))
    return jobs


@pytest.mark.slow
def test_a_claim_that_holds_no_more_stores_nothing(database: Database) -> None:
    jobs, claims = queued(database), Claims(database)
    late = claims.take("job-1", "one")
    assert late is not None
    assert jobs.progress("job-1", "fit", 0.1, "before", late)
    assert claims.take("job-1", "two") is None, "it is held"
    assert claims.revoke(lambda holder: holder == "two") == ()
    assert claims.revoke(lambda holder: holder == "one") == ("job-1",)
    mine = claims.take("job-1", "two")
    assert mine is not None and mine.number > late.number
    change: Any = executors.insert().values(id="trace", host="", started="", seen="")
    attempts: list[Callable[[], object]] = [
        lambda: jobs.progress("job-1", "fit", 0.9, "late", late),
        lambda: jobs.cancelling("job-1", late),
        lambda: jobs.finish("job-1", "done", "late", claim=late, result=Result("executors", change)),
    ]
    before = (jobs.get("job-1"), jobs.events("job-1"), database.revisions())
    for attempt in attempts:
        with pytest.raises(TakenOver):
            attempt()
    claims.give_back(late)  # is not its to give
    assert claims.take("job-1", "three") is None
    assert (jobs.get("job-1"), jobs.events("job-1"), database.revisions()) == before
    with database.read() as connection:
        assert connection.execute(sa.select(executors)).all() == []
    assert jobs.finish("job-1", "done", "Done", claim=mine)
    assert not jobs.finish("job-1", "done", "Done", claim=mine, result=Result("executors", change)), "a job ends once"
    with database.read() as connection:
        assert connection.execute(sa.select(executors)).all() == []


def test_a_job_is_claimed_by_one_worker_of_many(database: Database) -> None:
    queued(database)
    claims = Claims(database)
    with ThreadPoolExecutor(8) as pool:
        taken = list(pool.map(lambda number: claims.take("job-1", f"worker-{number}"), range(8)))
    (winner,) = [claim for claim in taken if claim is not None]
    restarted = claims.take("job-1", winner.holder)
    assert restarted is not None and restarted.number == winner.number + 1, "a holder that starts again has it still"
    claims.give_back(restarted)
    theirs = claims.take("job-1", "anybody")
    assert theirs is not None
    assert claims.release(winner.holder) == ()
    assert claims.release("anybody") == ("job-1",)
    assert claims.take("job-1", "somebody else") is not None
    with pytest.raises(TakenOver), database.read() as connection:
        theirs.check(connection)


def test_a_database_that_is_away_is_waited_for_and_a_wrong_question_is_not() -> None:
    pauses: list[float] = []
    answers: list[Exception | str] = [OperationalError("SELECT", {}, Exception("gone"))] * 3 + ["there"]

    def ask() -> str:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    assert patiently(ask, pauses.append) == "there"
    assert len(pauses) == 3
    with pytest.raises(ProgrammingError):
        answers.append(ProgrammingError("SELECT", {}, Exception("no such column")))
        patiently(ask, pauses.append)


@pytest.mark.slow
def test_a_service_on_postgresql_runs_jobs_itself_and_refuses_a_second_server(
    tmp_path: Path, csv: bytes, postgresql: PostgreSQL
) -> None:
    url = postgresql.new_database()
    with running_service(tmp_path / "one", Fakes(), database_url=url) as running:
        order = running.order(csv)
        assert running.follow(order.job)[-1]["state"] == "done"
        with (
            pytest.raises(StartError, match="another hilfit server"),
            running_service(tmp_path / "two", Fakes(), database_url=url),
        ):
            raise AssertionError("the second one started")
        assert not (tmp_path / "one" / "hilfit.sqlite").exists()


def test_a_worker_without_heartbeats_is_silent(tmp_path: Path) -> None:
    now = 0.0
    database = Database(tmp_path / "s.sqlite", TABLES, changed=lambda: None)
    silence = Silence(database, lambda: now)
    one, two = Heartbeat(database, "worker-one"), Heartbeat(database, "worker-two")
    for _ in range(3):
        one.send()
        two.send()
        silence.look()
        now += SILENT_S / 2
    assert not silence.silent("worker-one")
    one.send()
    silence.look()
    now += SILENT_S
    assert silence.silent("worker-two")
    assert not silence.silent("worker-one")
    one.send()  # with the same clock: every word is a new one
    silence.look()
    now += SILENT_S
    assert not silence.silent("worker-one")
    assert silence.silent("worker-never-heard")
    database.close()


def test_a_database_outage_does_not_count_as_silence_of_a_worker(tmp_path: Path) -> None:
    now = 0.0
    database = Database(tmp_path / "s.sqlite", TABLES, changed=lambda: None)
    silence = Silence(database, lambda: now)
    one = Heartbeat(database, "worker-one")
    one.send()
    silence.look()
    now += 4 * SILENT_S  # nobody could look, nobody could say anything
    silence.look()
    assert not silence.silent("worker-one")
    for _ in range(3):  # now it can speak, and does not
        now += SILENT_S / 2
        silence.look()
    assert silence.silent("worker-one")
    database.close()


def test_a_worker_says_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(StartError, match="database_url"):
        work(Settings(data_dir=tmp_path), "one", lambda: None)
    with pytest.raises(StartError, match="--name"):
        work(Settings(data_dir=tmp_path, database_url="postgresql://x/y"), "server", lambda: None)


def test_a_worker_takes_no_job_of_a_server_of_another_version(tmp_path: Path) -> None:
    database = Database(tmp_path / "store.sqlite", TABLES, changed=lambda: None)
    try:
        assert "start it" in (other_version(database) or "")
        Heartbeat(database, "worker-one").send()
        assert "start it" in (other_version(database) or ""), "another worker is no server"
        Heartbeat(database, EXECUTOR).send()
        assert other_version(database) is None
        with database.write() as connection:
            connection.execute(hosts.update().where(hosts.c.id == EXECUTOR).values(version="0.0.1"))
        assert "the server is hilfit 0.0.1" in (other_version(database) or "")
    finally:
        database.close()
