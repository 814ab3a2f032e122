"""The audit log, which only grows."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from server.platform.database import migrations
from server.platform.database.schema import metadata

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
