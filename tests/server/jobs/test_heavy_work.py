"""Heavy work is bounded, and keeps nobody waiting who only reads."""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from service_fakes import API, MACHINE, Fakes, file_children, running_service

from server.platform.processes import heavy_work as heavy
from server.platform.processes.children import ChildResult
from server.platform.processes.file_children import FileChildren
from server.recordings import recording_uploads

pytestmark = pytest.mark.slow

#: What looks at files, with memory for what it has loaded and a little more: so does a small bomb for a large one.
SMALL = """
import sys
from server.platform.processes import child_limits, forking_child
child_limits._PROGRAM_BYTES = 2**31
sys.exit(forking_child.main(sys.argv[1:]))
"""


@pytest.mark.timeout(900)
def test_a_small_file_that_unfolds_to_gigabytes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_uploads, "INSPECTION_S", 800.0)  # it is memory that ends it, on a busy computer too
    column = pa.array(np.ones(2**21, np.int8))
    buffer = io.BytesIO()
    schema = pa.schema([(name, column.type) for name in ("time", "joint1.angle", "joint1.torque")])
    with pyarrow.parquet.ParquetWriter(buffer, schema, use_dictionary=False, compression="zstd") as writer:
        for _ in range(50):
            writer.write_table(pa.table([column] * 3, schema=schema))
    content = buffer.getvalue()
    assert len(content) < 2**21 < 2**31 < 50 * 2**21 * 3 * 8
    parameters = {"machine": "lever", "role": "train", "name": "x.parquet"}
    children = FileChildren((sys.executable, "-c", SMALL))
    with closing(children), running_service(tmp_path, behind(children)) as running:
        running.client.post(f"{API}/machines", content=MACHINE)
        answer = running.client.post(f"{API}/recordings/upload", params=parameters, content=content)
    assert answer.status_code == 422, answer.text
    assert "says that it unpacks to 2400 MiB" in answer.json()["detail"]


class Gate:
    """A reader of recordings that counts how many read at once, and waits until it may end."""

    def __init__(self) -> None:
        self.open, self.entered = threading.Event(), threading.Event()
        self.now = self.most = 0
        self._lock = threading.Lock()

    def run(self, module: str, *arguments: object, **options: Any) -> ChildResult:
        if module != "server.recordings.inspect_recording":  # a machine file
            return file_children().run(module, *arguments, **options)
        with self._lock:
            self.now += 1
            self.most = max(self.most, self.now)
        self.entered.set()
        assert self.open.wait(60)
        with self._lock:
            self.now -= 1
        return ChildResult("input", error="not good")


@pytest.fixture
def gate() -> Gate:
    return Gate()


def behind(reader: Gate | FileChildren) -> Fakes:
    """A service whose uploads are looked at by ``reader``."""
    fakes = Fakes()
    fakes.parts[FileChildren] = reader
    return fakes


@contextmanager
def threads(count: int, gate: Gate) -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(count) as pool:
        try:
            yield pool
        finally:
            gate.open.set()


def test_many_uploads_at_once_do_not_delay_other_requests(tmp_path: Path, csv: bytes, gate: Gate) -> None:
    with running_service(tmp_path, behind(gate)) as running, threads(45, gate) as pool:
        assert running.client.post(f"{API}/machines", content=MACHINE).status_code == 201

        def upload(number: int) -> tuple[int, str | None]:
            answer = running.client.post(
                f"{API}/recordings/upload",
                params={"machine": "lever", "role": "train", "name": f"{number}.csv"},
                content=csv,
            )
            return answer.status_code, answer.headers.get("retry-after")

        waiting = [pool.submit(upload, number) for number in range(45)]
        answered = as_completed(waiting, timeout=240)
        for _ in range(45 - heavy.SHARE):  # those are answered at once; the others wait
            next(answered)
        for path in ("/healthz", f"{API}/machines", f"{API}/status", f"{API}/recordings", f"{API}/machines/lever"):
            assert running.client.get(path).status_code == 200
        assert 0 < gate.most <= heavy.SLOTS
        gate.open.set()
        answers = [future.result() for future in waiting]
    assert sorted(set(answers)) == [(422, None), (429, "5")]
    assert answers.count((429, "5")) == 45 - heavy.SHARE
    assert gate.most <= heavy.SLOTS


def test_when_all_places_are_taken_everybody_is_told_to_come_again(tmp_path: Path, csv: bytes, gate: Gate) -> None:
    with running_service(tmp_path, behind(gate)) as running, threads(2, gate) as pool:
        running.client.post(f"{API}/machines", content=MACHINE)
        running.service.heavy = heavy.Heavy(slots=1, places=2, share=2)
        running.service.heavy._taken["another"] = 1
        parameters = {"machine": "lever", "role": "train", "name": "made.csv"}
        first = pool.submit(running.client.post, f"{API}/recordings/upload", params=parameters, content=csv)
        assert gate.entered.wait(60)
        second = running.client.post(f"{API}/recordings/upload", params=parameters, content=csv)
        assert (second.status_code, second.headers["retry-after"]) == (503, "5")
        assert second.json()["type"] == "urn:hilfit:problem:busy"
        gate.open.set()
        assert first.result().status_code == 422
