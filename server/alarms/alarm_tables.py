"""The table of alarms."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

alarms = sa.Table(
    "alarms",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("machine", sa.String, index=True),  # none: of the service as a whole
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("text", sa.String, nullable=False),
    sa.Column("severity", sa.String, nullable=False),  # info, warning, critical
    sa.Column("state", sa.String, nullable=False),  # active, cleared
    sa.Column("acknowledged", sa.Boolean, nullable=False),
    sa.Column("acknowledged_by", sa.String),
    sa.Column("shelved_until", sa.String),
    sa.Column("shelved_by", sa.String),
    sa.Column("shelve_reason", sa.String),
    sa.Column("raised", sa.String, nullable=False),  # the last time
    sa.Column("cleared", sa.String),
    sa.Column("count", sa.Integer, nullable=False),  # times raised before somebody acknowledged it
    info={"created": "raised", "label": "text"},
)
