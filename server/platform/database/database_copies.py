"""Copies of the whole database, the workflow engine's tables included, taken while it is in use.

SQLite is copied by its own online backup, PostgreSQL by ``pg_dump`` (custom format), which has to be installed where
the service runs.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import sqlalchemy as sa

from daq.messages import Sentence
from daq.whole_files import replacing, sync_directory
from server.platform.database.schema import SCHEMA_VERSION
from server.platform.errors import StartError

#: Where Debian keeps PostgreSQL's programs.
_DEBIAN = Path("/usr/lib/postgresql")
TIMEOUT_S = 3600.0


def copy_database(url: str, directory: Path, stem: str) -> Path:
    """Write ``stem.sqlite`` or ``stem.pgdump`` into ``directory``, whole or not at all; its path.

    Raises
    ------
    StartError
        If it cannot be written; one line.
    """
    sqlite = url.startswith("sqlite")
    target = directory / f"{stem}.{'sqlite' if sqlite else 'pgdump'}"
    try:
        with replacing(target) as partial:
            if sqlite:
                _copy_sqlite(Path(url.removeprefix("sqlite:///")), partial)
            else:
                _run("pg_dump", url, "--format=custom", f"--file={partial}")
    except (OSError, sqlite3.Error) as error:
        raise StartError("server.copy_not_written", target=target, error=error) from None
    return target


@contextmanager
def connected(url: str) -> Iterator[sa.Connection]:
    """Connect to a database that nothing else here is connected to."""
    engine = sa.create_engine(url, poolclass=sa.NullPool)
    try:
        with engine.connect() as connection:
            yield connection
    finally:
        engine.dispose()


def check_restore(source: Path, url: str) -> None:
    """Look whether a copy can be put in the place of the database, before anything is changed.

    Raises
    ------
    StartError
        If the copy does not fit, PostgreSQL's programs are absent, or somebody uses the database.
    """
    sqlite = url.startswith("sqlite")
    if sqlite != (source.suffix == ".sqlite"):
        raise StartError("server.copy_other_kind", source=source)
    if sqlite:
        _check_sqlite(source)
    else:
        _program("pg_restore")
        _refuse_in_use(url)


def newer(source: Path, version: int) -> Sentence:
    """Explain that a copy was made by a newer hilfit."""
    return Sentence("server.copy_newer", source=source, version=version, read=SCHEMA_VERSION)


def _check_sqlite(source: Path) -> None:
    try:
        with closing(sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as copy:
            (broken,) = copy.execute("PRAGMA quick_check").fetchone()
            (version,) = copy.execute("SELECT version FROM store_version").fetchone()
    except (sqlite3.Error, TypeError) as error:
        raise StartError("server.copy_no_store", source=source, error=error) from None
    if broken != "ok":
        raise StartError("server.copy_damaged", source=source, damage=broken)
    if version > SCHEMA_VERSION:
        raise StartError(newer(source, version))


def restore_database(source: Path, url: str) -> None:
    """Put a copy in the place of the database; what was there is gone.

    Parameters
    ----------
    source : one of SQLite is moved, so it has to be on the database's file system and synced

    Raises
    ------
    StartError
        As :func:`check_restore`, or if the copy cannot be read.
    """
    check_restore(source, url)
    sqlite = url.startswith("sqlite")
    if not sqlite:
        # In one transaction: what was there stays if it cannot be restored.
        _run("pg_restore", url, "--clean", "--if-exists", "--no-owner", "--single-transaction", str(source))
        return
    target = Path(url.removeprefix("sqlite:///"))
    for leftover in ("-journal", "-wal", "-shm"):  # of the database that was there; they would spoil the copy
        target.with_name(target.name + leftover).unlink(missing_ok=True)
    source.replace(target)
    sync_directory(target.parent)


def _refuse_in_use(url: str) -> None:
    """Refuse while servers or workers, of whatever host, are connected."""
    try:
        with connected(url) as connection:
            others = connection.execute(
                sa.text(
                    "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database()"
                    " AND pid <> pg_backend_pid() AND backend_type = 'client backend'"
                )
            ).scalar()
    except sa.exc.DBAPIError as error:
        raise StartError("server.database_not_reached", reason=" ".join(str(error.orig).split())) from None
    if others:
        raise StartError("server.database_in_use", count=others)


def _copy_sqlite(source: Path, target: Path) -> None:
    with (
        closing(sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro", uri=True, timeout=30)) as database,
        closing(sqlite3.connect(target)) as copy,
    ):
        database.backup(copy)
        broken = copy.execute("PRAGMA quick_check").fetchone()[0]
    if broken != "ok":
        raise sqlite3.DatabaseError(f"the copy is damaged: {broken}")


def _program(name: str) -> str:
    """Locate one of PostgreSQL's programs, the newest that is installed.

    Raises
    ------
    StartError
        If there is none.
    """
    found = sorted(_DEBIAN.glob(f"*/bin/{name}"), key=lambda path: path.parts[-3].zfill(4))
    path = str(found[-1]) if found else shutil.which(name)
    if path is None:
        raise StartError("server.program_not_installed", name=name)
    return path


def _run(name: str, url: str, *arguments: str) -> None:
    address = sa.make_url(url)
    # The password goes by the environment: every user of the computer can read a command line.
    environment = dict(os.environ) | ({"PGPASSWORD": str(address.password)} if address.password else {})
    plain = address._replace(drivername="postgresql", password=None).render_as_string()  # to set() None is nothing
    place, mark, query = plain.partition("?")
    plain = place + mark + query.replace("+", "%20")  # what a blank is to SQLAlchemy is none to PostgreSQL
    done = subprocess.run(
        [_program(name), f"--dbname={plain}", *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    if done.returncode != 0:
        last = " ".join((done.stderr.strip() or "no reason given").splitlines()[-1].split())
        raise StartError("server.program_failed", name=name, reason=last)


def postgresql_url(url: str) -> str:
    """Return the URL with the driver that we bring (psycopg 3).

    Raises
    ------
    StartError
        If it is not one of PostgreSQL.
    """
    scheme, separator, rest = url.partition("://")
    if not separator or scheme.partition("+")[0] not in ("postgresql", "postgres"):
        raise StartError("server.database_url_other")
    return f"postgresql+psycopg://{rest}"
