"""Kinds of jobs, as the runner knows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from daq.errors import HilfitError
from server.jobs.job_store import Job, Result
from server.platform.processes.children import ChildResult

#: Queue of numerical work: one job at a time per process that takes from it, on whatever host.
NUMERICAL = "identifications"
#: Queue of jobs that need the machines themselves: only the server takes from it, many at a time: they mostly wait, for
#: a recording (of which there are ``recordings_at_once``), or for a worker that fits.
AT_MACHINES = "recalibrations"


class JobError(HilfitError):
    """The job fails; the text is one line that says what to do."""


@dataclass(frozen=True)
class StageRun:
    """Context in which a kind runs one stage of one job.

    Attributes
    ----------
    progress : takes the fraction of the stage (0 to 1) and what is being done
    should_stop : whether somebody cancelled the job, or the service stops
    child : runs a program with arguments and a log file; one that stays is there for the job's next stage
        (:class:`server.platform.processes.children.Child`)
    place : directory that nobody else writes to, with all that the stages before left (:mod:`server.jobs.job_places`)
    whole : whether what they left is there; False also for the first stage
    inputs : where the kind's inputs are on this host, by their keys
    key : of a path of the data directory
    """

    job: Job
    stage: str
    progress: Callable[[float, str], None]
    should_stop: Callable[[], bool]
    child: Callable[[Sequence[str], Sequence[str], Path], ChildResult]
    place: Path
    whole: bool
    inputs: Mapping[str, Path] = field(default_factory=dict)
    key: Callable[[Path], str] = str

    def here(self, path: Path) -> Path:
        """Locate an input on this host, given where it is in the data directory."""
        return self.inputs.get(self.key(path), path)


class JobKind(Protocol):
    """One kind of job."""

    @property
    def name(self) -> str:
        """Name in a job's ``kind``."""

    @property
    def queue(self) -> str:
        """Queue of its jobs."""

    def words(self, stage: str) -> str:
        """Return what a person reads while a stage runs."""

    def directory(self, job: Job) -> Path:
        """Locate a job's stages' places."""

    def inputs(self, job: Job) -> tuple[Path, ...]:
        """List files of the data directory that its stages read, and :meth:`StageRun.here` finds on their host."""

    def run(self, run: StageRun) -> ChildResult:
        """Run a stage; one that broke off is run again, so it must not do twice what may be done once."""

    def result(self, job: Job, place: Path) -> Result | None:
        """Return what the last stage left to be stored with the job's end, or None. JobError if it is not there."""

    def ended(self, job: Job, state: str, error: str | None) -> None:
        """Prepare for the job's end; may be called twice."""
