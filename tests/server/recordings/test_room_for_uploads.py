"""Uploads and the disk: what is kept free stays free, a cut upload is one line, a file that is there is said."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from service_fakes import API, MACHINE, Fakes, Running, recording_bytes, running_service

from server.platform.files import RESERVE_BYTES
from server.recordings.recording_resource import FREE
from server.recordings.recording_sessions import Sessions

pytestmark = pytest.mark.slow
PARAMETERS = {"machine": "lever", "role": "train", "name": "run.csv"}


class Disk:
    """A disk that says what a test wants; each look may find less."""

    def __init__(self) -> None:
        self.free, self.less = 10**12, 0

    def __call__(self) -> int:
        self.free -= self.less
        return self.free


@pytest.fixture(scope="module")
def disk() -> Disk:
    return Disk()


@pytest.fixture(scope="module")
def site(disk: Disk, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    fakes = Fakes()
    fakes.parts |= {FREE: disk}
    with running_service(tmp_path_factory.mktemp("site"), fakes) as running:
        running.client.post(f"{API}/machines", content=MACHINE)
        yield running


@pytest.fixture(autouse=True)
def plenty(disk: Disk) -> Iterator[None]:
    yield
    disk.free, disk.less = 10**12, 0


def upload(site: Running, content: Any) -> Any:
    return site.client.post(f"{API}/recordings/upload", params=PARAMETERS, content=content)


def nothing_is_left(site: Running) -> bool:
    return not list(site.service.files.recordings.glob(".incoming-*"))


def test_the_length_of_an_upload_is_looked_at_before_its_body(site: Running, disk: Disk, tmp_path: Path) -> None:
    content = recording_bytes(tmp_path, "train", ".csv")
    disk.free = RESERVE_BYTES + len(content)  # it would fit, and nothing of what is kept would be touched but one byte
    answer = upload(site, content)
    assert answer.status_code == 409
    assert "the disk is full" in answer.json()["detail"]
    disk.free += 2**20
    answer = upload(site, content)
    assert answer.status_code == 201, answer.text
    assert nothing_is_left(site)


def test_the_disk_is_looked_at_again_while_an_upload_comes_in(site: Running, disk: Disk) -> None:
    disk.free, disk.less = RESERVE_BYTES + 3 * 2**20, 2 * 2**20
    sent = []

    def chunks() -> Iterator[bytes]:  # without a length
        for _ in range(16):
            sent.append(1)
            yield b"x" * 2**20

    answer = upload(site, chunks())
    assert answer.status_code == 409
    assert "the disk is full" in answer.json()["detail"]
    assert nothing_is_left(site)


def test_an_upload_that_its_client_cuts_is_one_line_of_the_log(site: Running, caplog: pytest.LogCaptureFixture) -> None:
    app: Any = site.client.app
    messages = [{"type": "http.request", "body": b"time,", "more_body": True}, {"type": "http.disconnect"}]
    query = "&".join(f"{key}={value}" for key, value in PARAMETERS.items()).encode()
    scope = {
        "type": "http", "http_version": "1.1", "method": "POST", "path": f"{API}/recordings/upload", "root_path": "",
        "raw_path": b"", "query_string": query, "scheme": "http", "client": ("127.0.0.1", 1), "state": {},
        "server": ("127.0.0.1", 8350), "headers": [(b"host", b"127.0.0.1:8350"), (b"content-length", b"999")],
    }  # fmt: skip

    async def receive() -> dict[str, Any]:
        return messages.pop(0) if messages else {"type": "http.disconnect"}

    async def send(_message: dict[str, Any]) -> None: ...

    with caplog.at_level(logging.INFO):
        asyncio.run(app(scope, receive, send))
    told = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(told) == 1 and "request_cut" in str(told[0].msg)
    assert all(record.exc_info is None for record in told)
    assert nothing_is_left(site)


def test_the_same_file_twice_is_said(site: Running, tmp_path: Path) -> None:
    content = recording_bytes(tmp_path, "validate", ".csv") + b"\n"
    first = upload(site, content).json()
    codes = [own["code"] for own in first["statistics"]["findings"]]
    assert "same_file" not in codes
    again = upload(site, content).json()
    found = [own for own in again["statistics"]["findings"] if own["code"] == "same_file"]
    assert [own["text"] for own in found] == [f"is byte for byte the file of recording {first['id']}"]
    assert again["id"] != first["id"]


def test_files_that_the_store_does_not_know_are_listed(site: Running, caplog: pytest.LogCaptureFixture) -> None:
    stray = site.service.files.recordings / "rec-0123456789abcdef.parquet"
    stray.write_bytes(b"whole, and its upload was killed before the store knew it")
    with caplog.at_level(logging.WARNING):
        site.service[Sessions].recover()
    assert [record for record in caplog.records if "rec-0123456789abcdef.parquet" in str(record.msg)]
    assert stray.is_file()
    stray.unlink()


def test_recordings_are_found_by_time_and_label(site: Running, tmp_path: Path) -> None:
    content = recording_bytes(tmp_path, "operation", ".csv") + b"\n\n"
    made = [
        site.client.post(f"{API}/recordings/upload", params={**PARAMETERS, "name": name}, content=content).json()
        for name in ("Kran-Nord.csv", "kran-süd.csv", "50%.csv")
    ]

    def found(**wanted: str) -> list[str]:
        answer = site.client.get(f"{API}/recordings", params=wanted)
        assert answer.status_code == 200, answer.text
        ids = {own["id"] for own in made}
        return [own["label"] for own in answer.json()["items"] if own["id"] in ids]

    assert found(label="KRAN") == ["kran-süd.csv", "Kran-Nord.csv"]
    assert found(label="%") == ["50%.csv"]
    assert found(since=made[1]["created"], until=made[2]["created"]) == ["kran-süd.csv"]
    for wrong in ("2026-06-01T02:00:00", "yesterday", "0001-01-01T00:00:00+14:00"):
        assert site.client.get(f"{API}/recordings", params={"since": wrong}).status_code == 422
