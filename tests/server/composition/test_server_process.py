"""A real server process over a real socket: resumed after SIGKILL, stopped by SIGTERM, alone on its data."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2
import pytest
from service_fakes import API, MACHINE

SCRIPT = Path(__file__).parents[1] / "serve_with_fakes.py"
pytestmark = pytest.mark.slow


@contextmanager
def server(data_dir: Path) -> Iterator[tuple[subprocess.Popen[bytes], httpx2.Client]]:
    """A server and a client of it; it is killed at the end if it still runs."""
    with (
        (data_dir.parent / "server.log").open("ab") as log,
        subprocess.Popen([sys.executable, str(SCRIPT), str(data_dir)], stdout=subprocess.PIPE, stderr=log) as process,
    ):
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, (data_dir.parent / "server.log").read_text()
            with httpx2.Client(base_url=json.loads(line)["url"], timeout=30) as client:
                yield process, client
        finally:
            process.kill()


def order(client: httpx2.Client, csv: bytes) -> dict[str, Any]:
    """Order an identification of two fresh recordings."""
    assert client.post(f"{API}/machines", content=MACHINE).status_code in (200, 201)
    chosen = []
    for role in ("train", "validate"):
        parameters = {"machine": "lever", "role": role, "name": "run.csv"}
        chosen.append({"id": client.post(f"{API}/recordings/upload", params=parameters, content=csv).json()["id"]})
    body = {"machine": "lever", "recordings": chosen}
    response = client.post(f"{API}/identifications", json=body)
    assert response.status_code == 202
    return dict(response.json())


def events(client: httpx2.Client, job: str, after: int = 0) -> Iterator[dict[str, Any]]:
    """Events of a job as they come."""
    with client.stream("GET", f"{API}/jobs/{job}/events", params={"after": after}, timeout=60) as response:
        for line in response.iter_lines():
            if line.startswith("data: "):
                yield json.loads(line.removeprefix("data: "))


def ran(data_dir: Path, identification: str) -> list[str]:
    lines = (data_dir / "identifications" / identification / "ran.txt").read_text().splitlines()
    return [line.split()[0] for line in lines]


def test_a_job_goes_on_after_kill_9_without_doing_a_finished_stage_again(tmp_path: Path, csv: bytes) -> None:
    data_dir = tmp_path / "data"
    with server(data_dir) as (process, client):
        (data_dir / "steer.json").write_text('{"block": "cylinder_stage"}')
        made = order(client, csv)
        for event in events(client, made["job"]):
            if event["text"] == "Half of cylinder_stage":
                break
        path = data_dir / "identifications" / made["id"] / "ran.txt"
        stage = os.pidfd_open(int(path.read_text().splitlines()[-1].split()[1]))
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert select.select([stage], [], [], 30)[0], "the stage has to die with the server"
        os.close(stage)
    (data_dir / "identifications" / made["id"] / "go").touch()
    with server(data_dir) as (_, client):
        seen = list(events(client, made["job"]))
        assert seen[-1]["state"] == "done"
        assert [event["number"] for event in seen] == list(range(1, len(seen) + 1))
        report = client.get(f"{API}/identifications/{made['id']}/report.json").json()
        assert report["loop"]["verdict"] == "nothing_missing"
    assert ran(data_dir, made["id"]) == ["check", "cylinder_stage", "cylinder_stage", "report"]


def test_sigterm_stops_streams_and_stages_and_the_job_goes_on_at_the_next_start(tmp_path: Path, csv: bytes) -> None:
    data_dir = tmp_path / "data"
    with server(data_dir) as (process, client):
        (data_dir / "steer.json").write_text('{"block": "report"}')
        made = order(client, csv)
        stream = events(client, made["job"])
        for event in stream:
            if event["text"] == "Half of report":
                break
        path = data_dir / "identifications" / made["id"] / "ran.txt"
        stage = os.pidfd_open(int(path.read_text().splitlines()[-1].split()[1]))
        process.send_signal(signal.SIGTERM)
        assert all(event["state"] == "running" for event in stream)  # the stream ends, without an end of the job
        assert process.wait(30) == 0
        assert select.select([stage], [], [], 0)[0], "no child outlives the server"
        os.close(stage)
    (data_dir / "identifications" / made["id"] / "go").touch()
    with server(data_dir) as (_, client):
        assert [event["state"] for event in events(client, made["job"])][-1] == "done"
    assert ran(data_dir, made["id"]) == ["check", "cylinder_stage", "report", "report"]
    log = (tmp_path / "server.log").read_text()
    assert "Traceback" not in log
    messages = [json.loads(line)["event"] for line in log.splitlines()]
    assert messages.count("started") == 2
    assert "stopped" in messages


def test_a_second_server_on_the_same_data_refuses(tmp_path: Path) -> None:
    data_dir = tmp_path / "data"
    with server(data_dir):
        second = subprocess.run(
            [sys.executable, "-m", "server.commands.command_line", "serve", "--port", "0", "--data-dir", str(data_dir)],
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert second.returncode == 2
    assert second.stderr.splitlines()[-1].startswith("hilfit: --data-dir")
    assert "another hilfit server" in second.stderr
