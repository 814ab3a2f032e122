"""What is identified from recordings: which recordings in which roles, with which options and which outcome."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar, Unpack

import sqlalchemy as sa

from server.identifications.identification_tables import identification_recordings, identifications
from server.jobs.job_store import Result
from server.platform.database.engine import Database, Page
from server.platform.database.idempotency import IdempotencyKey, earlier, remember
from server.platform.database.lists import Narrowing, rows_of
from server.platform.errors import ConflictError, NotFoundError
from server.recordings.recording_tables import recordings


@dataclass(frozen=True)
class Fit:
    """One order; ``recordings`` are (id, role)."""

    id: str
    job: str
    machine: str
    machine_version: int
    label: str
    recordings: tuple[tuple[str, str], ...]
    options: dict[str, Any]
    created: str


Ordered = TypeVar("Ordered", bound=Fit)


class Fits(Generic[Ordered]):
    """Repository of one kind of fits.

    Attributes
    ----------
    one : what one is called, also in ``used``
    refusal : what is said where there is none
    made : its type
    table, used : of fits, and of their recordings
    """

    one: ClassVar[str]
    refusal: ClassVar[str]
    made: type[Ordered]
    table: ClassVar[sa.Table]
    used: ClassVar[sa.Table]

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(
        self,
        new: Ordered,
        insert_job: Callable[[sa.Connection], None],
        key: IdempotencyKey | None = None,
    ) -> Ordered:
        """Store a fit and its job in one transaction.

        Parameters
        ----------
        insert_job : makes the job's row in the transaction that it is given
        key : if the same key came before with the same request, the fit made then is returned and nothing is stored

        Raises
        ------
        ConflictError
            If the key came before with another request, or a recording was deleted meanwhile.
        """
        with self._database.write(self.table.name, "jobs") as connection:
            made = earlier(connection, key)
            if made is not None:
                return self._get(connection, made)
            insert_job(connection)
            columns = {name: value for name, value in new.__dict__.items() if name != "recordings"}
            connection.execute(self.table.insert().values(**columns))
            for position, (recording, role) in enumerate(new.recordings):
                state = connection.execute(sa.select(recordings.c.state).where(recordings.c.id == recording)).scalar()
                if state != "sealed":
                    raise ConflictError(f"recording '{recording}' is no longer there; choose another one")
                row = {self.one: new.id, "position": position, "recording": recording, "role": role}
                connection.execute(self.used.insert().values(**row))
            remember(connection, key, new.id, self._database.now())
        return new

    def get(self, id: str) -> Ordered:
        """The fit; NotFoundError if there is none."""
        with self._database.read() as connection:
            return self._get(connection, id)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Ordered]:
        """Newest first, narrowed to what is given."""
        with self._database.read() as connection:
            rows, cursor = rows_of(connection, self.table, limit, after, **narrowed)
            return Page(tuple(self._get(connection, row.id) for row in rows), cursor)

    @classmethod
    def result(cls, id: str, **found: Any) -> Result:
        """What the report says, to be stored with the end of the job."""
        return Result(cls.table.name, cls.table.update().where(cls.table.c.id == id).values(**found))

    def _get(self, connection: sa.Connection, id: str) -> Ordered:
        row = connection.execute(sa.select(self.table).where(self.table.c.id == id)).first()
        if row is None:
            raise NotFoundError(self.refusal.format(id), **{self.one: id})
        used = connection.execute(
            sa.select(self.used).where(self.used.c[self.one] == id).order_by(self.used.c.position)
        ).all()
        values = {key: value for key, value in row._mapping.items() if key != "number"}
        return self.made(**values, recordings=tuple((entry.recording, entry.role) for entry in used))


@dataclass(frozen=True)
class Identification(Fit):
    """One identification; ``verdict`` and ``overall`` are the report's."""

    verdict: str | None = None
    overall: dict[str, Any] | None = None


class Identifications(Fits[Identification]):
    """Repository of identifications."""

    one, made, table, used = "identification", Identification, identifications, identification_recordings
    refusal = "there is no identification '{}'"
