"""Tables of jobs: their progress, who runs them, who works on which."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("kind", sa.String, nullable=False),  # identification, valve, excitation, recalibration
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

#: Digests of what jobs read and left, where that travels between hosts (:mod:`server.platform.storage`).
job_files = sa.Table(
    "job_files",
    metadata,
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), primary_key=True),
    sa.Column("use", sa.String, primary_key=True),  # input, result
    sa.Column("name", sa.String, primary_key=True),  # below the data directory, or below the job's place
    sa.Column("sha256", sa.String, nullable=False),
)

#: What hosts say of themselves.
hosts = sa.Table(
    "hosts",
    metadata,
    sa.Column("id", sa.String, primary_key=True),  # as in executors
    sa.Column("version", sa.String, nullable=False),
    sa.Column("cores", sa.Integer, nullable=False),
    sa.Column("load", sa.Float, nullable=False),  # mean of the last minute, of all its processes
    sa.Column("state", sa.String, nullable=False),  # what it does, or what it waits for
    sa.Column("heard", sa.String, nullable=False),
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

#: Who works on a job: a fencing token (:mod:`server.jobs.claims`).
job_claims = sa.Table(
    "job_claims",
    metadata,
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), primary_key=True),
    sa.Column("number", sa.Integer, nullable=False),  # one higher with every holder
    sa.Column("holder", sa.String),  # executor; none: free
)
