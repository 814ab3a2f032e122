"""What a fit leaves ambiguous on the simulated machine: its motion is recorded, and everything is fitted again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from server.jobs.job_kinds import StageRun
from server.jobs.job_store import Job
from server.platform.errors import UnavailableError
from server.recalibrations.recalibration_recording import TRIES, Scene
from server.recalibrations.recalibration_resolving import asked_for, resolved
from server.recalibrations.recalibration_store import Plan, Recalibration
from server.recordings.recording_store import RecordingRow

RATE = 50.0
JOB = Job("job-1", "recalibration", "", "rcl-1", (), "running", None, 0.0, "", None, False, "", None, None)
THIS = Recalibration("rcl-1", "job-1", "lever", None, "Nightly", Plan(), "", recordings={"train": "t", "validate": "v"})


def report(place: Path, probability: float, rods: str = "pinned", motion: bool = True) -> None:
    """Leave what an identification leaves."""
    place.mkdir()
    experiment = {"motion_file": "next-experiment.csv" if motion else None, "rods": rods, "seconds": 21.0}
    loop = {"next_experiment": experiment, "hypotheses": [{"probability": probability}]}
    (place / "report.json").write_text(json.dumps({"loop": loop}))
    (place / "next-experiment.csv").write_text(f"motion of {place.name}")


class Machine:
    """The simulated machine: its controller, its recordings, and identifications whose probabilities are given."""

    def __init__(self, place: Path, probabilities: list[float], rows: int = 1000) -> None:
        self.place, self.probabilities, self.rows = place, probabilities, rows
        self.sent: list[str] = []
        self.made: dict[str, RecordingRow] = {}
        self.orders: list[dict[str, tuple[str, str]]] = []
        self.noted: dict[str, Any] = {}
        self.real, self.refuses = False, False
        report(place / "idn-0", probabilities[0])

    def controller(self, machine: str) -> Any:
        return None if self.real else self

    def send_file(self, name: str, motion: Path) -> None:
        self.sent.append(motion.read_text())

    def follows(self, name: str) -> bool:
        if self.refuses:
            raise UnavailableError("the simulated controller refused the motion")
        return True

    def start_recording(self, machine: str, role: str, label: str, seconds: float) -> RecordingRow:
        id = f"rec-{len(self.made) + 1}"
        row = RecordingRow(
            id, machine, 1, role, label, "sealed", "recorded", "parquet", "", statistics={"rows": self.rows}
        )
        self.made[id] = row
        return replace(row, state="recording")

    def get(self, id: str) -> RecordingRow:
        return self.made[id]

    def note(self, id: str, **values: Any) -> None:
        self.noted |= values

    def rate_hz(self, machine: str) -> float:
        return RATE

    def now(self) -> str:
        return "2026-01-01T00:00:00.000Z"

    def identify(self, more: dict[str, tuple[str, str]]) -> str:
        self.orders.append(more)
        id = f"idn-{len(self.orders)}"
        report(self.place / id, self.probabilities[len(self.orders)])
        return id

    def resolve(self, this: Recalibration = THIS) -> str | None:
        store: Any = self
        run = StageRun(JOB, "identify", lambda fraction, text: None, lambda: False, store, Path(), False)
        scene = Scene(run, store, store, store, lambda seconds: None, "2026-01-01T01:00:00.000Z")
        return resolved(scene, this, "idn-0", lambda id: self.place / id, self.identify)


def test_its_motion_is_recorded_and_fitted_until_one_explanation_is_enough(tmp_path: Path) -> None:
    machine = Machine(tmp_path, [0.6, 0.97])
    assert machine.resolve() == "idn-1"
    assert machine.sent == ["motion of idn-0"]
    assert machine.orders == [{"resolve-1": ("rec-1", "train")}]
    assert machine.noted["recordings"] == {"train": "t", "validate": "v", "resolve-1": "rec-1"}


def test_two_motions_are_the_most(tmp_path: Path) -> None:
    machine = Machine(tmp_path, [0.6, 0.7, 0.8])
    assert machine.resolve() == "idn-2"
    assert machine.sent == ["motion of idn-0", "motion of idn-1"]
    assert machine.orders[1] == {"resolve-1": ("rec-1", "train"), "resolve-2": ("rec-2", "train")}


def test_what_was_recorded_before_an_interruption_is_not_recorded_again(tmp_path: Path) -> None:
    machine = Machine(tmp_path, [0.6, 0.97])
    machine.start_recording("lever", "train", "", 20.0)
    assert machine.resolve(replace(THIS, recordings={**THIS.recordings, "resolve-1": "rec-1"})) == "idn-1"
    assert machine.sent == []
    assert len(machine.made) == 1


def test_a_real_machine_waits_for_nobody(tmp_path: Path) -> None:
    machine = Machine(tmp_path, [0.6])
    machine.real = True
    assert machine.resolve() == "idn-0"
    assert machine.orders == []


@pytest.mark.parametrize("trouble", ["refused", "cut"])
def test_a_motion_that_cannot_be_recorded_leaves_the_fit_as_it_is(tmp_path: Path, trouble: str) -> None:
    machine = Machine(tmp_path, [0.6], rows=1000 if trouble == "refused" else 10)
    machine.refuses = trouble == "refused"
    assert machine.resolve() == "idn-0"
    assert machine.orders == []
    assert len(machine.made) == (0 if trouble == "refused" else TRIES)


def test_free_cylinders_are_recorded_as_unloaded_and_without_a_motion_nothing_is_asked(tmp_path: Path) -> None:
    report(tmp_path / "free", 0.6, rods="unpinned")
    assert asked_for(tmp_path / "free") == (tmp_path / "free" / "next-experiment.csv", "unloaded", 21.0)
    report(tmp_path / "none", 0.6, motion=False)
    assert asked_for(tmp_path / "none") is None
    report(tmp_path / "sure", 0.96)
    assert asked_for(tmp_path / "sure") is None
