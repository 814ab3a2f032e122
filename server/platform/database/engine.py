"""Connections, transactions, revision counters and pages of the store."""

from __future__ import annotations

import secrets
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Generic, TypeVar

import sqlalchemy as sa

from daq.messages import Sentence
from server.platform.database.database_copies import copy_database, postgresql_url
from server.platform.database.migrations import migrate
from server.platform.database.patience import away
from server.platform.database.schema import SCHEMA_VERSION, metadata, revisions, store_identity, store_version
from server.platform.database.site_marker import SiteMarker
from server.platform.errors import StartError

Clock = Callable[[], datetime]
#: Number of the advisory lock that writers take on PostgreSQL ("hilfit" in bytes).
_WRITERS = 0x68696C666974
#: And of the one that the server holds while it runs.
_SERVER = _WRITERS + 1
#: s: longest that PostgreSQL waits within a transaction for a process that was stopped there, or whose host was.
FROZEN_S = 10
#: s that a server waits for the session of the one before it, which the database may end later than the process.
LEAVING_S = 3.0
#: What a database says that takes no writes for a while: SQLite's primary result codes READONLY, IOERR, FULL and
#: CANTOPEN, and PostgreSQL's read_only_sql_transaction and, by their class, insufficient resources.
_SQLITE_REFUSES = (8, 10, 13, 14)
_READ_ONLY, _INSUFFICIENT = "25006", "53"
#: What PostgreSQL says to whom it never lets in, and what to do; the server's own words, which it says in English too.
_REFUSALS: Mapping[str, str] = {
    "password authentication failed": "server.store_refuses_password",
    "no password supplied": "server.store_lacks_password",
    "pg_hba.conf": "server.store_refuses_host",
    "does not exist": "server.store_none",
}
Item = TypeVar("Item")


@sa.event.listens_for(sa.Engine, "handle_error")
def _refusal_is_absence(context: sa.engine.ExceptionContext) -> None:
    """Take a full disk or a read-only database for one that is away, in the workflow engine's connections too.

    Both wait for one that is away. Whatever else a write was refused for, they take for the end of the job.

    The transaction is rolled back here: SQLite keeps the lock of a closed connection until the last of its statements
    is gone, and an error that somebody holds has them in its traceback.
    """
    error = context.original_exception
    code, state = getattr(error, "sqlite_errorcode", None), getattr(error, "sqlstate", None) or ""
    if (code is not None and code & 0xFF in _SQLITE_REFUSES) or state == _READ_ONLY or state.startswith(_INSUFFICIENT):
        driver = None if context.connection is None else context.connection.connection.dbapi_connection
        if driver is not None:
            with suppress(Exception):  # it is closed in any case
                driver.rollback()
        context.is_disconnect = True  # this connection is made anew, and the others are none the worse
        context.invalidate_pool_on_disconnect = False
    elif context.connection is None and code is None and not state:
        context.is_disconnect = True  # no connection could be made, for want of an address for the name, say


def utc_now() -> datetime:
    """Read the clock of a running service; it all reads ``time.time``, the workflow engine too."""
    return datetime.fromtimestamp(time.time(), UTC)


def as_stored(moment: datetime) -> str:
    """Write a moment as the store does: ISO 8601, UTC, milliseconds."""
    return moment.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def later(moment: str, by: timedelta) -> str:
    """Return a time of the store, so much later."""
    return as_stored(datetime.fromisoformat(moment) + by)


@dataclass(frozen=True)
class Page(Generic[Item]):
    """Some items of a longer list, and the cursor of the next page (None at the end)."""

    items: tuple[Item, ...]
    next: int | None


