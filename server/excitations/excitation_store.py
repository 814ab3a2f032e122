"""Excitations: motions that were designed for a machine."""

from __future__ import annotations

from typing import Annotated, Any

from server.jobs.job_store import JobState, MadeByJobs
from server.platform.database.stored import HIDDEN, Id, OfJob, OfMachine, Stored


class Excitation(Stored, table="excitations", noun="excitation"):
    """One excitation; ``result`` is what its design found, once it is done."""

    id: Id
    machine: OfMachine
    machine_version: int
    label: str
    job: OfJob
    state: JobState = "queued"
    options: dict[str, Any]
    created: str
    result: Annotated[dict[str, Any] | None, HIDDEN] = None


class Excitations(MadeByJobs[Excitation]):
    """Repository of excitations."""

    of = Excitation
