"""An upload is checked: what may be wrong with it stands in the recording's statistics, and never refuses it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from service_fakes import API, MACHINE, Running, motion

from daq.machine.machine_file import parse_machine
from daq.recordings.recording import write_recording
from server.recordings import inspect_recording

pytestmark = pytest.mark.slow


def content(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> bytes:
    """A recording of the lever with a changed angle."""
    time, values = motion(20)
    values["joint1.angle"] = change(values["joint1.angle"])
    path = write_recording(folder / "made.csv", parse_machine(MACHINE), "train", time, values)
    return path.read_bytes()


def upload(running: Running, data: bytes) -> dict[str, object]:
    running.client.post(f"{API}/machines", content=MACHINE)
    parameters = {"machine": "lever", "role": "train", "name": "run.csv"}
    response = running.client.post(f"{API}/recordings/upload", params=parameters, content=data)
    assert response.status_code == 201, response.text
    return dict(response.json()["statistics"])


def slipped(angle: np.ndarray) -> np.ndarray:
    return angle + 0.3 * (np.arange(len(angle)) > 400)


def test_a_sound_recording_has_no_findings(running: Running, tmp_path: Path) -> None:
    assert upload(running, content(tmp_path, lambda angle: angle))["findings"] == []


def test_a_slipped_encoder_is_reported_with_its_cure(running: Running, tmp_path: Path) -> None:
    findings = upload(running, content(tmp_path, slipped))["findings"]
    assert isinstance(findings, list)
    assert [(own["code"], own["channel"], own["severity"]) for own in findings] == [("jump", "joint1.angle", "mistake")]
    assert "look after this sensor" in findings[0]["cure"]
    assert str(running.service.files.root) not in findings[0]["text"]


def test_an_upload_is_read_when_its_checks_fail(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(inspect_recording, "check_recordings", broken)
    machine = tmp_path / "machine.yaml"
    machine.write_text(MACHINE, encoding="utf-8")
    path = tmp_path / "made.csv"
    path.write_bytes(content(tmp_path, slipped))
    statistics = inspect_recording.look(path, machine, "train")["statistics"]
    assert statistics["rows"] > 0
    assert statistics["findings"] == []


#: Looks at a file and writes it as another form, as forks do, and names the modules that it loads meanwhile.
LOADED = """
import sys
from pathlib import Path
from server.recordings import inspect_recording
from server.recordings.formats import conversion_child
file, machine, target = map(Path, sys.argv[1:])
before = set(sys.modules)
inspect_recording.look(file, machine, "train")
conversion_child.do("parquet", file, target, machine, "shown")
print(*sorted(set(sys.modules) - before))
"""


def test_everything_that_work_on_a_recording_needs_is_loaded_before_the_fork(tmp_path: Path) -> None:
    """What a fork is the first to load, every other fork loads again: ten times what a small file takes."""
    machine, path = tmp_path / "machine.yaml", tmp_path / "made.csv"
    machine.write_text(MACHINE, encoding="utf-8")
    path.write_bytes(content(tmp_path, slipped))
    done = subprocess.run(
        [sys.executable, "-P", "-c", LOADED, path, machine, tmp_path / "written.parquet"],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    assert done.stdout.split() == [] and (tmp_path / "written.parquet").is_file()
