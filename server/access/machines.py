"""To which machine something belongs, and refusing what belongs to a machine that a principal does not see."""

from __future__ import annotations

from collections.abc import Iterable

import sqlalchemy as sa

from server.access.principals import Principal
from server.errors import NotFoundError
from server.store import Database, tables

#: Resources of which each belongs to one machine, by the collection in their path.
_OF_A_MACHINE: dict[str, sa.Table] = {
    "recordings": tables.recordings,
    "identifications": tables.identifications,
    "calibrations": tables.calibrations,
    "excitations": tables.excitations,
    "schedules": tables.schedules,
    "recalibrations": tables.recalibrations,
    "alarms": tables.alarms,
}
#: Collections whose things belong to machines.
COLLECTIONS = frozenset((*_OF_A_MACHINE, "machines", "jobs"))
#: What jobs make.
_MADE_BY_JOBS = (tables.identifications, tables.excitations, tables.recalibrations)
Thing = tuple[str, str]


def refuse_foreign(database: Database, principal: Principal, things: Iterable[Thing]) -> None:
    """Raise NotFoundError if one of ``things`` is of a machine that does not exist for ``principal``.

    The text is the same whether it exists or not.
    """
    with database.read() as connection:
        for collection, id in sorted(things):
            if not principal.may_see(_machine_of(connection, collection, id)):
                raise NotFoundError(f"there is no {collection.removesuffix('s')} '{id}' for '{principal.name}'")


def machines_of_jobs(database: Database, jobs: Iterable[str]) -> dict[str, str]:
    """The machine of each job."""
    wanted = list(jobs)
    with database.read() as connection:
        return {
            row.job: row.machine
            for table in _MADE_BY_JOBS
            for row in connection.execute(sa.select(table.c.job, table.c.machine).where(table.c.job.in_(wanted)))
        }


def _machine_of(connection: sa.Connection, collection: str, id: str) -> str | None:
    if collection == "machines":
        return id
    if collection == "jobs":
        for table in _MADE_BY_JOBS:
            machine = connection.execute(sa.select(table.c.machine).where(table.c.job == id)).scalar()
            if machine is not None:
                return str(machine)
        return None
    table = _OF_A_MACHINE[collection]
    machine = connection.execute(sa.select(table.c.machine).where(table.c.id == id)).scalar()
    return None if machine is None else str(machine)
