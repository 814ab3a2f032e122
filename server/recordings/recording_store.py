"""Recordings: what was recorded or uploaded, in which role, in which state."""

from __future__ import annotations

from typing import Any, Literal

import sqlalchemy as sa
from pydantic import Field

from daq.messages import Sentence
from server.platform.database.repository import Repository
from server.platform.database.stored import Id, OfMachine, Stored
from server.platform.errors import ConflictError
from server.platform.http.bodies import Message

RecordingRole = Literal["unloaded", "train", "repeat", "validate", "operation"]
State = Literal["recording", "sealed", "failed"]


class RecordingRow(Stored, table="recordings", noun="recording"):
    """One recording; ``bytes`` and ``sha256`` are known once it is sealed."""

    id: Id
    machine: OfMachine
    machine_version: int
    role: str
    label: str
    state: State
    origin: Literal["recorded", "uploaded"]
    format: Literal["parquet", "csv"]
    created: str
    ended: str | None = None
    bytes: int | None = None
    sha256: str | None = None
    statistics: dict[str, Any] = Field(default_factory=dict)
    error: str | None = None
    error_message: Message | None = None


recordings = RecordingRow.table


class Recordings(Repository[RecordingRow]):
    """Repository of recordings."""

    of = RecordingRow

    def add(self, row: RecordingRow) -> None:
        """Store a new recording.

        Raises
        ------
        ConflictError
            If it is being recorded and its machine is being recorded already.
        """
        with self._database.write("recordings") as connection:
            if row.state == "recording":
                under_way = recordings.c.machine == row.machine, recordings.c.state == "recording"
                running = connection.execute(sa.select(recordings.c.id).where(*under_way)).scalar()
                if running is not None:
                    refusal = ConflictError(
                        "server.machine_being_recorded_already", machine=row.machine, running=running
                    )
                    raise refusal.about("being_recorded", machine=row.machine, recording=running)
            self.put(connection, row)

    def seal(self, id: str, *, bytes: int, sha256: str, statistics: dict[str, Any]) -> None:
        """Seal it: the file is whole."""
        self._end(id, {"state": "sealed", "bytes": bytes, "sha256": sha256, "statistics": statistics})

    def fail(self, id: str, error: str) -> None:
        """Fail it: there will be no usable file; ``error`` is the reason in one line."""
        self._end(id, {"state": "failed", "error": error, "statistics": {}})

    def _end(self, id: str, values: dict[str, Any]) -> None:
        with self._database.write("recordings") as connection:
            self.update(connection, id, **values, ended=self._database.now())

    def with_digest(self, machine: str, sha256: str) -> str | None:
        """Find the newest recording of a machine whose file has this digest; None if there is none."""
        found = self.all(recordings.c.machine == machine, recordings.c.sha256 == sha256, newest=1)
        return found[0].id if found else None

    def ids(self) -> frozenset[str]:
        """Return the ids of all recordings."""
        with self._database.read() as connection:
            return frozenset(connection.execute(sa.select(recordings.c.id)).scalars())

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
            if self.found(connection, id).state == "recording":
                refusal = ConflictError("server.recording_still_being_recorded", id=id)
                raise refusal.about("being_recorded", recording=id)
            used = _used_by(connection, id)
            if used is not None:
                raise ConflictError("server.recording_data", id=id, used=used).about("in_use", recording=id)
            connection.execute(recordings.delete().where(recordings.c.id == id))


def _used_by(connection: sa.Connection, id: str) -> Sentence | None:
    """Return what was made of a recording, ``identification 'idn-1'``; None: nothing, it may go.

    Whatever is made of recordings has a table that refers to them, whose first key is what was made.
    """
    for table in recordings.metadata.tables.values():
        for reference in table.foreign_keys:
            if reference.column is recordings.c.id:
                made = next(iter(table.primary_key.columns))
                found = connection.execute(sa.select(made).where(reference.parent == id)).scalar()
                if found is not None:
                    return Sentence("server.named_thing", kind=made.name, id=found)
    return None
