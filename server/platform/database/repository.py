"""Common base of repositories: read by id, list page by page, newest first, narrowed to what whoever asks may see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Generic, TypedDict, TypeVar, Unpack

import sqlalchemy as sa

from server.platform.database.engine import Database, Page, as_stored, page
from server.platform.database.stored import Stored
from server.platform.errors import NotFoundError, none_of
from server.platform.http.bodies import with_messages_of

Value = TypeVar("Value", bound=Stored)


@dataclass(frozen=True)
class Between:
    """Of a list: what was made from ``since`` on and before ``until``, and whose label has ``labelled`` in it."""

    since: datetime | None = None
    until: datetime | None = None
    labelled: str = ""

    def narrowed(
        self, query: sa.Select[Any], created: sa.ColumnElement[str], label: sa.ColumnElement[str]
    ) -> sa.Select[Any]:
        """Narrow the query; times are stored as text that sorts."""
        if self.since is not None:
            query = query.where(created >= as_stored(self.since))
        if self.until is not None:
            query = query.where(created < as_stored(self.until))
        return query.where(label.icontains(self.labelled, autoescape=True)) if self.labelled else query


ANY_TIME = Between()


class Narrowing(TypedDict, total=False):
    """Conditions that narrow a list; None narrows nothing.

    ``machines`` are those that whoever asks may see, the others but ``between`` what a row has in the column of that
    name.
    """

    machines: tuple[str, ...] | None
    between: Between
    machine: str | None
    role: str | None
    state: str | None
    kind: str | None
    webhook: str | None


class Repository(Generic[Value]):
    """Keeper of one table.

    Attributes
    ----------
    of : what a row of it is
    """

    of: type[Value]

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, id: str) -> Value:
        """Return the one with this id; NotFoundError if there is none."""
        with self._database.read() as connection:
            return self.found(connection, id)

    def found(self, connection: sa.Connection, id: str) -> Value:
        """Return the one with this id, in a transaction; NotFoundError if there is none."""
        rows = connection.execute(sa.select(self.of.table).where(self.of.table.c.id == id)).all()
        if not rows:
            raise NotFoundError(none_of(self.of.noun, id)).about(**{self.of.table.name.removesuffix("s"): id})
        return self.values(connection, rows)[0]

    def selected(self) -> sa.Select[Any]:
        """Select what is listed, each with its ``number``: the rows of the table."""
        return sa.select(self.of.table)

    def all(self, *where: sa.ColumnElement[bool], newest: int | None = None) -> tuple[Value, ...]:
        """List all of which something holds, oldest first; of the ``newest`` so many, newest first."""
        query = self.selected().where(*where)
        number = query.selected_columns["number"]
        query = query.order_by(number) if newest is None else query.order_by(number.desc()).limit(newest)
        with self._database.read() as connection:
            return self.values(connection, connection.execute(query).all())

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Value]:
        """List newest first, narrowed to what is given.

        What counts as time, label and machine of a row are the columns that its declaration names, else ``created``,
        ``label`` and ``machine``.
        """
        query, named, columns = self.selected(), self.of.table.info, dict[str, Any](narrowed)
        own = query.selected_columns
        between, seen = columns.pop("between", ANY_TIME), columns.pop("machines", None)
        query = between.narrowed(query, own[named.get("created", "created")], own[named.get("label", "label")])
        if seen is not None:
            query = query.where(own[named.get("machine", "machine")].in_(seen))
        query = query.where(*(own[name] == wanted for name, wanted in columns.items() if wanted is not None))
        with self._database.read() as connection:
            rows, cursor = page(connection, query, own["number"], limit, after)
            return Page(self.values(connection, rows), cursor)

    def values(self, connection: sa.Connection, rows: Sequence[sa.Row[Any]]) -> tuple[Value, ...]:
        """Return what rows hold; with what is kept in other tables, of a repository that has some."""
        return tuple(self.of.read(row) for row in rows)

    def put(self, connection: sa.Connection, new: Value) -> None:
        """Store a new one, in a transaction."""
        connection.execute(self.of.table.insert().values(**new.columns()))

    def keep(self, new: Value) -> None:
        """Store a new one, as a revision of what the table is called."""
        with self._database.write(self.of.table.name) as connection:
            self.put(connection, new)

    def update(self, connection: sa.Connection, id: str, **values: Any) -> None:
        """Store other values of some columns, in a transaction."""
        kept = with_messages_of(values, self.of.table.c.keys())
        connection.execute(self.of.table.update().where(self.of.table.c.id == id).values(**kept))
