"""Recalibrations as jobs: record, fit, compare with the active calibration, propose a new one.

Every stage begins by looking at what an earlier run of it left behind, so one that broke off goes on. The fit is an
identification like any other, with a job of its own that the stage waits for.
"""

from __future__ import annotations

import json
import secrets
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daq.messages import Sentence, named, with_their_messages
from daq.whole_files import write_whole
from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import ByPolicy
from server.identifications.identification_order import Wish
from server.identifications.identification_results import MODEL_FILE, IdentificationResults
from server.identifications.identification_store import Identification, Identifications
from server.jobs.job_kinds import AT_MACHINES, JobError, StageRun
from server.jobs.job_store import FINAL, Job, Jobs
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.processes.children import ChildResult
from server.recalibrations.recalibration_comparison import sentence
from server.recalibrations.recalibration_recording import RecordedStage
from server.recalibrations.recalibration_site import Site
from server.recalibrations.recalibration_store import Plan, Recalibration, Recalibrations
from server.recordings.recording_store import Recordings

#: The program that compares: ``[*PROGRAM, REQUEST.json]``.
PROGRAM = (sys.executable, "-P", "-m", "server.recalibrations.comparison_child")
WORDS = {
    "record": "Recording",
    "identify": "Fitting the new recordings",
    "compare": "Comparing with the active calibration",
    "propose": "Proposing the new calibration",
}
LOOK_S = 1.0


@dataclass(frozen=True)
class Surroundings:
    """Parts of the service that a recalibration uses.

    Attributes
    ----------
    identify : orders an identification; the same key gives the same one
    cancel : cancels a job
    recorders : as many as may record at a time; whoever has recorded gives its place on before it fits
    pause : waits that many seconds
    """

    calibrations: ByPolicy
    alarms: Alarms
    machines: Site
    identify: Callable[[Wish, str], Identification]
    cancel: Callable[[str], Any]
    recorders: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(64))
    pause: Callable[[float], Any] = threading.Event().wait