class Database:
    """The store: a SQLite file, or a PostgreSQL database that several hosts share.

    One writer at a time on either. SQLite: writers take the lock when they begin (BEGIN IMMEDIATE); a transaction
    that starts reading and then writes would fail at once with "database is locked" instead of waiting. Rollback
    journal and ``synchronous=FULL``: the write-ahead log of the SQLite that Debian 12 ships has a corruption bug with
    several processes. PostgreSQL: writers take one advisory lock, so what is checked in a transaction still holds
    when it is written, as on SQLite; transactions are a few rows long. A process that is stopped in one would hold up
    all the others: after ``FROZEN_S`` PostgreSQL ends its connection, and what it had not committed never happened.

    Parameters
    ----------
    place : the SQLite file, or the URL of a PostgreSQL database
    tables : all that there are (:func:`server.platform.resource.tables_of`)
    changed : called after every committed write
    backups : directory that gets a copy of the store before it is migrated; by default ``backups`` beside the file
    pause : waits a while for a PostgreSQL that cannot be reached yet, given why; None: that is refused at once
    may_migrate : whether an older store may be changed; else it is waited for, or refused
    site : marker of the site whose store this is; None: whoever opens it does not care

    Attributes
    ----------
    damage : what :meth:`look_for_damage` found; None: nothing
    """

    def __init__(
        self,
        place: Path | str,
        tables: Sequence[sa.Table],
        *,
        clock: Clock = utc_now,
        changed: Callable[[], None],
        backups: Path | None = None,
        pause: Callable[[str], object] | None = None,
        may_migrate: bool = True,
        site: SiteMarker | None = None,
    ) -> None:
        self.site = site
        self.damage: str | None = None
        self.url = f"sqlite:///{place}" if isinstance(place, Path) else _not_frozen(postgresql_url(place))
        self.is_sqlite = isinstance(place, Path)
        self.name = str(place) if isinstance(place, Path) else sa.make_url(place).render_as_string(hide_password=True)
        self._tables = tuple(tables)
        self._clock = clock
        self._changed = changed
        self._lock = threading.Lock()
        self._own: Mapping[str, int] = {}
        self._alone: sa.Connection | None = None
        self._closed = False
        # PostgreSQL may be restarted below us: a connection that it ended is noticed before it is used.
        self._engine = sa.create_engine(self.url, pool_pre_ping=not self.is_sqlite)
        if self.is_sqlite:
            sa.event.listen(self._engine, "connect", _prepare)
            sa.event.listen(self._engine, "begin", _begin)
        else:
            sa.event.listen(self._engine, "begin", _begin_postgresql)
        if backups is None:
            backups = place.parent / "backups" if isinstance(place, Path) else Path("backups")
        try:
            while (why := self._create(backups, may_migrate)) is not None:
                if pause is None:
                    raise StartError(why)
                pause(why)
        except BaseException:
            self.close()
            raise

    def _create(self, backups: Path, may_migrate: bool) -> Sentence | None:
        """Make what is missing in the store; why that has to wait, None if it is done."""
        try:
            found = self._found()
            if not may_migrate and found != SCHEMA_VERSION and (found or 0) < SCHEMA_VERSION:
                return Sentence("server.store_of_earlier_version", store=self.name)
            if found is None and self.site is not None:
                self.site.refuse_emptied(self.name)
            if found is not None and found < SCHEMA_VERSION:
                copy_database(self.url, backups, f"before-version-{SCHEMA_VERSION}-{found}")
            with self._connected(hilfit_write=True) as connection, connection.begin():
                found = _version(connection)  # another process may have been quicker
                if found is not None and found < SCHEMA_VERSION:
                    migrate(connection, found, SCHEMA_VERSION)
                    found = SCHEMA_VERSION
                if found is None or found == SCHEMA_VERSION:
                    metadata.create_all(connection, tables=self._tables)
                if found is None:
                    connection.execute(store_version.insert().values(version=SCHEMA_VERSION))
                    found = SCHEMA_VERSION
                identity = _identity(connection) if found == SCHEMA_VERSION else None
        except sa.exc.DatabaseError as error:
            reason = " ".join(str(error.orig).split())
            if not self.is_sqlite and away(error):
                refusal = next((code for words, code in _REFUSALS.items() if words in reason), None)
                if refusal is None:
                    return Sentence("server.store_not_reached", store=self.name, reason=reason)
                raise StartError(refusal, store=self.name, reason=reason) from None
            raise StartError("server.store_not_opened", store=self.name, reason=reason) from None
        if found != SCHEMA_VERSION:
            raise StartError("server.store_other_version", store=self.name, found=found, version=SCHEMA_VERSION)
        if self.site is not None and identity is not None:
            self.site.claim(identity, self.name)
        return None

    def _found(self) -> int | None:
        with self.read() as connection:
            return _version(connection)

    @contextmanager
    def _connected(self, **options: Any) -> Iterator[sa.Connection]:
        """Take a connection of the pool; close it afterwards if the store was closed meanwhile."""
        try:
            with self._engine.connect().execution_options(**options) as connection:
                yield connection
        finally:
            # Returned first, then asked: either this finds the store closed, or :meth:`close` finds the connection.
            if self._closed:
                self._engine.pool.dispose()

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """Open a transaction that only reads."""
        with self._connected() as connection, connection.begin():
            yield connection

    @contextmanager
    def write(self, *resources: str) -> Iterator[sa.Connection]:
        """Open a transaction that writes; count a revision of each of ``resources``, wake the waiters."""
        with self._connected(hilfit_write=True) as connection, connection.begin():
            yield connection
            counted = {resource: _count(connection, resource) for resource in resources}
        with self._lock:  # after the commit: whoever sees the number finds what was written
            newer = {name: max(number, self._own.get(name, 0)) for name, number in counted.items()}
            self._own = {**self._own, **newer}
        self._changed()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Hold the database for this server; the lock of a SQLite file's directory does that already.

        Waits up to ``LEAVING_S`` for another to leave: the session of a server that was killed ends a little later.

        Raises
        ------
        StartError
            If another server has it.
        """
        if self.is_sqlite:
            yield
            return
        with self._connected(isolation_level="AUTOCOMMIT") as connection:
            if not _take(connection):
                connection.invalidate()
                self.close()
                raise StartError("server.store_in_use", store=self.name)
            self._alone = connection
            try:
                yield
            finally:
                self._alone = None
                connection.invalidate()  # the lock is the session's: it goes with that

    def still_alone(self) -> bool:
        """Test whether :meth:`alone` still holds; its lock goes with the connection, and is taken again if free.

        Raises what the driver raises while the database is away.
        """
        if self._alone is None:
            return True
        try:
            self._alone.execute(sa.text("SELECT 1"))
            return True
        except sa.exc.DBAPIError:
            self._alone.invalidate()
            self._alone.rollback()
        return _take(self._alone)

    def now(self) -> str:
        """Return the time as the store writes it: UTC, milliseconds."""
        return as_stored(self._clock())

    def revisions(self) -> dict[str, int]:
        """Return per resource how often it changed since the store was made."""
        with self.read() as connection:
            rows = connection.execute(sa.select(revisions)).all()
        return {row.resource: row.number for row in rows}

    def own_revisions(self) -> Mapping[str, int]:
        """Return each written resource's revision after this process' last write of it; no read."""
        return self._own

    def check(self) -> None:
        """Read one row; raises what the driver raises when the database is gone."""
        with self.read() as connection:
            connection.execute(sa.select(store_version)).one()

    def look_for_damage(self) -> None:
        """Look through all pages of a SQLite file; PostgreSQL sees to its own. What is wrong is in ``damage``."""
        if not self.is_sqlite:
            return
        try:
            with self.read() as connection:
                found = str(connection.exec_driver_sql("PRAGMA quick_check(1)").scalar())
        except sa.exc.DatabaseError as error:
            found = str(error.orig)
        self.damage = None if found == "ok" else " ".join(found.split())

    def close(self) -> None:
        """Close all connections; one that somebody still uses is closed as soon as it is returned.

        The pool is the engine's: a new one, as ``Engine.dispose`` makes, would leave what is returned to the old one
        open until it is collected.
        """
        self._closed = True
        self._engine.pool.dispose()


def _take(connection: sa.Connection) -> bool:
    """Take the servers' lock if it can be had within ``LEAVING_S``."""
    end = time.monotonic() + LEAVING_S
    while not connection.execute(sa.text(f"SELECT pg_try_advisory_lock({_SERVER})")).scalar():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def _count(connection: sa.Connection, resource: str) -> int:
    """Count a revision; the new number."""
    column = revisions.c.number
    count = sa.update(revisions).where(revisions.c.resource == resource).values(number=column + 1)
    number = connection.execute(count.returning(column)).scalar()
    if number is None:
        connection.execute(revisions.insert().values(resource=resource, number=1))
        return 1
    return int(number)


