"""The Python client: it is as new as the description, and drives a service over a socket."""

from __future__ import annotations

import hashlib
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import uvicorn
from service_fakes import MACHINE, Running

from server.commands.openapi_file import PLACE
from server.composition.app import create_app
from server.machines.machine_desk import MachineDesk

CLIENT = Path(__file__).parents[3] / "clients" / "python"
sys.path.insert(0, str(CLIENT))  # it is a distribution of its own

from hilfit_client import Client, ProblemError  # noqa: E402
from hilfit_client.generated import SOURCE_SHA256  # noqa: E402


@pytest.fixture(scope="module")
def client(running: Running) -> Iterator[Client]:
    running.client.post("/api/v1/machines", content=MACHINE)
    running.service[MachineDesk].set_acquisition("lever", True)
    assert running.fakes.acquisition.up.wait(30)
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(create_app(running.service), log_config=None, lifespan="off"))
    thread = threading.Thread(target=server.run, args=([listening],), daemon=True)
    thread.start()
    try:
        yield Client(f"http://127.0.0.1:{listening.getsockname()[1]}")
    finally:
        server.should_exit = True
        thread.join(30)
        listening.close()


def test_it_was_made_from_the_description_as_it_is() -> None:
    assert hashlib.sha256(PLACE.read_bytes()).hexdigest() == SOURCE_SHA256, "run 'make client'"


@pytest.mark.slow
def test_a_recording_from_start_to_download(client: Client, running: Running) -> None:
    assert [machine["name"] for machine in client.machines.list_machines()["items"]] == ["lever"]
    started = client.recordings.start(machine="lever", role="train", label="by a program", seconds=10)
    ended = client.wait_recording(started["id"])
    assert (ended["state"], ended["label"]) == ("sealed", "by a program")
    content = client.recordings.data(started["id"], format="parquet")
    assert (
        hashlib.sha256(content).hexdigest()
        == hashlib.sha256((running.service.files.recordings / f"{started['id']}.parquet").read_bytes()).hexdigest()
    )


def test_a_refusal_says_what_to_do(client: Client) -> None:
    with pytest.raises(ProblemError, match="404 Not found: ") as refused:
        client.recordings.get("rec ä")
    assert refused.value.status == 404
    assert "rec ä" in refused.value.detail
    assert (refused.value.code, refused.value.values) == ("not_found", {"recording": "rec ä"})


def test_an_etag_guards_a_change(client: Client) -> None:
    made = client.schedules.create(machine="lever", cron="0 2 * * *", label="nightly")
    first = client.transport.etag
    client.schedules.change(made["id"], if_match=first, machine="lever", cron="30 2 * * *")
    with pytest.raises(ProblemError) as refused:
        client.schedules.change(made["id"], if_match=first, machine="lever", cron="0 2 * * *")
    assert refused.value.status == 412
    client.schedules.delete(made["id"])


@pytest.mark.slow
def test_events_come_as_they_are_sent(client: Client) -> None:
    events = client.events.events()
    try:
        first = next(events)
    finally:
        events.close()  # type: ignore[attr-defined]
    assert first["resource"] in {"audit", "machines", "recordings", "schedules"}
    assert first["revision"] > 0
