"""Tables of identifications and of the recordings that they are made of."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

identifications = sa.Table(
    "identifications",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False, unique=True),
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("machine_version", sa.Integer, nullable=False),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("options", sa.JSON, nullable=False),
    sa.Column("verdict", sa.String),
    sa.Column("overall", sa.JSON),
    sa.Column("created", sa.String, nullable=False),
)

identification_recordings = sa.Table(
    "identification_recordings",
    metadata,
    sa.Column("identification", sa.String, sa.ForeignKey("identifications.id"), primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True),
    sa.Column("recording", sa.String, sa.ForeignKey("recordings.id"), nullable=False, index=True),
    sa.Column("role", sa.String, nullable=False),
)
