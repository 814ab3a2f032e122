"""Common parts of all tables of the store (SQLAlchemy Core), and the tables that belong to no resource.

The tables of a resource stand in its folder. Times are ISO 8601 in UTC, so text order is time order.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from typing import Any, Literal

import sqlalchemy as sa

#: Raised by one whenever a table that was there changes (a new table needs nothing);
#: :mod:`server.platform.database.migrations` brings an older store up to date, a newer one is refused.
SCHEMA_VERSION = 7

metadata = sa.MetaData()

store_version = sa.Table("store_version", metadata, sa.Column("version", sa.Integer, primary_key=True))

#: One row: which store this is, whatever file or database it is in.
store_identity = sa.Table("store_identity", metadata, sa.Column("id", sa.String, primary_key=True))

#: How often something changed, per resource; a client that saw the number knows whether to read again.
revisions = sa.Table(
    "revisions",
    metadata,
    sa.Column("resource", sa.String, primary_key=True),
    sa.Column("number", sa.Integer, nullable=False),
)

idempotency_keys = sa.Table(
    "idempotency_keys",
    metadata,
    sa.Column("key", sa.String, primary_key=True),
    sa.Column("request_sha256", sa.String, nullable=False),
    sa.Column("subject", sa.String, nullable=False),  # id of what the request made
    sa.Column("created", sa.String, nullable=False),
)

#: What is still to be sent beyond this service (:mod:`server.outward`), written in the transaction in which it became
#: true: whoever is killed when, and whichever host wrote it, nothing that is in the store stays unsent.
outbox = sa.Table(
    "outbox",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("kind", sa.String, nullable=False),  # alarm, result
    sa.Column("time", sa.String, nullable=False),
    sa.Column("content", sa.JSON, nullable=False),
)

PLATFORM_TABLES = (store_version, store_identity, revisions, idempotency_keys, outbox)


def put_out(connection: sa.Connection, kind: Literal["alarm", "result"], now: str, content: Mapping[str, Any]) -> None:
    """Add something to be sent, in the transaction of ``connection``."""
    values = {"id": f"msg-{secrets.token_hex(12)}", "kind": kind, "time": now, "content": dict(content)}
    connection.execute(outbox.insert().values(**values))
