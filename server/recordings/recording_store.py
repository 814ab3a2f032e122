"""Recordings: what was recorded or uploaded, in which role, in which state."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, Unpack

import sqlalchemy as sa

from server.platform.database.engine import Database, Page
from server.platform.database.lists import Narrowing, listed
from server.platform.errors import ConflictError, NotFoundError
from server.recordings.recording_tables import recordings

State = Literal["recording", "sealed", "failed"]


@dataclass(frozen=True)
class RecordingRow:
    """One recording; ``bytes`` and ``sha256`` are known once it is sealed."""

    id: str
    machine: str
    machine_version: int
    role: str
    label: str
    state: State
    origin: Literal["recorded", "uploaded"]
    format: Literal["parquet", "csv"]
    created: str
    bytes: int | None = None
    sha256: str | None = None
    statistics: dict[str, Any] = field(default_factory=dict)
    error: str | None = None
    ended: str | None = None


class Recordings:
    """Repository of recordings."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, row: RecordingRow) -> None:
        """Store a new recording.

        Raises
        ------
        ConflictError
            If it is being recorded and its machine is being recorded already.
        """
        with self._database.write("recordings") as connection:
            if row.state == "recording":
                running = connection.execute(
                    sa.select(recordings.c.id).where(
                        recordings.c.machine == row.machine, recordings.c.state == "recording"
                    )
                ).scalar()
                if running is not None:
                    raise ConflictError(
                        f"machine '{row.machine}' is being recorded already as {running}; stop that one first",
                        "being_recorded",
                        machine=row.machine,
                        recording=running,
                    )
            connection.execute(recordings.insert().values(**row.__dict__))

    def seal(self, id: str, *, bytes: int, sha256: str, statistics: dict[str, Any]) -> None:
        """The file is whole."""
        self._end(id, {"state": "sealed", "bytes": bytes, "sha256": sha256, "statistics": statistics})

    def fail(self, id: str, error: str, statistics: dict[str, Any] | None = None) -> None:
        """There will be no usable file; ``error`` says why in one line."""
        self._end(id, {"state": "failed", "error": error, "statistics": statistics or {}})

    def _end(self, id: str, values: dict[str, Any]) -> None:
        with self._database.write("recordings") as connection:
            connection.execute(
                recordings.update().where(recordings.c.id == id).values(**values, ended=self._database.now())
            )

    def get(self, id: str) -> RecordingRow:
        """The recording; NotFoundError if there is none."""
        with self._database.read() as connection:
            row = connection.execute(sa.select(recordings).where(recordings.c.id == id)).first()
        if row is None:
            raise NotFoundError(f"there is no recording '{id}'", recording=id)
        return _recording(row)

    def with_digest(self, machine: str, sha256: str) -> str | None:
        """The newest recording of a machine whose file has this digest; None if there is none."""
        alike = (recordings.c.machine == machine, recordings.c.sha256 == sha256)
        query = sa.select(recordings.c.id).where(*alike).order_by(recordings.c.number.desc()).limit(1)
        with self._database.read() as connection:
            return connection.execute(query).scalar()

    def ids(self) -> frozenset[str]:
        """Of all recordings."""
        with self._database.read() as connection:
            return frozenset(connection.execute(sa.select(recordings.c.id)).scalars())

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[RecordingRow]:
        """Newest first, narrowed to what is given."""
        return listed(self._database, recordings, _recording, limit, after, **narrowed)

    def delete(self, id: str) -> None:
        """Forget a recording.

        Raises
        ------
        NotFoundError
            If there is none.
        ConflictError
            If it is being recorded, or something was made of it.
        """
        with self._database.write("recordings") as connection:
            row = connection.execute(sa.select(recordings.c.state).where(recordings.c.id == id)).first()
            if row is None:
                raise NotFoundError(f"there is no recording '{id}'", recording=id)
            if row.state == "recording":
                raise ConflictError(
                    f"recording '{id}' is still being recorded; stop it first", "being_recorded", recording=id
                )
            used = _used_by(connection, id)
            if used is not None:
                raise ConflictError(f"recording '{id}' is the data of {used}; it has to stay", "in_use", recording=id)
            connection.execute(recordings.delete().where(recordings.c.id == id))


def _used_by(connection: sa.Connection, id: str) -> str | None:
    """What was made of a recording, ``identification 'idn-1'``; None: nothing, it may go.

    Whatever is made of recordings has a table that refers to them, whose first key is what was made.
    """
    for table in recordings.metadata.tables.values():
        for reference in table.foreign_keys:
            if reference.column is recordings.c.id:
                made = next(iter(table.primary_key.columns))
                found = connection.execute(sa.select(made).where(reference.parent == id)).scalar()
                if found is not None:
                    return f"{made.name} '{found}'"
    return None


def _recording(row: sa.Row[Any]) -> RecordingRow:
    return RecordingRow(**{key: value for key, value in row._mapping.items() if key != "number"})