def page(
    connection: sa.Connection, query: sa.Select[Any], number: sa.ColumnElement[int], limit: int, after: int
) -> tuple[Sequence[sa.Row[Any]], int | None]:
    """Return newest first; ``after`` is the cursor of a page before (0: from the start)."""
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


def _begin_postgresql(connection: sa.Connection) -> None:
    if connection.get_execution_options().get("hilfit_write", False):
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_WRITERS})")


def _not_frozen(url: str) -> str:
    """Return a URL whose sessions, the engine's too, end when their client is stopped in a transaction."""
    address = sa.make_url(url)
    given = address.query.get("options", "")
    options = [*([given] if isinstance(given, str) else given), f"-c idle_in_transaction_session_timeout={FROZEN_S}s"]
    return address.update_query_dict({"options": " ".join(options).strip()}).render_as_string(hide_password=False)


def _identity(connection: sa.Connection) -> str:
    """Return the id of the store, which it gets when it is first asked for."""
    found = connection.execute(sa.select(store_identity.c.id)).scalar()
    if found is None:
        found = secrets.token_hex(16)
        connection.execute(store_identity.insert().values(id=found))
    return str(found)


def _version(connection: sa.Connection) -> int | None:
    """Read the version of the store; None if there is nothing yet."""
    if not sa.inspect(connection).has_table(store_version.name):
        return None
    return connection.execute(sa.select(store_version.c.version)).scalar()
