"""The time line of a machine, gathered from what the service keeps of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import sqlalchemy as sa

from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_store import calibration_steps, calibrations
from server.history.found_effects import FoundEffects, effects_in
from server.history.history_schemas import FoundEffect, History, HistoryEvent
from server.identifications.identification_store import identifications
from server.jobs.job_store import jobs
from server.machines.machine_store import machine_versions
from server.platform.database.engine import Database

#: Most events of one kind.
MOST = 300
#: Alarms that say that the machine is no longer as it was calibrated.
DRIFTS = frozenset({"residual_drift", "valve_drift", "residual_grew"})


class MachineHistory:
    """Gathers time lines."""

    def __init__(self, database: Database, alarms: Alarms, effects: FoundEffects) -> None:
        self._database = database
        self._alarms = alarms
        self._effects = effects

    def gather(self, machine: str, since: str) -> History:
        """Gather what happened to a machine since ``since`` (ISO 8601, UTC), newest first."""
        with self._database.read() as connection:
            ended = _identifications(connection, machine, since)
            kinds = [list(_files(connection, machine, since)), list(_calibrations(connection, machine, since))]
        # Reports are read while nothing holds the store.
        kinds += [[self._identification(row) for row in ended], list(self._alarm_events(machine, since))]
        events = sorted((event for kind in kinds for event in kind), key=lambda event: event.time, reverse=True)
        return History(machine=machine, since=since, complete=all(len(kind) < MOST for kind in kinds), items=events)

    def _identification(self, row: sa.Row[Any]) -> HistoryEvent:
        return HistoryEvent(
            time=row.ended,
            kind="identification",
            what=row.verdict or "",
            text=row.label,
            subject=row.id,
            effects=list(self._effects.of(row.id)),
            error=_error(row.overall),
        )

    def _alarm_events(self, machine: str, since: str) -> Iterator[HistoryEvent]:
        for alarm in self._alarms.since(machine, since, MOST):
            yield HistoryEvent(
                time=alarm.raised,
                until=alarm.cleared if alarm.state == "cleared" else None,
                kind="drift" if alarm.kind in DRIFTS else "alarm",
                what=alarm.kind,
                text=alarm.text,
                text_message=alarm.text_message,
                subject=alarm.id,
                by=alarm.acknowledged_by,
                severity=alarm.severity,
            )


def _identifications(connection: sa.Connection, machine: str, since: str) -> Sequence[sa.Row[Any]]:
    """Select those that ended with a result."""
    query = (
        sa.select(identifications, jobs.c.ended)
        .join(jobs, jobs.c.id == identifications.c.job)
        .where(identifications.c.machine == machine, jobs.c.state == "done", jobs.c.ended >= since)
    )
    return connection.execute(query.order_by(identifications.c.number.desc()).limit(MOST)).all()


def _files(connection: sa.Connection, machine: str, since: str) -> Iterator[HistoryEvent]:
    table = machine_versions
    query = sa.select(table).where(table.c.name == machine, table.c.created >= since)
    for row in connection.execute(query.order_by(table.c.version.desc()).limit(MOST)):
        yield HistoryEvent(time=row.created, kind="file", what="uploaded", text="", subject=str(row.version))


def _calibrations(connection: sa.Connection, machine: str, since: str) -> Iterator[HistoryEvent]:
    kept: dict[str, tuple[list[FoundEffect], float | None]] = {}
    steps = (
        sa.select(calibration_steps, calibrations.c.label, calibrations.c.overall, calibrations.c.model)
        .join(calibrations, calibrations.c.id == calibration_steps.c.calibration)
        .where(calibrations.c.machine == machine, calibrations.c.identification.is_not(None))
        .order_by(calibration_steps.c.number.desc())
    )
    rows = list(connection.execute(steps.where(calibration_steps.c.time >= since).limit(MOST)))
    # What was in use when the time begins: the last change of use before it, if it put one in use.
    use = calibration_steps.c.action.in_(("activated", "retired"))
    before = connection.execute(steps.where(calibration_steps.c.time < since, use).limit(1)).first()
    if before is not None and before.action == "activated":
        rows.append(before)
    for row in rows:
        if row.calibration not in kept:
            kept[row.calibration] = (list(effects_in(row.model)), _error(row.overall))
        effects, error = kept[row.calibration]
        yield HistoryEvent(
            time=row.time,
            kind="calibration",
            what=row.action,
            text=row.note or row.label,
            subject=row.calibration,
            by=row.by,
            effects=effects,
            error=error,
        )


def _error(overall: object) -> float | None:
    found = overall.get("after") if isinstance(overall, dict) else None
    return float(found) if isinstance(found, int | float) else None
