"""The table of excitations."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

excitations = sa.Table(
    "excitations",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False, unique=True),
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("machine_version", sa.Integer, nullable=False),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("options", sa.JSON, nullable=False),
    sa.Column("result", sa.JSON),  # once it is designed
    sa.Column("created", sa.String, nullable=False),
)