class RecalibrationKind:
    """Recalibrates one machine."""

    name = "recalibration"
    queue = AT_MACHINES

    def __init__(
        self, database: Database, files: DataDirectory, around: Surroundings, program: Sequence[str] = PROGRAM
    ) -> None:
        self._files = files
        self._around = around
        self._program = tuple(program)
        self._jobs = Jobs(database)
        self._recordings = Recordings(database)
        self._identifications = Identifications(database)
        self._recalibrations = Recalibrations(database)
        self._results = IdentificationResults(database, files)
        self._stages: dict[str, Callable[[StageRun, Recalibration], ChildResult]] = {
            "record": self._record,
            "identify": self._identify,
            "compare": self._compare,
            "propose": self._propose,
        }

    def words(self, stage: str) -> str:
        """Return what a person reads while ``stage`` runs."""
        return WORDS.get(stage, stage)

    def directory(self, job: Job) -> Path:
        """Locate the stages' places; only the comparison leaves files."""
        return self._files.recalibrations / job.subject

    def inputs(self, job: Job) -> tuple[Path, ...]:
        """Return none: it runs where the machines are."""
        return ()

    def run(self, run: StageRun) -> ChildResult:
        """Run one stage."""
        return self._stages[run.stage](run, self._recalibrations.get(run.job.subject))

    def _record(self, run: StageRun, this: Recalibration) -> ChildResult:
        reported = False
        while not self._around.recorders.acquire(blocking=False):
            if run.should_stop():
                return ChildResult("stopped")
            if not reported:
                run.progress(0.0, Sentence("server.waiting_for_others"))
                reported = True
            self._around.pause(LOOK_S)
        try:
            return self._recorded(run, this)
        finally:
            self._around.recorders.release()

    def _recorded(self, run: StageRun, this: Recalibration) -> ChildResult:
        around = self._around
        stage = RecordedStage(run, this, around.machines, self._recordings, self._recalibrations, around.pause)
        found = stage.record()
        return ChildResult("stopped") if found is None else ChildResult("done", summary={"recordings": found})

    def _identify(self, run: StageRun, this: Recalibration) -> ChildResult:
        wish = Wish(
            machine=this.machine,
            recordings=tuple((id, role) for role, id in this.recordings.items()),
            options=this.plan.options,
            label=this.label,
        )
        identification = self._around.identify(wish, f"recalibration {this.id}")
        self._recalibrations.note(this.id, identification=identification.id)
        shown = ""
        while (job := self._jobs.get(identification.job)).state not in FINAL:
            if run.should_stop():
                if self._jobs.cancelling(run.job.id):
                    self._around.cancel(job.id)
                return ChildResult("stopped")
            if job.text != shown:
                shown = job.text
                run.progress(job.fraction, job.sentence("text"))
            self._around.pause(LOOK_S)
        if job.state == "cancelled":
            raise JobError("server.identification_cancelled", identification=identification.id)
        if job.state == "failed":
            raise JobError(job.sentence("error") if job.error else Sentence("server.its_identification_failed"))
        return ChildResult("done", summary={"identification": identification.id})

    def _compare(self, run: StageRun, this: Recalibration) -> ChildResult:
        assert this.identification is not None
        active = self._around.calibrations.active(this.machine)
        if active is None:
            return ChildResult("done", summary={"note": Sentence("server.no_active_to_compare")})
        request = {
            "active": self._judged(active.source),
            "new": self._judged(this.identification),
        }
        path = run.place / "request.json"
        write_whole(path, json.dumps(request, indent=1).encode())
        result = run.child(self._program, [str(path)], run.place / "compare.log")
        if result.outcome == "input":
            # A calibration that cannot be compared can still be looked at by a person.
            note = Sentence("server.cannot_be_compared", error=result.error)
            result = ChildResult("done", summary={"note": note})
        if result.outcome == "done":
            self._recalibrations.note(this.id, comparison=with_their_messages({**result.summary, "active": active.id}))
        return result

    def _judged(self, identification: str) -> dict[str, Any]:
        """Return the model of an identification, and the recordings that it is judged by."""
        recordings = self._identifications.get(identification).recordings
        held_out = [id for id, role in recordings if role == "validate"]
        chosen = held_out or [id for id, role in recordings if role == "operation"]
        return {
            "model": str(self._results.directory(identification) / MODEL_FILE),
            "recordings": [str(self._files.recording(id, self._recordings.get(id).format)) for id in chosen],
        }

    def _propose(self, run: StageRun, this: Recalibration) -> ChildResult:
        assert this.identification is not None
        calibration = self._around.calibrations.propose(this.identification, this.label, this.plan.ordered_by)
        self._recalibrations.note(this.id, calibration=calibration.id)
        comparison = this.comparison or {}
        grew = comparison.get("grew") or []
        self._around.alarms.report(
            this.machine,
            "residual_grew",
            Sentence("server.more_unexplained", grew=grew, calibration=calibration.id),
            "warning",
            bool(grew),
        )
        adopted = this.plan.activate == "if_better" and bool(comparison.get("better"))
        if adopted:
            self._around.calibrations.activate(calibration.id, f"by policy: {sentence(comparison)}")
        return ChildResult("done", summary={"calibration": calibration.id, "activated": adopted})

    def result(self, job: Job, place: Path) -> None:
        """Return nothing: everything is stored by the stages."""

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Raise the alarm of a recalibration that failed, clear it after one that did not."""
        this = self._recalibrations.get(job.subject)
        if state != "cancelled":
            text = named(this.label, error or "")
            self._around.alarms.report(this.machine, "recalibration_failed", text, "warning", state == "failed")


def new_recalibration(machine: str, schedule: str | None, label: str, plan: Plan, now: str) -> Recalibration:
    """Make a recalibration that is yet to be stored."""
    return Recalibration(
        id=f"rcl-{secrets.token_hex(8)}",
        job=f"job-{secrets.token_hex(8)}",
        machine=machine,
        schedule=schedule,
        label=label or f"Recalibration of {machine}",
        plan=plan,
        created=now,
    )
