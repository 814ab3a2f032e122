"""The table of recordings."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

recordings = sa.Table(
    "recordings",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("machine_version", sa.Integer, nullable=False),
    sa.Column("role", sa.String, nullable=False),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("state", sa.String, nullable=False),  # recording, sealed, failed
    sa.Column("origin", sa.String, nullable=False),  # recorded, uploaded
    sa.Column("format", sa.String, nullable=False),  # parquet, csv
    sa.Column("bytes", sa.Integer),
    sa.Column("sha256", sa.String),
    sa.Column("statistics", sa.JSON, nullable=False),
    sa.Column("error", sa.String),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("ended", sa.String),
)
