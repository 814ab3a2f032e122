"""Tables of the store (SQLAlchemy Core). Times are ISO 8601 in UTC, so text order is time order."""

from __future__ import annotations

import sqlalchemy as sa

#: Raised by one whenever a table changes; the store refuses to open a file of another version.
SCHEMA_VERSION = 1

metadata = sa.MetaData()

store_version = sa.Table("store_version", metadata, sa.Column("version", sa.Integer, primary_key=True))

#: How often something changed, per resource; a client that saw the number knows whether to read again.
revisions = sa.Table(
    "revisions",
    metadata,
    sa.Column("resource", sa.String, primary_key=True),
    sa.Column("number", sa.Integer, nullable=False),
)

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

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("kind", sa.String, nullable=False),  # identification
    sa.Column("label", sa.String, nullable=False),
    sa.Column("subject", sa.String, nullable=False),  # id of what the job makes
    sa.Column("stages", sa.JSON, nullable=False),
    sa.Column("state", sa.String, nullable=False),  # queued, running, done, failed, cancelled
    sa.Column("stage", sa.String),
    sa.Column("fraction", sa.Float, nullable=False),
    sa.Column("text", sa.String, nullable=False),
    sa.Column("error", sa.String),
    sa.Column("cancel_requested", sa.Boolean, nullable=False),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("started", sa.String),
    sa.Column("ended", sa.String),
)

job_events = sa.Table(
    "job_events",
    metadata,
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True),  # 1, 2, ... within the job
    sa.Column("time", sa.String, nullable=False),
    sa.Column("state", sa.String, nullable=False),
    sa.Column("stage", sa.String),
    sa.Column("fraction", sa.Float, nullable=False),
    sa.Column("text", sa.String, nullable=False),
)

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

idempotency_keys = sa.Table(
    "idempotency_keys",
    metadata,
    sa.Column("key", sa.String, primary_key=True),
    sa.Column("request_sha256", sa.String, nullable=False),
    sa.Column("identification", sa.String, sa.ForeignKey("identifications.id"), nullable=False),
    sa.Column("created", sa.String, nullable=False),
)
