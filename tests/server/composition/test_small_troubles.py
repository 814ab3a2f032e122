"""Requests and circumstances that were answered wrongly, each once."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from service_fakes import API, MACHINE, Fakes, Running, running_service

import server.machines.machine_uploads
import server.recordings.recording_uploads
from server.jobs.job_store import Jobs


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_service(tmp_path_factory.mktemp("data"), Fakes()) as running:
        running.client.post(f"{API}/machines", content=MACHINE)
        yield running


def problem(answer: Any, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    return dict(answer.json())


@pytest.fixture(scope="module")
def finished(service: Running, csv: bytes) -> str:
    job = service.order(csv).job
    assert service.follow(job)[-1]["state"] == "done"
    return job


@pytest.mark.slow
@pytest.mark.timeout(60)
@pytest.mark.parametrize("last", ["last", str(2**53), str(2**63), "9" * 20])
def test_a_client_that_has_the_last_event_of_a_job_does_not_wait(service: Running, finished: str, last: str) -> None:
    number = str(len(service.service[Jobs].events(finished))) if last == "last" else last
    answer = service.client.get(f"{API}/jobs/{finished}/events", headers={"Last-Event-ID": number})
    assert (answer.status_code, answer.text) == (200, "")


BODIES = {
    "/access/pairing-codes": {"role": "viewer", "machines": ["\ud800"]},
    "/access/keys": {"name": "\udfff", "role": "viewer"},
    "/recordings": {"machine": "\ud800", "role": "train"},
    "/excitations": {"machine": "lever", "label": "\ud800", "joints": ["\ud800"]},
    "/calibrations": {"identification": "\ud800"},
    "/schedules": {"machine": "lever", "cron": "0 0 * * *", "label": "\ud800", "timezone": "\ud800"},
}


@pytest.mark.parametrize("place", BODIES)
def test_half_a_surrogate_pair_is_no_text(service: Running, place: str) -> None:
    headers = {"Content-Type": "application/json"}
    answer = service.client.post(f"{API}{place}", content=json.dumps(BODIES[place]), headers=headers)
    assert answer.status_code in (404, 422), answer.text
    problem(answer, answer.status_code)


@pytest.mark.parametrize("body", [b"[" * 100_000, b"\xff\xfe", b'{"a": 1e999999999', b"{", b"\x00"])
def test_a_body_that_is_no_json_is_invalid(service: Running, body: bytes) -> None:
    headers = {"Content-Type": "application/json"}
    problem(service.client.post(f"{API}/recordings", content=body, headers=headers), 422)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EDQUOT])
def test_a_disk_that_takes_nothing_is_told(service: Running, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def full(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(server.machines.machine_uploads, "write_whole", full)
    answer = service.client.post(f"{API}/machines", content=MACHINE.replace("rate_hz: 50", "rate_hz: 40"))
    said = problem(answer, 503)
    assert answer.headers["retry-after"]
    assert ("full" in said["detail"]) == (number != errno.EROFS)
    monkeypatch.undo()
    assert service.client.get(f"{API}/machines/lever").json()["current"] == 1


@pytest.mark.parametrize("enabled", [0, 1, "false", "no", None, []])
def test_only_true_and_false_are_flags(service: Running, enabled: object) -> None:
    problem(service.client.put(f"{API}/machines/lever/acquisition", json={"enabled": enabled}), 422)


@pytest.mark.parametrize(
    ("method", "path", "allow"),
    [
        ("DELETE", f"{API}/machines", "GET, POST"),
        ("PUT", f"{API}/schedules/x", None),
        ("PATCH", f"{API}/schedules/x", "DELETE, GET, PUT"),
        ("POST", "/healthz", "GET"),
        ("DELETE", f"{API}/access/keys", "GET, POST"),
    ],
)
def test_allow_names_every_method_of_a_path(service: Running, method: str, path: str, allow: str | None) -> None:
    answer = service.client.request(method, path)
    if allow is None:
        assert answer.status_code != 405
    else:
        problem(answer, 405)
        assert answer.headers["allow"] == allow


def test_an_mdf4_upload_without_its_reader_is_an_unsupported_format(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server.recordings.recording_uploads, "find_spec", lambda name: None)
    query = {"machine": "lever", "role": "train", "name": "made.mf4"}
    said = problem(service.client.post(f"{API}/recordings/upload", params=query, content=b"MDF"), 415)
    assert "hilfit[export]" in said["detail"]


@pytest.mark.slow
@pytest.mark.parametrize("harm", ["deleted", "replaced", "store deleted", "read-only"])
def test_a_service_without_its_data_is_alive_and_not_ready(
    service: Running, monkeypatch: pytest.MonkeyPatch, harm: str
) -> None:
    files = service.service.files
    aside = files.root.with_name("aside")
    if harm in ("deleted", "replaced"):
        files.root.rename(aside)
        if harm == "replaced":
            shutil.copytree(aside, files.root)
    elif harm == "store deleted":
        files.database.rename(aside)
    else:
        monkeypatch.setattr(Path, "write_bytes", lambda *_: (_ for _ in ()).throw(OSError(errno.EROFS, "Read-only")))
    try:
        assert service.client.get("/livez").json() == {"status": "ok"}
        for path in ("/readyz", "/healthz"):
            problem(service.client.get(path), 503)
    finally:
        if harm == "replaced":
            shutil.rmtree(files.root)
        if harm != "read-only":
            aside.rename(files.database if harm == "store deleted" else files.root)
    monkeypatch.undo()
    assert service.client.get("/readyz").status_code == 200
