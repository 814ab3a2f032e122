"""The table of recalibrations."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

recalibrations = sa.Table(
    "recalibrations",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False, unique=True),
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("schedule", sa.String),  # it may be deleted later
    sa.Column("label", sa.String, nullable=False),
    sa.Column("plan", sa.JSON, nullable=False),
    sa.Column("asked", sa.String),  # since when recordings of a person count
    sa.Column("recordings", sa.JSON, nullable=False),  # role -> id
    sa.Column("identification", sa.String),
    sa.Column("comparison", sa.JSON),
    sa.Column("calibration", sa.String),
    sa.Column("created", sa.String, nullable=False),
)
