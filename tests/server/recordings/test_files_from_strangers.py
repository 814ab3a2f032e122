"""Files from outside: read by children with limits, a bounded number of them, while everybody else is answered."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy.io import savemat
from service_fakes import API, MACHINE, Running

from daq.errors import RecordingError
from server.machines.machine_uploads import MachineReader
from server.platform.errors import InvalidError
from server.platform.processes.file_children import FileChildren
from server.recordings.formats.declared_size import refuse_bombs

#: What plain PyYAML or pint never comes to an end with; the rest is in tests/daq/test_hostile_machine_files.py.
HOSTILE = {
    "a unit": MACHINE.replace("unit: deg", "unit: rad*9**9**9"),
    "aliases": "a: &a [x, x]\n"
    + "".join(f"{n}: &{n} [{','.join(['*' + b] * 9)}]\n" for b, n in zip("abcdefgh", "bcdefghi", strict=True)),
    "a number": "rate_hz: 1" + ":00" * 300_000,
    "a list": "joints: [" + "1," * 500_000 + "]",
}


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_machine_file_is_refused(running: Running, text: str) -> None:
    for place in ("machines", "machines/check"):
        answer = running.client.post(f"{API}/{place}", content=text)
        assert answer.status_code == 422, answer.text
        assert len(answer.json()["detail"]) < 400
    assert running.client.get("/healthz").status_code == 200


#: A child of which the time or the memory runs out as soon as it reads, as code that nobody thought of would make it.
BURNS, EATS = (
    "from server.machines import inspect_machine as i; i.MACHINE_FILE_CPU_S = 1\n"
    f"def parse(text, name): {what}\n"
    "import sys; i.parse_machine = parse\n"
    "from server.platform.processes import forking_child; sys.exit(forking_child.main(sys.argv[1:]))"
    for what in ("exec('while True: pass')", "return [0] * 10**10")
)


@pytest.mark.slow
@pytest.mark.parametrize("program", [BURNS, EATS])
def test_the_child_that_reads_has_little_time_and_memory(running: Running, program: str) -> None:
    with closing(FileChildren((sys.executable, "-c", program))) as children:
        reader = MachineReader(running.service.files, children)
        with pytest.raises(InvalidError, match="takes too"):
            reader.read(MACHINE.encode())


def test_the_next_file_is_read_after_one_that_ended_the_child(running: Running) -> None:
    for text in (HOSTILE["a unit"], MACHINE):
        answer = running.client.post(f"{API}/machines/check", content=text)
        assert answer.status_code == (422 if "9**9" in text else 200), answer.text


@pytest.mark.slow
def test_the_server_reads_no_machine_file_itself(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    import daq.machine.machine_file
    import daq.safe_yaml

    def refuse(text: str) -> object:
        raise AssertionError("read in the process that serves HTTP")

    monkeypatch.setattr(daq.safe_yaml, "read", refuse)
    made = running.client.post(f"{API}/machines", content=MACHINE.replace("name: lever", "name: unread"))
    assert made.status_code == 201, made.text
    assert running.client.get(f"{API}/machines/unread").json()["machine"]["name"] == "unread"


@pytest.mark.slow
def test_a_parquet_file_that_says_that_it_unpacks_to_much_is_not_unpacked(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    buffer = io.BytesIO()
    same = pa.array(np.zeros(10_000_000))  # kept once, with a count
    pyarrow.parquet.write_table(pa.table({"time": same, "a": same, "b": same, "c": same}), buffer)
    assert len(buffer.getvalue()) < 2**18
    given = {"machine": "lever", "role": "train", "name": "bomb.parquet"}
    answer = running.client.post(f"{API}/recordings/upload", params=given, content=buffer.getvalue())
    assert answer.status_code == 422
    assert re.match(r"bomb\.parquet: says that it unpacks to 305 MiB, \d+ times its size", answer.json()["detail"])


@pytest.mark.slow
def test_a_mat_file_that_says_that_it_unpacks_to_much_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mat"
    savemat(path, {"a": np.zeros(40_000_000)}, do_compression=True)
    assert path.stat().st_size < 2**20
    with pytest.raises(RecordingError, match="shown: says that it unpacks to 305 MiB"):
        refuse_bombs(path, "shown")
    savemat(path, {"a": np.random.default_rng(1).random(1000)}, do_compression=True)
    refuse_bombs(path, "an honest one")


@pytest.mark.slow
def test_a_child_that_reads_files_may_write_to_little_memory() -> None:
    eats = """
from pathlib import Path
from server.platform.processes.child_limits import limit_child
limit_child(60, 2**21)
try:
    bytearray(2**31)
except MemoryError:
    print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
"""
    # Not getrusage: its ru_maxrss counts what the process that started this one has had, up to its execve.
    done = subprocess.run([sys.executable, "-c", eats], capture_output=True, text=True)
    assert int(done.stdout) < 2**20, done.stderr  # KiB
