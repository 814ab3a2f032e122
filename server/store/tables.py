"""Tables of the store (SQLAlchemy Core). Times are ISO 8601 in UTC, so text order is time order."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from server.store import migrations

#: Raised by one whenever a table that was there changes (a new table needs nothing); :mod:`server.store.migrations`
#: brings an older store up to date, a newer one is refused.
SCHEMA_VERSION = 5

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
    sa.Column("kind", sa.String, nullable=False),  # identification, excitation, recalibration
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
    sa.Column("place", sa.String),  # directory, below that of the job, in which its last stage left its files
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
    sa.Column("subject", sa.String, nullable=False),  # id of what the request made
    sa.Column("created", sa.String, nullable=False),
)

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
)

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

#: Processes that run jobs; one that is silent for long has lost its work to the others.
executors = sa.Table(
    "executors",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("host", sa.String, nullable=False),
    sa.Column("started", sa.String, nullable=False),
    sa.Column("seen", sa.String, nullable=False),
)

#: Who works on a job: a fencing token (:mod:`server.store.claims`).
job_claims = sa.Table(
    "job_claims",
    metadata,
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), primary_key=True),
    sa.Column("number", sa.Integer, nullable=False),  # one higher with every holder
    sa.Column("holder", sa.String),  # executor; none: free
)

#: Paired devices and API keys; of what they send only a hash is kept.
principals = sa.Table(
    "principals",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("kind", sa.String, nullable=False),  # device, key
    sa.Column("name", sa.String, nullable=False),
    sa.Column("role", sa.String, nullable=False),
    sa.Column("machines", sa.JSON(none_as_null=True)),  # none: all
    sa.Column("secret_sha256", sa.String, nullable=False, unique=True),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("created_by", sa.String, nullable=False),
    sa.Column("expires", sa.String),  # none: never
)

pairing_codes = sa.Table(
    "pairing_codes",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("code_hash", sa.String, nullable=False),  # Argon2id: six digits are soon tried with a quick hash
    sa.Column("role", sa.String, nullable=False),
    sa.Column("machines", sa.JSON(none_as_null=True)),
    sa.Column("created_by", sa.String, nullable=False),
    sa.Column("expires", sa.String, nullable=False),
    sa.Column("failures", sa.Integer, nullable=False),  # wrong codes that came while it was open
    sa.Column("days", sa.Integer),  # that the device's token is good for
)

#: Rows are added, never changed; the database refuses it.
audit_log = sa.Table(
    "audit_log",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),  # 1, 2, ... without a gap
    sa.Column("time", sa.String, nullable=False),
    sa.Column("principal", sa.String, nullable=False),
    sa.Column("action", sa.String, nullable=False),
    sa.Column("subject", sa.String, nullable=False),
    sa.Column("detail", sa.String, nullable=False),  # JSON as it was hashed
    sa.Column("hash", sa.String, nullable=False),
)
_APPEND_ONLY = {
    "sqlite": tuple(
        f"CREATE TRIGGER audit_log_no_{event.lower()} BEFORE {event} ON audit_log "
        "BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END"
        for event in ("UPDATE", "DELETE")
    ),
    "postgresql": migrations.AUDIT_APPEND_ONLY,
}
_ddl: Any = sa.DDL  # its constructor has no types
for _dialect, _statements in _APPEND_ONLY.items():
    for _statement in _statements:
        sa.event.listen(audit_log, "after_create", _ddl(_statement).execute_if(dialect=_dialect))

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
