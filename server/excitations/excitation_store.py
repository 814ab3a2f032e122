"""Excitations: motions that were designed for a machine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Unpack

import sqlalchemy as sa

from server.excitations.excitation_tables import excitations
from server.jobs.job_store import Jobs, Result
from server.platform.database.engine import Database, Page
from server.platform.database.idempotency import IdempotencyKey, earlier, remember
from server.platform.database.lists import Narrowing, listed
from server.platform.errors import NotFoundError


@dataclass(frozen=True)
class Excitation:
    """One excitation; ``result`` is what its design found, once it is done."""

    id: str
    job: str
    machine: str
    machine_version: int
    label: str
    options: dict[str, Any]
    created: str
    result: dict[str, Any] | None = None


class Excitations:
    """Repository of excitations."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._jobs = Jobs(database)

    def add(self, new: Excitation, stages: tuple[str, ...], key: IdempotencyKey | None = None) -> Excitation:
        """Store an excitation and its job in one transaction; the one made before if the key came before.

        Raises
        ------
        ConflictError
            If the key came before with another request.
        """
        with self._database.write("excitations", "jobs") as connection:
            made = earlier(connection, key)
            if made is not None:
                return _get(connection, made)
            self._jobs.insert(connection, id=new.job, kind="excitation", label=new.label, subject=new.id, stages=stages)
            connection.execute(excitations.insert().values(**new.__dict__))
            remember(connection, key, new.id, self._database.now())
        return new

    def get(self, id: str) -> Excitation:
        """The excitation; NotFoundError if there is none."""
        with self._database.read() as connection:
            return _get(connection, id)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Excitation]:
        """Newest first, narrowed to what is given."""
        return listed(self._database, excitations, _excitation, limit, after, **narrowed)

    @staticmethod
    def result(id: str, found: dict[str, Any]) -> Result:
        """What the design found, to be stored with the end of the job."""
        return Result("excitations", excitations.update().where(excitations.c.id == id).values(result=found))


def _get(connection: sa.Connection, id: str) -> Excitation:
    row = connection.execute(sa.select(excitations).where(excitations.c.id == id)).first()
    if row is None:
        raise NotFoundError(f"there is no excitation '{id}'", excitation=id)
    return _excitation(row)


def _excitation(row: sa.Row[Any]) -> Excitation:
    return Excitation(**{key: value for key, value in row._mapping.items() if key != "number"})
