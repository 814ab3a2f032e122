"""PostgreSQL and workers: jobs run there, what a killed worker leaves is taken over, one server per database."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from postgresql_server import PostgreSQL
from service_fakes import Fakes, ran, running_service

from server.errors import StartError
from server.executors import SILENT_S, Presence, Silence
from server.settings import Settings
from server.store import Database
from server.worker import work

SCRIPT = Path(__file__).with_name("work_with_fakes.py")


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


@pytest.mark.slow
def test_what_a_killed_worker_was_doing_is_taken_over_without_doing_a_finished_stage_again(
    tmp_path: Path, csv: bytes, postgresql: PostgreSQL
) -> None:
    data_dir, url = tmp_path / "data", postgresql.new_database()
    with running_service(data_dir, Fakes(), database_url=url, local_jobs=False) as running:
        with worker(data_dir, url, "one") as process:
            order = running.order(csv, block="cylinder_stage")
            running.follow(order.job, lambda event: event["text"] == "Half of cylinder_stage")
            path = running.service.files.identifications / order.id / "ran.txt"
            stage = os.pidfd_open(int(path.read_text().splitlines()[-1].split()[1]))
            process.send_signal(signal.SIGKILL)
            process.wait()
            assert select.select([stage], [], [], 30)[0], "the stage has to die with its worker"
            os.close(stage)
        (running.service.files.identifications / order.id / "go").touch()
        assert running.service.runner.take_over(lambda executor: executor == "server") == ()
        assert running.service.runner.take_over(lambda executor: executor == "worker-one") == (order.job,)
        with worker(data_dir, url, "two") as process:
            assert running.follow(order.job)[-1]["state"] == "done"
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0
        assert ran(running, order.id) == ["check", "cylinder_stage", "cylinder_stage", "report"]
        assert running.client.get(f"/api/v1/identifications/{order.id}").json()["verdict"] == "nothing_missing"


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


def test_silence_is_what_changes_nothing_for_a_while(tmp_path: Path) -> None:
    now = 0.0
    database = Database(tmp_path / "s.sqlite", changed=lambda: None)
    silence = Silence(database, lambda: now)
    one, two = Presence(database, "worker-one"), Presence(database, "worker-two")
    for _ in range(3):
        one.say()
        two.say()
        silence.look()
        now += SILENT_S / 2
    assert not silence.silent("worker-one")
    one.say()
    silence.look()
    now += SILENT_S
    assert silence.silent("worker-two")
    assert not silence.silent("worker-one")
    one.say()  # with the same clock: every word is a new one
    silence.look()
    now += SILENT_S
    assert not silence.silent("worker-one")
    assert silence.silent("worker-never-heard")
    database.close()


def test_a_worker_says_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(StartError, match="database_url"):
        work(Settings(data_dir=tmp_path), "one", lambda: None)
    with pytest.raises(StartError, match="--name"):
        work(Settings(data_dir=tmp_path, database_url="postgresql://x/y"), "server", lambda: None)
