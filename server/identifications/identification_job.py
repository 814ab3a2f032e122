"""Fits as jobs: the stages of each share a process, and their results are files."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, get_args

from daq.whole_files import write_whole
from fitting.pipeline.stage_names import STAGES, VALVE_WORDS, WORDS, ReportLanguage
from server.identifications.identification_results import verdict_of
from server.identifications.identification_store import Fit, Fits, Identifications
from server.jobs.job_kinds import NUMERICAL, JobError, StageRun
from server.jobs.job_store import Job, Result, found_by
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.processes.children import ChildResult
from server.recordings.recording_store import Recordings


@dataclass(frozen=True)
class StageProgram:
    """Stages in order, and the command that runs one: ``[*command, REQUEST.json, STAGE]``.

    By default it is ``python -P -m fitting.pipeline.stage_program --stay``, which never runs in the process that serves
    HTTP, and stays for the stages that follow.
    """

    stages: tuple[str, ...]
    command: tuple[str, ...]


@dataclass(frozen=True)
class StageRequest:
    """The request that every stage of one identification gets: files by their paths, recordings with their roles.

    The report's page is written in every language.
    """

    machine: Path
    recordings: tuple[tuple[str, Path], ...]
    options: dict[str, Any]
    output: Path

    def write(self) -> Path:
        """Write it to ``request.json`` in the output directory; returns its path."""
        content = {
            "machine": str(self.machine),
            "recordings": [[role, str(path)] for role, path in self.recordings],
            "options": self.options,
            "output": str(self.output),
            "languages": get_args(ReportLanguage),
        }
        path = self.output / "request.json"
        write_whole(path, json.dumps(content, indent=1).encode())
        return path


def words(stage: str) -> str:
    """Return what a person reads while ``stage`` runs."""
    text = (WORDS | VALVE_WORDS).get(stage, stage.replace("_", " "))
    return text[:1].upper() + text[1:]


def fitting_program(stages: tuple[str, ...] = STAGES) -> StageProgram:
    """List stages of :mod:`fitting`, which is loaded here only for their names."""
    return StageProgram(stages, (sys.executable, "-P", "-m", "fitting.pipeline.stage_program", "--stay"))


class FitKind:
    """Fits recordings.

    Parameters
    ----------
    program : gives the stages and the command that runs one; called when the first job needs it

    Attributes
    ----------
    fits : where they are stored; their files are in the folder that is called like the table
    report : name of the file that the last stage leaves
    """

    name: ClassVar[str]
    queue = NUMERICAL
    fits: ClassVar[type[Fits[Any]]]
    report: ClassVar[str]

    def __init__(
        self,
        database: Database,
        files: DataDirectory,
        program: Callable[[], StageProgram],
    ) -> None:
        self._files = files
        self._make_program = program
        self._fits = self.fits(database)
        self._recordings = Recordings(database)

    @property
    def stages(self) -> tuple[str, ...]:
        """Its stages, in order."""
        return self._program.stages

    @cached_property
    def _program(self) -> StageProgram:
        return self._make_program()

    def words(self, stage: str) -> str:
        """Return what a person reads while ``stage`` runs."""
        return words(stage)

    def directory(self, job: Job) -> Path:
        """Locate the stages' places."""
        return Path(self._files.root, self.fits.of.table.name, job.subject)

    def inputs(self, job: Job) -> tuple[Path, ...]:
        """List the machine file, then the recordings."""
        return self._paths(self._fits.get(job.subject))

    def _paths(self, fit: Fit) -> tuple[Path, ...]:
        rows = [self._recordings.get(id) for id, _ in fit.recordings]
        machine = self._files.machine_file(fit.machine, fit.machine_version)
        return (machine, *(self._files.recording(row.id, row.format) for row in rows))

    def run(self, run: StageRun) -> ChildResult:
        """Run a stage, in the process of the one before if it exists; those before it again if their files are gone."""
        fit = self._fits.get(run.job.subject)
        machine, *recordings = map(run.here, self._paths(fit))
        roles = [role for _, role in fit.recordings]
        request = StageRequest(machine, tuple(zip(roles, recordings, strict=True)), fit.options, run.place).write()
        stages = (run.stage,) if run.whole else self.stages[: self.stages.index(run.stage) + 1]
        for stage in stages:
            result = run.child(self._program.command, [str(request), stage], run.place / f"{stage}.log")
            if result.outcome != "done":
                break
        return result

    def result(self, job: Job, place: Path) -> Result:
        """Return the report's content."""
        try:
            report = json.loads((place / self.report).read_bytes())
            return found_by(self.fits.of, job.subject, **self.outcome(report))
        except (OSError, ValueError, KeyError, TypeError):
            raise JobError("server.last_stage_left_no") from None

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Pass: nobody waits for it here."""

    def outcome(self, report: Mapping[str, Any]) -> dict[str, Any]:
        """Return what is stored of a report, by columns."""
        raise NotImplementedError


class IdentificationKind(FitKind):
    """Both stages and the loop."""

    name, fits, report = "identification", Identifications, "report.json"

    def outcome(self, report: Mapping[str, Any]) -> dict[str, Any]:
        """Return its verdict, and the errors of all joints together."""
        return {"verdict": verdict_of(report), "overall": report["overall"]}
