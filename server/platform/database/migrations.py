"""Bring an older store up to date, one version after the other, in the transaction that opens it.

New tables need no step: they are made when the store is opened. A step changes what is there, in SQL that SQLite and
PostgreSQL both understand. Steps know nothing of :mod:`server.platform.database.schema`, which shows the newest version
only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import sqlalchemy as sa


def _add(connection: sa.Connection, table: str, column: str, kind: str) -> None:
    """Add a column to a table that is there without it; a table that is not is made now, with it."""
    inspector = sa.inspect(connection)
    if inspector.has_table(table) and column not in {known["name"] for known in inspector.get_columns(table)}:
        connection.exec_driver_sql(f"ALTER TABLE {table} ADD COLUMN {column} {kind}")


def _to_2(connection: sa.Connection) -> None:
    """Let an idempotency key have made anything, not only an identification."""
    for statement in (
        "ALTER TABLE idempotency_keys RENAME TO idempotency_keys_1",
        "CREATE TABLE idempotency_keys (key VARCHAR NOT NULL PRIMARY KEY, request_sha256 VARCHAR NOT NULL,"
        " subject VARCHAR NOT NULL, created VARCHAR NOT NULL)",
        "INSERT INTO idempotency_keys (key, request_sha256, subject, created)"
        " SELECT key, request_sha256, identification, created FROM idempotency_keys_1",
        "DROP TABLE idempotency_keys_1",
    ):
        connection.exec_driver_sql(statement)


#: PostgreSQL refuses to change, delete or truncate the audit log. A rule would do nothing and say nothing.
AUDIT_APPEND_ONLY = (
    "CREATE OR REPLACE FUNCTION audit_log_append_only() RETURNS trigger LANGUAGE plpgsql AS "
    "$$ BEGIN RAISE EXCEPTION 'the audit log is append-only'; END $$",
    "CREATE TRIGGER audit_log_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON audit_log "
    "FOR EACH STATEMENT EXECUTE FUNCTION audit_log_append_only()",
)


def _to_3(connection: sa.Connection) -> None:
    """Replace PostgreSQL's rules of the audit log, which let TRUNCATE through and refused silently."""
    if connection.dialect.name != "postgresql" or not sa.inspect(connection).has_table("audit_log"):
        return
    for statement in (
        "DROP RULE IF EXISTS audit_log_no_update ON audit_log",
        "DROP RULE IF EXISTS audit_log_no_delete ON audit_log",
        *AUDIT_APPEND_ONLY,
    ):
        connection.exec_driver_sql(statement)


def _to_4(connection: sa.Connection) -> None:
    """Give every execution of a stage its own directory; a job names which of them counts."""
    connection.exec_driver_sql("ALTER TABLE jobs ADD COLUMN place VARCHAR")


def _to_5(connection: sa.Connection) -> None:
    """Let tokens expire; those that there are do not."""
    _add(connection, "principals", "expires", "VARCHAR")
    _add(connection, "pairing_codes", "days", "INTEGER")


def _to_6(connection: sa.Connection) -> None:
    """Let a calibration be of valves: then it has no identification.

    No statement of SQLite's lets a column be empty that had to be full. The text of its declaration is changed, as its
    documentation says (lang_altertable.html, 7): rows do not change.
    """
    inspector, sqlite = sa.inspect(connection), connection.dialect.name == "sqlite"
    if not inspector.has_table("calibrations"):
        return  # it is made now
    if "valves" in {known["name"] for known in inspector.get_columns("calibrations")}:
        return
    version = connection.exec_driver_sql("PRAGMA schema_version").scalar_one() if sqlite else 0
    relaxed = (
        "PRAGMA writable_schema = ON",
        "UPDATE sqlite_master SET sql = replace(sql, 'identification VARCHAR NOT NULL', 'identification VARCHAR')"
        " WHERE name = 'calibrations'",
        f"PRAGMA schema_version = {version + 2}",
        "PRAGMA writable_schema = RESET",
    )
    for statement in (
        "ALTER TABLE calibrations ADD COLUMN valves VARCHAR",
        "CREATE UNIQUE INDEX ix_calibrations_valves ON calibrations (valves)",
        *(relaxed if sqlite else ["ALTER TABLE calibrations ALTER COLUMN identification DROP NOT NULL"]),
    ):
        connection.exec_driver_sql(statement)


def _to_7(connection: sa.Connection) -> None:
    """Keep what sentences were made of beside them; those that there are stay in English."""
    texts = ("jobs.text", "jobs.error", "job_events.text", "alarms.text", "recordings.error")
    for column in (*texts, "webhook_deliveries.error", "schedule_slots.note"):
        table, text = column.split(".")
        _add(connection, table, f"{text}_message", "JSON")


#: Per version, the step to the next one.
STEPS: Mapping[int, Callable[[sa.Connection], None]] = {1: _to_2, 2: _to_3, 3: _to_4, 4: _to_5, 5: _to_6, 6: _to_7}


def migrate(connection: sa.Connection, found: int, wanted: int) -> None:
    """Bring a store of version ``found`` to ``wanted``; nothing is committed here."""
    for version in range(found, wanted):
        STEPS[version](connection)
    connection.execute(sa.text("UPDATE store_version SET version = :version"), {"version": wanted})
