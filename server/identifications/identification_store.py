"""Identifications: which recordings in which roles, with which options and which outcome."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Unpack

import sqlalchemy as sa

from server.identifications.identification_tables import identification_recordings, identifications
from server.jobs.job_store import Result
from server.platform.database.engine import Database, Page
from server.platform.database.idempotency import IdempotencyKey, earlier, remember
from server.platform.database.lists import Narrowing, rows_of
from server.platform.errors import ConflictError, NotFoundError
from server.recordings.recording_tables import recordings


@dataclass(frozen=True)
class Identification:
    """One identification; ``recordings`` are (id, role), ``verdict`` and ``overall`` the report's."""

    id: str
    job: str
    machine: str
    machine_version: int
    label: str
    recordings: tuple[tuple[str, str], ...]
    options: dict[str, Any]
    created: str
    verdict: str | None = None
    overall: dict[str, Any] | None = None


class Identifications:
    """Repository of identifications."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(
        self,
        new: Identification,
        insert_job: Callable[[sa.Connection], None],
        key: IdempotencyKey | None = None,
    ) -> Identification:
        """Store an identification and its job in one transaction.

        Parameters
        ----------
        insert_job : makes the job's row in the transaction that it is given
        key : if the same key came before with the same request, the identification made then is returned and
            nothing is stored

        Raises
        ------
        ConflictError
            If the key came before with another request, or a recording was deleted meanwhile.
        """
        with self._database.write("identifications", "jobs") as connection:
            made = earlier(connection, key)
            if made is not None:
                return _get(connection, made)
            insert_job(connection)
            columns = {name: value for name, value in new.__dict__.items() if name != "recordings"}
            connection.execute(identifications.insert().values(**columns))
            for position, (recording, role) in enumerate(new.recordings):
                state = connection.execute(sa.select(recordings.c.state).where(recordings.c.id == recording)).scalar()
                if state != "sealed":
                    raise ConflictError(f"recording '{recording}' is no longer there; choose another one")
                connection.execute(
                    identification_recordings.insert().values(
                        identification=new.id, position=position, recording=recording, role=role
                    )
                )
            remember(connection, key, new.id, self._database.now())
        return new

    def get(self, id: str) -> Identification:
        """The identification; NotFoundError if there is none."""
        with self._database.read() as connection:
            return _get(connection, id)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Identification]:
        """Newest first, narrowed to what is given."""
        with self._database.read() as connection:
            rows, cursor = rows_of(connection, identifications, limit, after, **narrowed)
            return Page(tuple(_get(connection, row.id) for row in rows), cursor)

    @staticmethod
    def result(id: str, verdict: str, overall: dict[str, Any]) -> Result:
        """What the report says, to be stored with the end of the job."""
        change = identifications.update().where(identifications.c.id == id).values(verdict=verdict, overall=overall)
        return Result("identifications", change)


def _get(connection: sa.Connection, id: str) -> Identification:
    row = connection.execute(sa.select(identifications).where(identifications.c.id == id)).first()
    if row is None:
        raise NotFoundError(f"there is no identification '{id}'", identification=id)
    used = connection.execute(
        sa.select(identification_recordings)
        .where(identification_recordings.c.identification == id)
        .order_by(identification_recordings.c.position)
    ).all()
    values = {key: value for key, value in row._mapping.items() if key != "number"}
    return Identification(**values, recordings=tuple((entry.recording, entry.role) for entry in used))
