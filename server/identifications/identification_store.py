"""Identifications from recordings: which recordings in which roles, with which options and which outcome."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, TypeVar

import sqlalchemy as sa
from pydantic import PlainSerializer

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


class Fit(Stored):
    """One order; ``recordings`` are (id, role)."""

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


Ordered = TypeVar("Ordered", bound=Fit)


class Fits(Repository[Ordered]):
    """Repository of one kind of fits.

    Attributes
    ----------
    one : what one is called in ``used``, and its kind of jobs
    used : the recordings of each
    """

    one: ClassVar[str]
    used: ClassVar[sa.Table]

    def put(self, connection: sa.Connection, new: Ordered) -> None:
        """Store a fit, in the transaction that also stores its job.

        Raises
        ------
        ConflictError
            If a recording was deleted meanwhile.
        """
        super().put(connection, new)
        for position, (recording, role) in enumerate(new.recordings):
            state = connection.execute(sa.select(recordings.c.state).where(recordings.c.id == recording)).scalar()
            if state != "sealed":
                raise ConflictError("server.recording_no_longer", recording=recording)
            row = {self.one: new.id, "position": position, "recording": recording, "role": role}
            connection.execute(self.used.insert().values(**row))

    def values(self, connection: sa.Connection, rows: Sequence[sa.Row[Any]]) -> tuple[Ordered, ...]:
        """Return what rows hold, with the recordings that each was made of."""
        used, made = self.used.c, self.used.c[self.one]
        query = sa.select(made, used.recording, used.role).order_by(used.position)
        chosen: dict[str, list[tuple[str, str]]] = {row.id: [] for row in rows}
        for id, recording, role in connection.execute(query.where(made.in_(chosen))):
            chosen[id].append((recording, role))
        return tuple(self.of.read(row, recordings=chosen[row.id]) for row in rows)


def recordings_table(one: str, fits: str) -> sa.Table:
    """Make the table of recordings, with roles, of each of ``fits``, in the column named after one of them."""
    return sa.Table(
        f"{one}_recordings",
        metadata,
        sa.Column(one, sa.String, sa.ForeignKey(f"{fits}.id"), primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True),
        sa.Column("recording", sa.String, sa.ForeignKey("recordings.id"), nullable=False, index=True),
        sa.Column("role", sa.String, nullable=False),
    )


class Identification(Fit, table="identifications", noun="identification"):
    """One identification; ``verdict`` and ``overall`` are the report's."""

    verdict: str | None = None
    overall: dict[str, Any] | None = None


identifications = Identification.table
identification_recordings = recordings_table("identification", "identifications")


class Identifications(Fits[Identification]):
    """Repository of identifications."""

    of, one, used = Identification, "identification", identification_recordings
