"""Recordings on shared storage: fetched, checked, gone afterwards; put there once, before a job needs them."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest
from service_fakes import MACHINE, Fakes, running_service

from server.identifications.identification_job import IdentificationKind
from server.identifications.identification_order import IdentificationOrders, Wish
from server.identifications.identification_resource import STAGE_PROGRAM
from server.identifications.identification_results import IdentificationResults
from server.jobs.job_kinds import StageRun
from server.jobs.job_store import Jobs
from server.platform.errors import StartError, UnavailableError
from server.platform.files import DataDirectory
from server.platform.processes.children import ChildResult
from server.recordings.recording_store import RecordingRow
from server.recordings.shared_recordings import SharedRecordings

CONTENT = b"a recording"


def row(**changes: Any) -> RecordingRow:
    values: dict[str, Any] = {
        "id": "rec-1",
        "machine": "lever",
        "machine_version": 1,
        "role": "train",
        "label": "",
        "state": "sealed",
        "origin": "recorded",
        "format": "parquet",
        "created": "2026-01-01T12:00:00.000Z",
        "bytes": len(CONTENT),
        "sha256": hashlib.sha256(CONTENT).hexdigest(),
    }
    return RecordingRow(**{**values, **changes})


@pytest.fixture(params=["memory", "file"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """Storage of two kinds: fsspec's memory, and a directory that is not there yet."""
    if request.param == "file":
        yield f"file://{tmp_path}/shared/recordings"
        return
    name = f"/{secrets.token_hex(4)}"
    yield f"memory:/{name}"
    if fsspec.filesystem("memory").exists(name):
        fsspec.filesystem("memory").rm(name, recursive=True)


@pytest.fixture
def local(tmp_path: Path) -> Path:
    path = tmp_path / "rec-1.parquet"
    path.write_bytes(CONTENT)
    return path


def test_what_was_put_is_fetched_as_it_was_and_is_gone_afterwards(url: str, local: Path, tmp_path: Path) -> None:
    scratch = tmp_path / "scratch"
    assert SharedRecordings(url).put(row(), local)
    assert not SharedRecordings(url).put(row(), local), "it is there"
    with SharedRecordings(url).fetched([row()], scratch) as found:
        assert found["rec-1"].read_bytes() == CONTENT
        assert found["rec-1"].suffix == ".parquet"
    assert list(scratch.iterdir()) == []
    files, root = fsspec.core.url_to_fs(url)
    assert [Path(place).name for place in files.ls(root, detail=False)] == ["rec-1.parquet"], "nothing half written"
    SharedRecordings(url).remove(row())
    SharedRecordings(url).remove(row())
    with (
        pytest.raises(UnavailableError, match=r"rec-1.*cannot be reached"),
        SharedRecordings(url).fetched([row()], scratch),
    ):
        raise AssertionError("it was fetched")
    assert list(scratch.iterdir()) == []


def test_a_copy_that_is_not_what_was_recorded_is_refused(url: str, local: Path, tmp_path: Path) -> None:
    SharedRecordings(url).put(row(), local)
    files, root = fsspec.core.url_to_fs(url)
    files.pipe_file(f"{root}/rec-1.parquet", b"b" + CONTENT[1:])
    with (
        pytest.raises(UnavailableError, match="SHA-256"),
        SharedRecordings(url).fetched([row()], tmp_path / "scratch"),
    ):
        raise AssertionError("it was fetched")
    assert list((tmp_path / "scratch").iterdir()) == []


def test_a_copy_that_was_cut_short_is_put_again(url: str, local: Path) -> None:
    SharedRecordings(url).put(row(), local)
    files, root = fsspec.core.url_to_fs(url)
    files.pipe_file(f"{root}/rec-1.parquet", CONTENT[:3])
    assert SharedRecordings(url).put(row(), local)
    assert files.cat_file(f"{root}/rec-1.parquet") == CONTENT


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("s9://site/recordings", "Protocol not known: s9); install hilfit"),
        ("s3://", "names no folder; write s3://bucket/folder"),
        ("recordings", "names no folder; write s3://bucket/folder"),
    ],
)
def test_a_url_that_cannot_be_used_is_said_in_one_line(url: str, says: str) -> None:
    with pytest.raises(StartError) as refused:
        SharedRecordings(url)
    assert f"recordings_url {url}: " in str(refused.value) and says in str(refused.value)
    assert "\n" not in str(refused.value)


