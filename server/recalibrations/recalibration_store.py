"""Recalibrations: what a slot of a schedule does, and how far it came."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import sqlalchemy as sa
from pydantic import Field

from server.jobs.job_store import FINAL, Jobs, JobState, MadeByJobs, jobs
from server.platform.database.engine import Database
from server.platform.database.stored import HIDDEN, Id, OfJob, OfMachine, Stored
from server.platform.errors import ConflictError

STAGES = ("record", "identify", "compare", "propose")


@dataclass(frozen=True)
class Plan:
    """Plan of a recalibration.

    Attributes
    ----------
    motion : record normal ``operation``, or the ``standard`` motion
    duration_s : of normal operation, in machine time
    excitations : the standard motion, once to fit and, if there are two, another to judge by
    deadline_s : how long it waits for the machine, or for the person who lets it follow the motion
    options : of the identification
    activate : ``if_better``: the new calibration is activated if it is better by every joint
    ordered_by : id and name of the person who ordered it by hand, in whose name it proposes
    """

    motion: Literal["operation", "standard"] = "operation"
    duration_s: float = 300.0
    excitations: tuple[str, ...] = ()
    deadline_s: float = 3600.0
    options: dict[str, Any] = field(default_factory=dict)
    activate: Literal["never", "if_better"] = "never"
    ordered_by: tuple[str, str] | None = None


class Recalibration(Stored, table="recalibrations", noun="recalibration"):
    """One recalibration; ``recordings`` are ids by role, ``asked`` since when recordings of a person count."""

    id: Id
    job: OfJob
    state: JobState = "queued"
    machine: OfMachine
    schedule: str | None  # it may be deleted later
    label: str
    created: str
    plan: Annotated[Plan, HIDDEN]
    asked: Annotated[str | None, HIDDEN] = None
    recordings: dict[str, str] = Field(default_factory=dict)
    identification: str | None = None
    comparison: dict[str, Any] | None = None
    calibration: str | None = None


recalibrations = Recalibration.table


class Recalibrations(MadeByJobs[Recalibration]):
    """Repository of recalibrations."""

    of = Recalibration

    def __init__(self, database: Database) -> None:
        super().__init__(database)
        self._jobs = Jobs(database)

    def order(self, connection: sa.Connection, new: Recalibration) -> None:
        """Store one with its job, in the transaction of whoever orders it.

        Raises
        ------
        ConflictError
            If one of that machine is not over.
        """
        running = self.unfinished(connection, new.machine)
        if running is not None:
            refusal = ConflictError("server.machine_being_recalibrated", machine=new.machine, running=running)
            raise refusal.about("being_recalibrated")
        self._jobs.insert(connection, id=new.job, kind="recalibration", label=new.label, subject=new.id, stages=STAGES)
        self.put(connection, new)

    @staticmethod
    def unfinished(connection: sa.Connection, machine: str) -> str | None:
        """Return the job that recalibrates a machine now, or waits for its turn."""
        query = (
            sa.select(jobs.c.id)
            .join(recalibrations, recalibrations.c.job == jobs.c.id)
            .where(recalibrations.c.machine == machine, jobs.c.state.not_in(FINAL))
        )
        return connection.execute(query).scalar()

    def note(self, id: str, **values: Any) -> None:
        """Store how far it came."""
        with self._database.write("recalibrations") as connection:
            self.update(connection, id, **values)
