"""What hosts share: found by content, checked, bounded; results that travel; a job whose files are out of reach."""

from __future__ import annotations

import hashlib
import secrets
import time
from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest
from service_fakes import Fakes, running_service

from server.identifications.identification_results import IdentificationResults
from server.jobs.job_runner import JobRunner
from server.jobs.job_store import Jobs
from server.platform.errors import InvalidError, StartError
from server.platform.files import DataDirectory
from server.platform.storage import IDENTITY, DataFolder, SharedStorage, StorageAwayError, input_key

CONTENT = b"a recording"
SHA = hashlib.sha256(CONTENT).hexdigest()
BOUND = 2**20


@pytest.fixture(params=["memory", "file"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """Storage of two kinds: fsspec's memory, and a directory that is not there yet."""
    if request.param == "file":
        yield f"file://{tmp_path}/shared/hilfit"
        return
    name = f"/{secrets.token_hex(4)}"
    yield f"memory:/{name}"
    if fsspec.filesystem("memory").exists(name):
        fsspec.filesystem("memory").rm(name, recursive=True)


@pytest.fixture
def local(tmp_path: Path) -> Path:
    path = tmp_path / "server" / "recordings" / "rec-1.parquet"
    path.parent.mkdir(parents=True)
    path.write_bytes(CONTENT)
    return path


def test_an_input_is_fetched_once_and_only_where_it_is_not(url: str, local: Path, tmp_path: Path) -> None:
    server, worker = (SharedStorage(url, tmp_path / name, BOUND) for name in ("server", "worker"))
    server.put(local, input_key(SHA))
    wanted = {"recordings/rec-1.parquet": SHA}
    assert server.local(wanted) == {"recordings/rec-1.parquet": local}
    (copy,) = worker.local(wanted).values()
    assert (copy.name, copy.read_bytes()) == (local.name, CONTENT)
    server.forget(SHA)
    server.forget(SHA)
    assert worker.local(wanted)["recordings/rec-1.parquet"] == copy, "it is in the cache"
    with pytest.raises(StorageAwayError, match="cannot be reached"):
        SharedStorage(url, tmp_path / "third", BOUND).local(wanted)


def test_the_cache_has_a_bound_and_what_is_needed_now_stays(url: str, tmp_path: Path) -> None:
    server, worker = (SharedStorage(url, tmp_path / name, 25) for name in ("server", "worker"))
    sums = {}
    for number in range(5):
        path = tmp_path / f"{number}.csv"
        path.write_bytes(bytes([65 + number]) * 10)
        sums[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
        server.put(path, input_key(sums[path.name]))
        worker.local({path.name: sums[path.name]})
    assert sum(path.stat().st_size for path in (tmp_path / "worker" / "cache").rglob("*.csv")) <= 25
    assert all(path.is_file() for path in worker.local(sums).values()), "all five are needed"


def test_what_was_changed_there_is_never_read_and_a_copy_that_broke_off_is_put_again(
    url: str, local: Path, tmp_path: Path
) -> None:
    files, root = fsspec.core.url_to_fs(url)
    files.makedirs(f"{root}/inputs", exist_ok=True)
    files.pipe_file(f"{root}/{input_key(SHA)}", CONTENT[::-1])
    worker = SharedStorage(url, tmp_path / "worker", BOUND)
    with pytest.raises(InvalidError, match="SHA-256 differs"):
        worker.local({"recordings/rec-1.parquet": SHA})
    assert not [path for path in (tmp_path / "worker").rglob("*") if path.is_file()]
    files.pipe_file(f"{root}/{input_key(SHA)}", CONTENT[:3])
    worker.put(local, input_key(SHA))
    assert worker.local({"recordings/rec-1.parquet": SHA})["recordings/rec-1.parquet"].read_bytes() == CONTENT


def test_a_place_travels_whole_or_not_at_all_and_what_does_not_count_is_removed(url: str, tmp_path: Path) -> None:
    one, two = (SharedStorage(url, tmp_path / name, BOUND) for name in ("one", "two"))
    place = tmp_path / "one" / "identifications" / "idn-1" / "1-check"
    (place / "stages").mkdir(parents=True)
    (place / "stages" / "check.json").write_text("{}")
    (place / "check.log").write_text("first")
    first = one.keep(place, "identifications/idn-1")
    (place / "check.log").write_text("second")
    last = one.keep(place, "identifications/idn-1")
    assert first.keys() == last.keys() == {"stages/check.json", "check.log"}
    one.tidy("identifications/idn-1", set(last.values()))
    copy = tmp_path / "two" / "identifications" / "idn-1" / "1-check"
    copy.parent.mkdir(parents=True)
    with pytest.raises(StorageAwayError):
        two.bring(copy, "identifications/idn-1", first)
    assert list(copy.parent.iterdir()) == [], "nothing half"
    two.bring(copy, "identifications/idn-1", last)
    assert (copy / "check.log").read_text() == "second" and (copy / "stages" / "check.json").is_file()


def test_a_storage_belongs_to_one_store(url: str, tmp_path: Path) -> None:
    server, worker = (SharedStorage(url, tmp_path / name, BOUND) for name in ("server", "worker"))
    (tmp_path / "server").mkdir()
    assert "no server has used it yet" in (worker.check("store-1") or "")
    server.claim("store-1")
    server.claim("store-1")
    assert worker.check("store-1") is None
    assert "belongs to another store" in (worker.check("store-2") or "")
    with pytest.raises(StartError, match="belongs to another store"):
        server.claim("store-2")


def test_a_worker_without_a_storage_takes_nothing_but_beside_its_server(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path)
    assert "is no data directory of a server" in (folder.check("store-1") or "")
    folder.claim("store-1")
    assert folder.check("store-1") is None
    assert "of another store" in (folder.check("store-2") or "")


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("s9://site/recordings", "Protocol not known: s9); install hilfit"),
        ("s3://", "names no folder; write s3://bucket/folder"),
        ("recordings", "names no folder; write s3://bucket/folder"),
    ],
)
def test_a_url_that_cannot_be_used_is_said_in_one_line(url: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(StartError) as refused:
        SharedStorage(url, tmp_path, BOUND)
    assert f"storage_url {url}: " in str(refused.value) and says in str(refused.value)
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


def test_an_upload_to_s3_creates_no_bucket(local: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    buckets = Buckets()
    monkeypatch.setattr("fsspec.core.url_to_fs", lambda url, **options: (buckets, "site/hilfit"))
    SharedStorage("s3://site/hilfit", tmp_path, BOUND).put(local, input_key(SHA))
    assert buckets.kept == {f"site/hilfit/inputs/{SHA}": CONTENT}


@pytest.mark.slow
def test_a_job_s_files_travel_and_an_order_waits_for_a_storage_that_is_away(tmp_path: Path, csv: bytes) -> None:
    shared = tmp_path / "shared"
    with running_service(tmp_path / "data", Fakes(), storage_url=f"file://{shared}") as running:
        order = running.order(csv)
        assert running.follow(order.job)[-1]["state"] == "done"
        jobs = running.service[Jobs]
        assert (shared / IDENTITY).read_text() == jobs.store()
        inputs, results = jobs.files(order.job, "input"), jobs.files(order.job, "result")
        assert sorted(path.name for path in (shared / "inputs").iterdir()) == sorted(set(inputs.values()))
        kept, end = shared / "identifications" / order.id, time.monotonic() + 60
        while {path.name for path in kept.iterdir()} != set(results.values()):  # what other stages left goes
            assert time.monotonic() < end
            time.sleep(0.05)
        # A server that has lost its copy, or never had one, reads what the worker left.
        there = running.service[IdentificationResults].directory(order.id)
        other = DataDirectory(tmp_path / "other", f"file://{shared}")
        again = IdentificationResults(running.service.database, other).directory(order.id)
        assert (again / "report.json").read_bytes() == (there / "report.json").read_bytes()
        # An order while the storage is away is taken, and waits.
        shared.rename(tmp_path / "away")
        shared.write_text("a file where the directory should be")
        second = running.order(csv)
        assert jobs.get(second.job).state == "queued"
        shared.unlink()
        (tmp_path / "away").rename(shared)
        running.service[JobRunner].reconcile()
        assert running.follow(second.job)[-1]["state"] == "done"
