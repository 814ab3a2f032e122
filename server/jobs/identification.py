"""Identifications as jobs: each stage is a process, its results are files."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from server.children import ChildResult
from server.files import DataDirectory
from server.jobs.kinds import NUMERICAL, JobError, StageRun
from server.stages import StageProgram, StageRequest, words
from server.store import Database, Identification, Identifications, Job, Recordings


class IdentificationKind:
    """Fits recordings.

    Parameters
    ----------
    program : gives the stages and the command that runs one; called when the first job needs it
    """

    name = "identification"
    queue = NUMERICAL

    def __init__(self, database: Database, files: DataDirectory, program: Callable[[], StageProgram]) -> None:
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

    def run(self, run: StageRun) -> ChildResult:
        """One stage in a process of its own."""
        identification = self._identifications.get(run.job.subject)
        output = self._files.identifications / identification.id
        request = self._request(identification, output).write()
        return run.child([*self._program.command, str(request), run.stage], output / f"{run.stage}.log")

    def _request(self, identification: Identification, output: Path) -> StageRequest:
        recordings = tuple(
            (role, self._files.recordings / f"{id}.{self._recordings.get(id).format}")
            for id, role in identification.recordings
        )
        return StageRequest(
            machine=self._files.machine_file(identification.machine, identification.machine_version),
            recordings=recordings,
            options=identification.options,
            output=output,
        )

    def finish(self, job: Job) -> None:
        """Store what the report says."""
        try:
            report = json.loads((self._files.identifications / job.subject / "report.json").read_bytes())
            self._identifications.set_result(job.subject, report["loop"]["verdict"], report["overall"])
        except (OSError, ValueError, KeyError, TypeError):
            raise JobError("The last stage left no report that can be read") from None

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Nobody waits for it here."""
