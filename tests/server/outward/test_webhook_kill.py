"""A real server process that is killed (SIGKILL) while a receiver has heard a message and not yet answered."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx2
import pytest
from service_fakes import API
from webhook_receiver import receiver

SCRIPT = Path(__file__).parents[1] / "serve_with_fakes.py"


@contextmanager
def server(data_dir: Path, port: int) -> Iterator[tuple[subprocess.Popen[bytes], httpx2.Client]]:
    environment = {**os.environ, "HILFIT_WEBHOOK_PLACES": json.dumps([f"http://127.0.0.1:{port}"])}
    command = [sys.executable, str(SCRIPT), str(data_dir)]
    with (
        (data_dir.parent / "server.log").open("ab") as log,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, env=environment) as process,
    ):
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, (data_dir.parent / "server.log").read_text()
            with httpx2.Client(base_url=json.loads(line)["url"], timeout=60) as client:
                yield process, client
        finally:
            process.kill()


@pytest.mark.slow
def test_a_message_arrives_again_with_its_id_after_kill_9(tmp_path: Path) -> None:
    """At least once: the try that was broken off is made again, and the receiver can tell that it has it."""
    with receiver() as heard:
        hold = threading.Event()
        heard.hold = hold
        with server(tmp_path / "data", heard.port) as (process, client):
            made = client.post(f"{API}/webhooks", json={"url": f"http://127.0.0.1:{heard.port}/"})
            assert made.status_code == 201, made.text
            place = f"{API}/webhooks/{made.json()['id']}"
            assert client.post(f"{place}/test").status_code == 202
            heard.wait(1)
            process.kill()
            process.wait()
        hold.set()
        with server(tmp_path / "data", heard.port) as (_, client):
            heard.wait(2)
            (delivery,) = client.get(f"{place}/deliveries").json()["items"]
            while delivery["state"] == "pending":
                (delivery,) = client.get(f"{place}/deliveries").json()["items"]
            assert (delivery["state"], delivery["tries"]) == ("delivered", 1)
        ids = [given["webhook-id"] for _, given, _ in heard.heard]
        assert ids == [ids[0]] * 2
        assert heard.heard[0][2] == heard.heard[1][2]
