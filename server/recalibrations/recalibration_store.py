"""Recalibrations: what a slot of a schedule does, and how far it came."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import sqlalchemy as sa

from server.jobs.job_store import FINAL, Jobs
from server.jobs.job_tables import jobs
from server.platform.database.engine import Database
from server.platform.errors import ConflictError, NotFoundError
from server.recalibrations.recalibration_tables import recalibrations

STAGES = ("record", "identify", "compare", "propose")


@dataclass(frozen=True)
class Plan:
    """What a recalibration does.

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

    @classmethod
    def of(cls, content: dict[str, Any]) -> Plan:
        """From the store."""
        by = content.get("ordered_by")
        tuples = {"excitations": tuple(content["excitations"]), "ordered_by": by and (by[0], by[1])}
        return cls(**{**content, **tuples})

    def content(self) -> dict[str, Any]:
        """For the store."""
        return {**self.__dict__, "excitations": list(self.excitations)}


@dataclass(frozen=True)
class Recalibration:
    """One recalibration; ``recordings`` are ids by role."""

    id: str
    job: str
    machine: str
    schedule: str | None
    label: str
    plan: Plan
    created: str
    asked: str | None = None
    recordings: dict[str, str] = field(default_factory=dict)
    identification: str | None = None
    comparison: dict[str, Any] | None = None
    calibration: str | None = None


class Recalibrations:
    """Repository of recalibrations."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._jobs = Jobs(database)

    def insert(self, connection: sa.Connection, new: Recalibration) -> None:
        """Store one with its job, in the transaction of whoever orders it.

        Raises
        ------
        ConflictError
            If one of that machine is not over.
        """
        running = self.unfinished(connection, new.machine)
        if running is not None:
            raise ConflictError(
                f"machine '{new.machine}' is being recalibrated by {running}; wait for it or cancel it",
                "being_recalibrated",
            )
        self._jobs.insert(connection, id=new.job, kind="recalibration", label=new.label, subject=new.id, stages=STAGES)
        connection.execute(recalibrations.insert().values(**{**new.__dict__, "plan": new.plan.content()}))

    @staticmethod
    def unfinished(connection: sa.Connection, machine: str) -> str | None:
        """The job that recalibrates a machine now, or waits for its turn."""
        query = (
            sa.select(jobs.c.id)
            .join(recalibrations, recalibrations.c.job == jobs.c.id)
            .where(recalibrations.c.machine == machine, jobs.c.state.not_in(FINAL))
        )
        return connection.execute(query).scalar()

    def get(self, id: str) -> Recalibration:
        """The recalibration; NotFoundError if there is none."""
        with self._database.read() as connection:
            row = connection.execute(sa.select(recalibrations).where(recalibrations.c.id == id)).first()
        if row is None:
            raise NotFoundError(f"there is no recalibration '{id}'", recalibration=id)
        values = {key: value for key, value in row._mapping.items() if key != "number"}
        return Recalibration(**{**values, "plan": Plan.of(values["plan"])})

    def note(self, id: str, **values: Any) -> None:
        """Store how far it came."""
        with self._database.write("recalibrations") as connection:
            connection.execute(recalibrations.update().where(recalibrations.c.id == id).values(**values))
