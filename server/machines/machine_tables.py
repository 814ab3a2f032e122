"""Tables of machines and of the versions of their files."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

machines = sa.Table(
    "machines",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),  # order of creation: the cursor of pages
    sa.Column("name", sa.String, nullable=False, unique=True),
    sa.Column("version", sa.Integer, nullable=False),  # the current one
    sa.Column("acquire", sa.Boolean, nullable=False),  # whether acquisition should run
)

machine_versions = sa.Table(
    "machine_versions",
    metadata,
    sa.Column("name", sa.String, sa.ForeignKey("machines.name"), primary_key=True),
    sa.Column("version", sa.Integer, primary_key=True),
    sa.Column("sha256", sa.String, nullable=False),
    sa.Column("created", sa.String, nullable=False),
)
