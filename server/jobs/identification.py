"""Identifications as jobs: each stage is a process, its results are files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path

from server.calibrations.content import verdict_of
from server.children import ChildResult
from server.files import DataDirectory
from server.jobs.kinds import NUMERICAL, JobError, StageRun
from server.shared_recordings import SharedRecordings
from server.stages import StageProgram, StageRequest, words
from server.store import Database, Identification, Identifications, Job, Recordings
from server.store.jobs import Result


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

    def run(self, run: StageRun) -> ChildResult:
        """One stage in a process of its own."""
        identification = self._identifications.get(run.job.subject)
        output = self._files.identifications / identification.id
        log = output / f"{run.stage}.log"
        rows = {id: self._recordings.get(id) for id, _ in identification.recordings}
        # What stays says where the service keeps recordings, also if this host reads copies of them.
        kept = {id: self._files.recordings / f"{id}.{row.format}" for id, row in rows.items()}
        request = self._request(identification, kept, output).write()
        if self._shared is None:
            return run.child([*self._program.command, str(request), run.stage], log)
        with self._shared.fetched(tuple(rows.values()), self._scratch) as copies:
            request = self._request(identification, copies, output).write(self._scratch / f"{identification.id}.json")
            try:
                return run.child([*self._program.command, str(request), run.stage], log)
            finally:
                request.unlink(missing_ok=True)

    def _request(self, identification: Identification, places: Mapping[str, Path], output: Path) -> StageRequest:
        recordings = tuple((role, places[id]) for id, role in identification.recordings)
        return StageRequest(
            machine=self._files.machine_file(identification.machine, identification.machine_version),
            recordings=recordings,
            options=identification.options,
            output=output,
        )

    def result(self, job: Job) -> Result:
        """What the report says."""
        try:
            report = json.loads((self._files.identifications / job.subject / "report.json").read_bytes())
            return self._identifications.result(job.subject, verdict_of(report), report["overall"])
        except (OSError, ValueError, KeyError, TypeError):
            raise JobError("The last stage left no report that can be read") from None

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Nobody waits for it here."""