class Buckets:
    """Storage without folders, as S3 is one: to make one is to make a bucket."""

    protocol = ("s3", "s3a")

    def __init__(self) -> None:
        self.kept: dict[str, bytes] = {}

    def info(self, place: str) -> dict[str, int]:
        raise FileNotFoundError(place)

    def makedirs(self, path: str, exist_ok: bool = False) -> None:
        raise AssertionError(f"made the bucket of {path}")

    def put_file(self, path: str, place: str) -> None:
        self.kept[place] = Path(path).read_bytes()


def test_an_upload_to_s3_creates_no_bucket(local: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    buckets = Buckets()
    monkeypatch.setattr("fsspec.core.url_to_fs", lambda url: (buckets, "site/recordings"))
    assert SharedRecordings("s3://site/recordings").put(row(), local)
    assert buckets.kept == {"site/recordings/rec-1.parquet": CONTENT}


@pytest.mark.slow
def test_a_host_without_the_server_s_recordings_reads_them_from_there(tmp_path: Path, csv: bytes) -> None:
    """What a worker on another host does, with the server's files of recordings out of its reach."""
    url = f"file://{tmp_path}/shared"
    fakes = Fakes()
    with running_service(tmp_path / "data", fakes, recordings_url=url) as running:
        running.client.post("/api/v1/machines", content=MACHINE)
        ids = [running.upload(csv, role) for role in ("train", "validate")]
        (kept,) = (path for path in (tmp_path / "data" / "recordings").glob(f"{ids[0]}.*"))
        assert not (tmp_path / "shared").exists(), "only what a job needs is put there"
        order = running.service[IdentificationOrders].order(
            Wish("lever", tuple((id, None) for id in ids), {}, ""), None
        )
        running.follow(order.job)
        assert sorted(path.stem for path in (tmp_path / "shared").iterdir()) == sorted(ids)
        content = kept.read_bytes()
        kept.unlink()
        seen: dict[str, Any] = {}

        def child(program: Any, arguments: Any, log: Path) -> ChildResult:
            seen.update(json.loads(Path(arguments[-2]).read_text()))
            seen["bytes"] = Path(seen["recordings"][0][1]).read_bytes()
            return ChildResult("done")

        database, files = running.service.database, DataDirectory(tmp_path / "data")
        kind = IdentificationKind(
            database, files, fakes.parts[STAGE_PROGRAM], SharedRecordings(url), tmp_path / "scratch"
        )
        job, place = running.service[Jobs].get(order.job), running.service[IdentificationResults].directory(order.id)
        assert kind.run(StageRun(job, "check", lambda *_: None, lambda: False, child, place, True)).outcome == "done"
        assert seen["bytes"] == content
        assert Path(seen["recordings"][0][1]).is_relative_to(tmp_path / "scratch")
        assert list((tmp_path / "scratch").iterdir()) == [], "nothing is left of it"
        request = json.loads((place / "request.json").read_text())
        assert request["recordings"][0][1] == str(kept), "what stays names the server's file"
        # Storage that is gone: the order is refused, and no job is made.
        fsspec.filesystem("file").rm(f"{tmp_path}/shared", recursive=True)
        (tmp_path / "shared").write_text("a file where the directory should be")
        before = running.service[Jobs].counts()
        answer = running.client.post(
            "/api/v1/identifications", json={"machine": "lever", "recordings": [{"id": id} for id in ids]}
        )
        assert (answer.status_code, before) == (503, running.service[Jobs].counts())
        assert "recordings_url" in answer.json()["detail"]
