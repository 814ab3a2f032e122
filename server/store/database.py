"""Connections, transactions, revision counters and pages of the store."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Generic, TypeVar

import sqlalchemy as sa

from server.errors import StartError
from server.store import tables

Clock = Callable[[], datetime]
Item = TypeVar("Item")


def utc_now() -> datetime:
    """The clock of a running service."""
    return datetime.now(UTC)


@dataclass(frozen=True)
class Page(Generic[Item]):
    """Some items of a longer list, and the cursor of the next page (None at the end)."""

    items: tuple[Item, ...]
    next: int | None


class Database:
    """The store's SQLite file.

    Writers take the lock when they begin (BEGIN IMMEDIATE): a transaction that starts reading and then writes
    would fail at once with "database is locked" instead of waiting. Rollback journal and
    ``synchronous=FULL``: the write-ahead log of the SQLite that Debian 12 ships has a corruption bug with
    several processes.

    Parameters
    ----------
    changed : called after every committed write
    """

    def __init__(self, path: Path, *, clock: Clock = utc_now, changed: Callable[[], None]) -> None:
        self.url = f"sqlite:///{path}"
        self._clock = clock
        self._changed = changed
        self._engine = sa.create_engine(self.url)
        sa.event.listen(self._engine, "connect", _prepare)
        sa.event.listen(self._engine, "begin", _begin)
        self._create(path)

    def _create(self, path: Path) -> None:
        try:
            with (
                self._engine.connect().execution_options(hilfit_write=True) as connection,
                connection.begin(),
            ):
                tables.metadata.create_all(connection)
                found = connection.execute(sa.select(tables.store_version.c.version)).scalar()
                if found is None:
                    connection.execute(tables.store_version.insert().values(version=tables.SCHEMA_VERSION))
                    found = tables.SCHEMA_VERSION
        except sa.exc.DatabaseError as error:
            raise StartError(
                f"{path}: cannot be opened as the store ({error.orig}); move it away or restore it"
            ) from None
        if found != tables.SCHEMA_VERSION:
            raise StartError(
                f"{path}: is a store of version {found}, this hilfit reads version {tables.SCHEMA_VERSION}; "
                "use the hilfit that wrote it or another --data-dir"
            )

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """A transaction that only reads."""
        with self._engine.connect() as connection, connection.begin():
            yield connection

    @contextmanager
    def write(self, *resources: str) -> Iterator[sa.Connection]:
        """A transaction that writes; counts a revision of each of ``resources``, then wakes the waiters."""
        with self._engine.connect().execution_options(hilfit_write=True) as connection, connection.begin():
            yield connection
            for resource in resources:
                count = sa.update(tables.revisions).where(tables.revisions.c.resource == resource)
                if connection.execute(count.values(number=tables.revisions.c.number + 1)).rowcount == 0:
                    connection.execute(tables.revisions.insert().values(resource=resource, number=1))
        self._changed()

    def now(self) -> str:
        """The time as the store writes it: UTC, milliseconds."""
        return self._clock().astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")

    def revisions(self) -> dict[str, int]:
        """Per resource how often it changed since the store was made."""
        with self.read() as connection:
            rows = connection.execute(sa.select(tables.revisions)).all()
        return {row.resource: row.number for row in rows}

    def check(self) -> None:
        """Read one row; raises what the driver raises when the database is gone."""
        with self.read() as connection:
            connection.execute(sa.select(tables.store_version)).one()

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()


def page(
    connection: sa.Connection, query: sa.Select[Any], number: sa.Column[int], limit: int, after: int
) -> tuple[Sequence[sa.Row[Any]], int | None]:
    """Newest first; ``after`` is the cursor of a page before (0: from the start)."""
    if after:
        query = query.where(number < after)
    rows = connection.execute(query.order_by(number.desc()).limit(limit + 1)).all()
    more = len(rows) > limit
    return rows[:limit], rows[limit - 1].number if more else None


def _prepare(connection: sqlite3.Connection, _record: object) -> None:
    connection.isolation_level = None  # the begin event below emits BEGIN, the driver must not
    connection.execute("PRAGMA journal_mode=DELETE")
    connection.execute("PRAGMA synchronous=FULL")
    connection.execute("PRAGMA foreign_keys=ON")
    connection.execute("PRAGMA busy_timeout=30000")


def _begin(connection: sa.Connection) -> None:
    write = connection.get_execution_options().get("hilfit_write", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if write else "BEGIN")
