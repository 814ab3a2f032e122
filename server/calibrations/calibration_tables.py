"""Tables of calibrations, of what was done to them, and of which was in use when."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

calibrations = sa.Table(
    "calibrations",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("revision", sa.Integer, nullable=False),  # counts its changes, for ETag
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("identification", sa.String, sa.ForeignKey("identifications.id"), nullable=False, unique=True),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("state", sa.String, nullable=False),  # proposed, approved, rejected, active, retired
    sa.Column("proposed_by", sa.String, nullable=False),
    sa.Column("proposed_by_id", sa.String, nullable=False),
    sa.Column("approved_by", sa.String),
    sa.Column("note", sa.String, nullable=False),
    sa.Column("verdict", sa.String, nullable=False),
    sa.Column("overall", sa.JSON, nullable=False),
    sa.Column("errors", sa.JSON, nullable=False),
    sa.Column("parameters", sa.JSON, nullable=False),
    sa.Column("model", sa.JSON, nullable=False),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("activated", sa.String),
)

#: Who did what to a calibration, when.
calibration_steps = sa.Table(
    "calibration_steps",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("calibration", sa.String, sa.ForeignKey("calibrations.id"), nullable=False, index=True),
    sa.Column("time", sa.String, nullable=False),
    sa.Column("action", sa.String, nullable=False),  # proposed, approved, rejected, activated, retired
    sa.Column("by", sa.String, nullable=False),
    sa.Column("by_id", sa.String, nullable=False),
    sa.Column("note", sa.String, nullable=False),
)

#: Which calibration was in use when; the last one per machine that is not undone is active.
calibration_activations = sa.Table(
    "calibration_activations",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("calibration", sa.String, sa.ForeignKey("calibrations.id"), nullable=False),
    sa.Column("time", sa.String, nullable=False),
    sa.Column("undone", sa.Boolean, nullable=False),
)
