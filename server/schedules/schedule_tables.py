"""Tables of schedules and of the slots that had their turn."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

schedules = sa.Table(
    "schedules",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("revision", sa.Integer, nullable=False),  # counts its changes, for ETag
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("cron", sa.String, nullable=False),
    sa.Column("timezone", sa.String, nullable=False),
    sa.Column("enabled", sa.Boolean, nullable=False),
    sa.Column("plan", sa.JSON, nullable=False),  # what a slot does
    sa.Column("considered", sa.String, nullable=False),  # slots up to this moment have had their turn
    sa.Column("created", sa.String, nullable=False),
)

schedule_slots = sa.Table(
    "schedule_slots",
    metadata,
    sa.Column("schedule", sa.String, sa.ForeignKey("schedules.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("slot", sa.String, primary_key=True),  # UTC: no slot has two rows, so none runs twice
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id")),  # none: it never ran
    sa.Column("state", sa.String, nullable=False),  # ordered, coalesced, missed
    sa.Column("note", sa.String, nullable=False),
)
