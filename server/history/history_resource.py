"""The resource ``history``: what happened to a machine."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping, Sequence
from datetime import timedelta
from typing import Annotated, Any, Literal

import sqlalchemy as sa
from fastapi import APIRouter, Query
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_lifecycle import Alarm
from server.calibrations.calibration_store import calibration_steps, calibrations
from server.identifications.identification_results import IdentificationResults
from server.identifications.identification_store import identifications
from server.jobs.job_store import jobs
from server.machines.machine_store import Machines, machine_versions
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.database.engine import Database, later
from server.platform.errors import NotFoundError
from server.platform.http.bodies import Message
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import Parts, Resource


class FoundEffect(BaseModel):
    """An effect that an identification added to the model; ``joint`` is null for one of the whole machine."""

    id: str
    joint: str | None
    title: str


class HistoryEvent(BaseModel):
    """Something that happened to a machine.

    ``kind``: a new version of its ``file``; an ``identification`` that ended with a result; a step of a
    ``calibration``; a ``drift`` that the monitor or a recalibration noticed; another ``alarm``. ``what``: ``uploaded``;
    the verdict; the step (``proposed``, ``approved``, ``rejected``, ``activated``, ``retired``); the kind of the alarm.
    ``until``: when an alarm went; null while it is active, and for everything that takes no time. ``subject``: id of
    what it happened to. ``effects``: what the identification found. ``error``: error over all joints with them, in
    noise floors.
    """

    time: str
    until: str | None = None
    kind: Literal["file", "identification", "calibration", "drift", "alarm"]
    what: str
    text: str
    text_message: Message | None = None
    subject: str
    by: str | None = None
    severity: Literal["info", "warning", "critical"] | None = None
    effects: list[FoundEffect] = []
    error: float | None = None


class History(BaseModel):
    """The time line of a machine, newest first.

    ``since``: where it begins; what held then, an alarm or a calibration in use, is in it although it began before.
    ``complete``: false where a kind of event has more in that time than are given; the oldest are left out.
    """

    machine: str
    since: str
    complete: bool
    items: list[HistoryEvent]


#: Identifications whose effects are kept: a report never changes.
MOST_REPORTS = 2000


def _effects_in(loop: Mapping[str, Any]) -> tuple[FoundEffect, ...]:
    """Extract the effects in the ``loop`` of a report (or in what a calibration kept of it)."""
    return tuple(
        FoundEffect(id=str(effect["id"]), joint=effect.get("joint"), title=str(effect.get("title", effect["id"])))
        for effect in loop.get("effects", ())
    )


class FoundEffects:
    """Reads the reports of identifications, each once."""

    def __init__(self, results: IdentificationResults) -> None:
        self._results = results
        self._known: dict[str, tuple[FoundEffect, ...]] = {}
        self._lock = threading.Lock()

    def of(self, identification: str) -> tuple[FoundEffect, ...]:
        """Return the effects of an identification that is done; none where its report is gone."""
        with self._lock:
            if identification in self._known:
                return self._known[identification]
        try:
            report = json.loads((self._results.directory(identification) / "report.json").read_bytes())
            found = _effects_in(report["loop"])
        except (OSError, ValueError, KeyError, TypeError, NotFoundError):
            return ()
        with self._lock:
            self._known[identification] = found
            if len(self._known) > MOST_REPORTS:
                del self._known[next(iter(self._known))]
        return found


#: Most events of one kind.
MOST = 300
#: Alarms that say that the machine is no longer as it was calibrated.
DRIFTS = frozenset({"residual_drift", "valve_drift", "residual_grew"})


def gathered(parts: Parts, machine: str, since: str) -> History:
    """Gather what happened to a machine since ``since`` (ISO 8601, UTC), newest first."""
    with parts[Database].read() as connection:
        ended = _identifications(connection, machine, since)
        kinds = [list(_files(connection, machine, since)), list(_calibrations(connection, machine, since))]
    # Reports are read while nothing holds the store.
    kinds += [[_identification(row, parts[FoundEffects]) for row in ended]]
    kinds += [[_alarm(alarm) for alarm in parts[Alarms].since(machine, since, MOST)]]
    events = sorted((event for kind in kinds for event in kind), key=lambda event: event.time, reverse=True)
    return History(machine=machine, since=since, complete=all(len(kind) < MOST for kind in kinds), items=events)


def _identification(row: sa.Row[Any], effects: FoundEffects) -> HistoryEvent:
    return HistoryEvent(
        time=row.ended,
        kind="identification",
        what=row.verdict or "",
        text=row.label,
        subject=row.id,
        effects=list(effects.of(row.id)),
        error=_error(row.overall),
    )


def _alarm(alarm: Alarm) -> HistoryEvent:
    return HistoryEvent(
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
            kept[row.calibration] = (list(_effects_in(row.model)), _error(row.overall))
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


router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)
Days = Annotated[int, Query(ge=1, le=3660, description="How far back, in days of 24 h")]


@router.get("/{name}/history", responses=problems(404, 422), dependencies=[require("read")])
async def history(name: str, service: ServiceDep, principal: PrincipalDep, days: Days = 365) -> History:
    """List calibrations, identifications with effects, drifts, alarms and versions of a machine in time order."""
    await run_in_threadpool(service[Machines].get, name)
    since = later(service.now(), -timedelta(days=days))
    return await service.heavy.run(principal.id, gathered, service, name, since)


HISTORY = Resource(
    name="history",
    routers=(router,),
    provides={FoundEffects: lambda parts: FoundEffects(parts[IdentificationResults])},
)
