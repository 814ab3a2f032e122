"""Tables of what is identified from recordings, and of the recordings that each is made of."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata


def fit_table(name: str, *result: sa.Column[str]) -> sa.Table:
    """The table of one kind: what every one of them has, and columns of its result."""
    return sa.Table(
        name,
        metadata,
        sa.Column("number", sa.Integer, primary_key=True),
        sa.Column("id", sa.String, nullable=False, unique=True),
        sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False, unique=True),
        sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
        sa.Column("machine_version", sa.Integer, nullable=False),
        sa.Column("label", sa.String, nullable=False),
        sa.Column("options", sa.JSON, nullable=False),
        *result,
        sa.Column("created", sa.String, nullable=False),
    )


def recordings_table(one: str, fits: str) -> sa.Table:
    """Recordings with their roles of each of ``fits``, in the column that is called as ``one`` of them is."""
    return sa.Table(
        f"{one}_recordings",
        metadata,
        sa.Column(one, sa.String, sa.ForeignKey(f"{fits}.id"), primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True),
        sa.Column("recording", sa.String, sa.ForeignKey("recordings.id"), nullable=False, index=True),
        sa.Column("role", sa.String, nullable=False),
    )


identifications = fit_table("identifications", sa.Column("verdict", sa.String), sa.Column("overall", sa.JSON))
identification_recordings = recordings_table("identification", "identifications")
