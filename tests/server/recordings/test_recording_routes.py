"""Recordings: upload and its refusals, download, start, stop, delete, recovery."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
from acquired_machines import acquire
from service_fakes import API, MACHINE, Running, recording_bytes

from server.platform.processes.children import ChildResult
from server.platform.processes.file_children import FileChildren

pytestmark = pytest.mark.slow

RECORDINGS = f"{API}/recordings"


@pytest.fixture(scope="module", autouse=True)
def lever(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)


def upload(running: Running, content: bytes, **parameters: str) -> Any:
    given = {"machine": "lever", "role": "train", "name": "run.csv", **parameters}
    return running.client.post(f"{RECORDINGS}/upload", params=given, content=content)


def nothing_is_left(running: Running) -> bool:
    """No half file of an upload."""
    return not list(running.service.files.recordings.glob(".incoming-*"))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_upload_and_download(running: Running, tmp_path: Path, suffix: str) -> None:
    content = recording_bytes(tmp_path, "train", suffix)
    response = upload(running, content, name=f"run{suffix}")
    assert response.status_code == 201
    row = response.json()
    assert (row["state"], row["origin"], row["format"]) == ("sealed", "uploaded", suffix[1:])
    assert row["sha256"] == hashlib.sha256(content).hexdigest()
    assert row["bytes"] == len(content)
    assert row["statistics"]["rows"] == 500
    assert row["statistics"]["seconds"] == pytest.approx(10.0)
    assert running.client.get(response.headers["location"]).json() == row
    data = running.client.get(f"{RECORDINGS}/{row['id']}/data")
    assert data.content == content
    assert f"lever-train-{row['id']}{suffix}" in data.headers["content-disposition"]
    assert nothing_is_left(running)


@pytest.mark.parametrize(
    ("result", "status", "says"),
    [
        (ChildResult("failed", error="took longer than 300 s and was ended"), 503, "took longer than 300 s"),
        (ChildResult("failed", error="was ended by SIGXCPU", exceeded=True), 422, "cannot be read; export it again"),
    ],
)
def test_a_computer_that_has_no_time_says_nothing_of_the_file(
    running: Running, csv: bytes, monkeypatch: pytest.MonkeyPatch, result: ChildResult, status: int, says: str
) -> None:
    monkeypatch.setattr(FileChildren, "run", lambda *arguments, **options: result)
    answer = upload(running, csv)
    assert answer.status_code == status and says in answer.json()["detail"]
    assert nothing_is_left(running)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda data: b"", "empty"),
        (lambda data: b"hello\nworld\n", "not a table"),
        (lambda data: data[:200], "run.csv"),
        (lambda data: data.replace(b"joint1.torque", b"joint9.torque", 1), "joint1.torque"),
    ],
)
def test_a_recording_that_cannot_be_used_is_refused(running: Running, csv: bytes, change: Any, says: str) -> None:
    response = upload(running, change(csv))
    assert response.status_code == 422
    detail = response.json()["detail"]
    assert says in detail
    assert "\n" not in detail
    assert str(running.service.files.root) not in detail
    assert nothing_is_left(running)


def test_a_truncated_parquet_is_refused(running: Running, tmp_path: Path) -> None:
    content = recording_bytes(tmp_path, "train", ".parquet")
    response = upload(running, content[: len(content) // 2], name="run.parquet")
    assert response.status_code == 422
    assert "run.parquet: is a Parquet file that is cut short" in response.json()["detail"]


def test_refusals_before_a_byte_is_stored(running: Running, csv: bytes) -> None:
    assert upload(running, csv, machine="absent").status_code == 404
    assert upload(running, csv, role="dancing").status_code == 422
    assert upload(running, csv, name="run.xlsx").status_code == 415


def test_a_huge_upload_is_stopped_and_leaves_nothing(running: Running) -> None:
    def endless() -> Any:
        for _ in range(100):
            yield b"0" * 10_000

    response = running.client.post(
        f"{RECORDINGS}/upload", params={"machine": "lever", "role": "train", "name": "a.csv"}, content=endless()
    )
    assert response.status_code == 413
    assert response.headers["content-type"] == "application/problem+json"
    assert nothing_is_left(running)


def test_list_narrows(running: Running, csv: bytes) -> None:
    id = upload(running, csv, role="operation").json()["id"]
    found = running.client.get(RECORDINGS, params={"machine": "lever", "role": "operation", "state": "sealed"})
    assert [row["id"] for row in found.json()["items"]] == [id]
    assert running.client.get(RECORDINGS, params={"role": "unloaded"}).json() == {"items": [], "next": None}


def test_delete_takes_the_file_too(running: Running, csv: bytes) -> None:
    id = upload(running, csv).json()["id"]
    path = running.service.files.recordings / f"{id}.csv"
    assert path.is_file()
    assert running.client.delete(f"{RECORDINGS}/{id}").status_code == 204
    assert not path.exists()
    assert running.client.get(f"{RECORDINGS}/{id}").status_code == 404


def test_recording_needs_an_acquisition(running: Running) -> None:
    response = running.client.post(RECORDINGS, json={"machine": "lever", "role": "train"})
    assert response.status_code == 409
    assert "not being acquired" in response.json()["detail"]


def test_start_and_stop(running: Running) -> None:
    acquire(running, "lever")
    body = {"machine": "lever", "role": "repeat", "label": "second time"}
    started = running.client.post(RECORDINGS, json=body)
    assert started.status_code == 201
    id = started.json()["id"]
    assert started.json()["state"] == "recording"
    second = running.client.post(RECORDINGS, json=body)
    assert second.status_code == 409
    assert id in second.json()["detail"]
    for refused in (
        running.client.delete(f"{RECORDINGS}/{id}"),
        running.client.get(f"{RECORDINGS}/{id}/data"),
        running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False}),
    ):
        assert refused.status_code == 409
    sealed = running.client.post(f"{RECORDINGS}/{id}/stop").json()
    assert (sealed["state"], sealed["role"], sealed["label"]) == ("sealed", "repeat", "second time")
    assert sealed["statistics"] == {"rows": 500}
    assert sealed["sha256"]
    assert running.client.get(f"{RECORDINGS}/{id}/data").content[:4] == b"PAR1"
    assert running.client.post(f"{RECORDINGS}/{id}/stop").status_code == 409


def test_a_recorder_that_fails_says_why(running: Running) -> None:
    acquire(running, "lever")
    running.fakes.recorder.fail = "the acquisition ended"
    id = running.client.post(RECORDINGS, json={"machine": "lever", "role": "train"}).json()["id"]
    row = running.client.post(f"{RECORDINGS}/{id}/stop").json()
    running.fakes.recorder.fail = None
    assert (row["state"], row["error"]) == ("failed", "the acquisition ended")
