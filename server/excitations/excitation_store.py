"""Excitations: motions that were designed for a machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import sqlalchemy as sa

from server.jobs.job_store import JobState, Result, states_of
from server.platform.database.repository import Repository
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


class Excitations(Repository[Excitation]):
    """Repository of excitations."""

    of = Excitation

    def values(self, connection: sa.Connection, rows: Sequence[sa.Row[Any]]) -> tuple[Excitation, ...]:
        """What rows hold, with the states of their jobs."""
        states = states_of(connection, rows)
        return tuple(Excitation.read(row, state=states[row.job]) for row in rows)

    @staticmethod
    def result(id: str, found: dict[str, Any]) -> Result:
        """What the design found, to be stored with the end of the job."""
        table = Excitation.table
        return Result(table.name, table.update().where(table.c.id == id).values(result=found))
