"""The recordings of a recalibration: one that was cut is made again, a few times and not after the deadline."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from server.jobs.job_kinds import JobError, StageRun
from server.jobs.job_store import Job
from server.recalibrations.recalibration_recording import TRIES, RecordedStage
from server.recalibrations.recalibration_store import Plan, Recalibration
from server.recordings.recording_store import RecordingRow

RATE = 50.0
JOB = Job(id="job-1", kind="recalibration", label="", subject="rcl-1", stages=(), state="running", created="")
THIS = Recalibration(
    id="rcl-1",
    job="job-1",
    machine="lever",
    schedule=None,
    label="Nightly",
    plan=Plan(duration_s=30.0, deadline_s=600.0),
    created="",
)


class Site:
    """Machines, recordings and notes; each recording ends with the next of ``rows``."""

    def __init__(self, rows: list[int], seconds_each: float = 1.0) -> None:
        self.rows = list(rows)
        self.made: dict[str, RecordingRow] = {}
        self.notes: dict[str, Any] = {}
        self.said: list[str] = []
        self.time = 0.0
        self._each = seconds_each

    def start_recording(self, machine: str, role: str, label: str, seconds: float) -> RecordingRow:
        id = f"rec-{len(self.made) + 1}"
        rows = self.rows.pop(0)
        row = RecordingRow(
            id=id,
            machine=machine,
            machine_version=1,
            role=role,
            label=label,
            state="sealed",
            origin="recorded",
            format="parquet",
            created="",
            statistics={"rows": rows},
        )
        self.made[id] = row
        return row.but(state="recording")

    def stop_recording(self, id: str) -> None:
        raise AssertionError("nobody asked to stop")

    def controller(self, machine: str) -> None:
        return None

    def motion_seconds(self, excitation: str) -> float:
        raise AssertionError("normal operation has no motion")

    def rate_hz(self, machine: str) -> float:
        return RATE

    def now(self) -> str:
        return f"2026-01-01T00:{int(self.time // 60):02d}:{self.time % 60:06.3f}Z"

    def get(self, id: str) -> RecordingRow:
        return self.made[id]

    def note(self, id: str, **values: Any) -> None:
        self.notes |= values

    def pause(self, seconds: float) -> None:
        self.time += self._each

    def record(self) -> dict[str, str] | None:
        store: Any = self
        run = StageRun(
            JOB, "record", lambda fraction, text: self.said.append(text), lambda: False, store, Path(), False
        )
        return RecordedStage(run, THIS, self, store, store, self.pause).record()


def test_a_recording_that_was_cut_is_made_again_and_the_whole_one_counts() -> None:
    site = Site([300, 990, 100, 500])  # of 1000 and 500
    assert site.record() == {"operation": "rec-2", "validate": "rec-4"}
    assert [row.role for row in site.made.values()] == ["operation", "operation", "validate", "validate"]
    assert site.notes["recordings"] == {"operation": "rec-2", "validate": "rec-4"}


def test_a_recording_that_ends_early_is_tried_a_limited_number_of_times() -> None:
    site = Site([10] * (TRIES + 1))
    with pytest.raises(JobError, match=f"rec-{TRIES} ended early, {TRIES} times over; check the machine"):
        site.record()
    assert len(site.made) == TRIES


def test_no_recording_is_started_after_the_deadline() -> None:
    site = Site([10] * TRIES, seconds_each=400.0)
    with pytest.raises(JobError, match="until 2026-01-01T00:10 UTC"):
        site.record()
    assert len(site.made) == 2
