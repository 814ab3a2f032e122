"""Identifications as jobs: the stages of each share a process, and their results are files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
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
from server.recordings.shared_recordings import SharedRecordings


class IdentificationKind:
    """Fits recordings.

    Parameters
    ----------
    program : gives the stages and the command that runs one; called when the first job needs it
    shared : where recordings are fetched from; None: they are in the data directory
    scratch : directory for what is fetched
    """

    name = "identification"
    queue = NUMERICAL

    def __init__(
        self,
        database: Database,
        files: DataDirectory,
        program: Callable[[], StageProgram],
        shared: SharedRecordings | None = None,
        scratch: Path | None = None,
    ) -> None:
        self._files = files
        self._shared = shared
        self._scratch = scratch or files.root / "scratch"
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

    def run(self, run: StageRun) -> ChildResult:
        """One stage, in the process of the one before if it is there; those before it again if their files are gone."""
        identification = self._identifications.get(run.job.subject)
        rows = {id: self._recordings.get(id) for id, _ in identification.recordings}
        # What stays says where the service keeps recordings, also if this host reads copies of them.
        kept = {id: self._files.recordings / f"{id}.{row.format}" for id, row in rows.items()}
        request = self._request(identification, kept, run.place).write()
        if self._shared is None:
            return self._stages_of(run, request)
        with self._shared.fetched(tuple(rows.values()), self._scratch) as copies:
            scratch = self._scratch / f"{identification.id}.json"
            try:
                return self._stages_of(run, self._request(identification, copies, run.place).write(scratch))
            finally:
                scratch.unlink(missing_ok=True)

    def _stages_of(self, run: StageRun, request: Path) -> ChildResult:
        stages = (run.stage,) if run.whole else self.stages[: self.stages.index(run.stage) + 1]
        for stage in stages:
            result = run.child(self._program.command, [str(request), stage], run.place / f"{stage}.log")
            if result.outcome != "done":
                break
        return result

    def _request(self, identification: Identification, places: Mapping[str, Path], output: Path) -> StageRequest:
        recordings = tuple((role, places[id]) for id, role in identification.recordings)
        return StageRequest(
            machine=self._files.machine_file(identification.machine, identification.machine_version),
            recordings=recordings,
            options=identification.options,
            output=output,
        )

    def result(self, job: Job, place: Path) -> Result:
        """What the report says."""
        try:
            report = json.loads((place / "report.json").read_bytes())
            return self._identifications.result(job.subject, verdict_of(report), report["overall"])
        except (OSError, ValueError, KeyError, TypeError):
            raise JobError("The last stage left no report that can be read") from None

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Nobody waits for it here."""
