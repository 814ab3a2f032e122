"""Identifications as jobs: the stages of each share a process, and their results are files."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from server.identifications.identification_store import Identification, Identifications
from server.identifications.report_verdict import verdict_of
from server.identifications.stage_request import StageProgram, StageRequest, words
from server.jobs.job_kinds import NUMERICAL, JobError, StageRun
from server.jobs.job_store import Job, Result
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.processes.children import ChildResult
from server.recordings.recording_store import Recordings


class IdentificationKind:
    """Fits recordings.

    Parameters
    ----------
    program : gives the stages and the command that runs one; called when the first job needs it
    """

    name = "identification"
    queue = NUMERICAL

    def __init__(
        self,
        database: Database,
        files: DataDirectory,
        program: Callable[[], StageProgram],
    ) -> None:
        self._files = files
        self._make_program = program
        self._identifications = Identifications(database)
        self._recordings = Recordings(database)

    @property
    def stages(self) -> tuple[str, ...]:
        """Stages of an identification, in order."""
        return self._program.stages

    @cached_property
    def _program(self) -> StageProgram:
        return self._make_program()

    def words(self, stage: str) -> str:
        """What a person reads while ``stage`` runs."""
        return words(stage)

    def directory(self, job: Job) -> Path:
        """Where the stages get their places."""
        return self._files.identifications / job.subject

    def inputs(self, job: Job) -> tuple[Path, ...]:
        """The machine file, then the recordings."""
        return self._paths(self._identifications.get(job.subject))

    def _paths(self, identification: Identification) -> tuple[Path, ...]:
        rows = [self._recordings.get(id) for id, _ in identification.recordings]
        machine = self._files.machine_file(identification.machine, identification.machine_version)
        return (machine, *(self._files.recording(row.id, row.format) for row in rows))

    def run(self, run: StageRun) -> ChildResult:
        """One stage, in the process of the one before if it is there; those before it again if their files are gone."""
        identification = self._identifications.get(run.job.subject)
        machine, *recordings = map(run.here, self._paths(identification))
        roles = [role for _, role in identification.recordings]
        request = StageRequest(
            machine, tuple(zip(roles, recordings, strict=True)), identification.options, run.place
        ).write()
        stages = (run.stage,) if run.whole else self.stages[: self.stages.index(run.stage) + 1]
        for stage in stages:
            result = run.child(self._program.command, [str(request), stage], run.place / f"{stage}.log")
            if result.outcome != "done":
                break
        return result

    def result(self, job: Job, place: Path) -> Result:
        """What the report says."""
        try:
            report = json.loads((place / "report.json").read_bytes())
            return self._identifications.result(job.subject, verdict_of(report), report["overall"])
        except (OSError, ValueError, KeyError, TypeError):
            raise JobError("The last stage left no report that can be read") from None

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Nobody waits for it here."""
