"""The Python client: it has what the description has, and drives a service over a socket."""

from __future__ import annotations

import hashlib
import json
import shutil
import socket
import subprocess
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

import generate  # noqa: E402

generate.main()
from hilfit_client import Client, ProblemError, generated  # noqa: E402


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


def test_every_operation_of_the_description_is_a_method_of_its_resource() -> None:
    description = json.loads(PLACE.read_text("utf-8"))
    api = generated.Api(None)
    operations = [(path, one) for path, verbs in description["paths"].items() for one in verbs.values()]
    assert len(operations) > 80
    for path, operation in operations:
        resource = getattr(api, path.removeprefix(generate.PREFIX).split("/")[1].replace("-", "_"))
        assert callable(getattr(resource, operation["operationId"].rpartition(".")[2])), path
    named = map(generate.class_name, description["components"]["schemas"])
    assert not [name for name in named if not hasattr(generated, name)]


@pytest.mark.slow
def test_what_is_installed_was_made_from_the_description(tmp_path: Path) -> None:
    place = tmp_path / "clients" / "python"
    shutil.copytree(CLIENT, place, ignore=shutil.ignore_patterns("generated.py", "__pycache__", "build", "*.egg-info"))
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "openapi.json").write_bytes(PLACE.read_bytes())
    command = [sys.executable, "setup.py", "-q", "build", "--build-lib", str(tmp_path / "built")]
    subprocess.run(command, cwd=place, check=True, timeout=120)
    made = (tmp_path / "built" / "hilfit_client" / "generated.py").read_text("utf-8")
    assert made == generate.generate(PLACE.read_bytes())


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
