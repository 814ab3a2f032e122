"""Identifications: which recordings in which roles, with which options and which outcome."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import sqlalchemy as sa
from pydantic import PlainSerializer

from server.jobs.job_store import Result
from server.platform.authorization.named_things import RecordingId
from server.platform.database.repository import Repository
from server.platform.database.schema import metadata
from server.platform.database.stored import BESIDE, Id, OfJob, OfMachine, Stored
from server.platform.errors import ConflictError
from server.platform.http.bodies import Body
from server.recordings.recording_store import RecordingRole, recordings


class RecordingChoice(Body):
    """A recording to identify from, by default in the role that it was recorded in."""

    id: RecordingId
    role: RecordingRole | None = None


def _shown(chosen: tuple[tuple[str, str], ...]) -> list[RecordingChoice]:
    return [RecordingChoice.model_validate({"id": id, "role": role}) for id, role in chosen]


class Identification(Stored, table="identifications", noun="identification"):
    """One identification; ``recordings`` are (id, role), ``verdict`` and ``overall`` the report's."""

    id: Id
    job: OfJob
    machine: OfMachine
    machine_version: int
    label: str
    recordings: Annotated[
        tuple[tuple[str, str], ...], BESIDE, PlainSerializer(_shown, return_type=list[RecordingChoice])
    ]
    options: dict[str, Any]
    created: str
    verdict: str | None = None
    overall: dict[str, Any] | None = None


identifications = Identification.table
identification_recordings = sa.Table(
    "identification_recordings",
    metadata,
    sa.Column("identification", sa.String, sa.ForeignKey("identifications.id"), primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True),
    sa.Column("recording", sa.String, sa.ForeignKey("recordings.id"), nullable=False, index=True),
    sa.Column("role", sa.String, nullable=False),
)


class Identifications(Repository[Identification]):
    """Repository of identifications."""

    of = Identification

    def put(self, connection: sa.Connection, new: Identification) -> None:
        """Store an identification, in the transaction that also stores its job.

        Raises
        ------
        ConflictError
            If a recording was deleted meanwhile.
        """
        super().put(connection, new)
        for position, (recording, role) in enumerate(new.recordings):
            state = connection.execute(sa.select(recordings.c.state).where(recordings.c.id == recording)).scalar()
            if state != "sealed":
                raise ConflictError(f"recording '{recording}' is no longer there; choose another one")
            used = {"identification": new.id, "position": position, "recording": recording, "role": role}
            connection.execute(identification_recordings.insert().values(**used))

    def values(self, connection: sa.Connection, rows: Sequence[sa.Row[Any]]) -> tuple[Identification, ...]:
        """What rows hold, with the recordings that each was made of."""
        used = identification_recordings.c
        query = sa.select(used.identification, used.recording, used.role).order_by(used.position)
        chosen: dict[str, list[tuple[str, str]]] = {row.id: [] for row in rows}
        for identification, recording, role in connection.execute(query.where(used.identification.in_(chosen))):
            chosen[identification].append((recording, role))
        return tuple(Identification.read(row, recordings=chosen[row.id]) for row in rows)

    @staticmethod
    def result(id: str, verdict: str, overall: dict[str, Any]) -> Result:
        """What the report says, to be stored with the end of the job."""
        change = identifications.update().where(identifications.c.id == id).values(verdict=verdict, overall=overall)
        return Result("identifications", change)
