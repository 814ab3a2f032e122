"""To which machine something belongs, and refusing what belongs to a machine that a principal does not see."""

from __future__ import annotations

from collections.abc import Iterable

import sqlalchemy as sa

from server.platform.authorization.named_things import Thing
from server.platform.authorization.principals import Principal
from server.platform.database.engine import Database
from server.platform.errors import NotFoundError, none_of
from server.platform.resource import Resource


class Ownership:
    """The machine of each thing, as the resources declare it."""

    def __init__(self, database: Database, resources: Iterable[Resource]) -> None:
        self._database = database
        #: Tables with one machine to a row, by the collection in their path.
        self._tables = {name: table for resource in resources for name, table in resource.of_a_machine.items()}
        self._made_by_jobs = tuple(table for table in self._tables.values() if "job" in table.c)
        #: Collections whose things belong to machines.
        self.collections = frozenset((*self._tables, "machines", "jobs"))

    def refuse_foreign(self, principal: Principal, things: Iterable[Thing]) -> None:
        """Raise NotFoundError if one of ``things`` is of a machine that does not exist for ``principal``.

        The text is the same whether it exists or not.
        """
        with self._database.read() as connection:
            for collection, id in sorted(things):
                if not principal.may_see(self._machine_of(connection, collection, id)):
                    raise NotFoundError(
                        "server.for_principal", what=none_of(collection.removesuffix("s"), id), principal=principal.name
                    )

    def machines_of_jobs(self, jobs: Iterable[str]) -> dict[str, str]:
        """Return the machine of each job."""
        wanted = list(jobs)
        with self._database.read() as connection:
            return {
                row.job: row.machine
                for table in self._made_by_jobs
                for row in connection.execute(sa.select(table.c.job, table.c.machine).where(table.c.job.in_(wanted)))
            }

    def _machine_of(self, connection: sa.Connection, collection: str, id: str) -> str | None:
        if collection == "machines":
            return id
        if collection == "jobs":
            for table in self._made_by_jobs:
                machine = connection.execute(sa.select(table.c.machine).where(table.c.job == id)).scalar()
                if machine is not None:
                    return str(machine)
            return None
        table = self._tables[collection]
        machine = connection.execute(sa.select(table.c.machine).where(table.c.id == id)).scalar()
        return None if machine is None else str(machine)
