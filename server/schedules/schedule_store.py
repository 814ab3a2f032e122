"""Schedules and their slots; no slot has two rows, so none runs twice whoever tries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import sqlalchemy as sa

from server.jobs.job_tables import jobs
from server.platform.database.engine import Database, Page
from server.platform.database.lists import Narrowing, listed
from server.platform.errors import NotFoundError, PreconditionError
from server.platform.http.route_parameters import Tags
from server.recalibrations.recalibration_store import Plan, Recalibration, Recalibrations
from server.recalibrations.recalibration_tables import recalibrations
from server.schedules.schedule_tables import schedule_slots, schedules


@dataclass(frozen=True)
class Schedule:
    """When a machine is recalibrated; slots up to ``considered`` (UTC) have had their turn."""

    id: str
    machine: str
    label: str
    cron: str
    timezone: str
    enabled: bool
    plan: Plan
    considered: str
    created: str
    revision: int = 1


@dataclass(frozen=True)
class Slot:
    """One slot; ``state`` is done, failed, missed, coalesced or running."""

    slot: str
    job: str | None
    state: str
    note: str
    calibration: str | None


class Schedules:
    """Repository of schedules."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._recalibrations = Recalibrations(database)

    def add(self, new: Schedule) -> None:
        """Store a new schedule."""
        with self._database.write("schedules") as connection:
            connection.execute(schedules.insert().values(**_columns(new)))

    def replace(self, changed: Schedule, revisions: Tags) -> Schedule:
        """Store a changed schedule.

        Parameters
        ----------
        revisions : that the caller has seen; None: whatever there is

        Raises
        ------
        PreconditionError
            If somebody else changed it meanwhile.
        """
        with self._database.write("schedules") as connection:
            now = _get(connection, changed.id)
            if revisions is not None and str(now.revision) not in revisions:
                raise PreconditionError(f"schedule '{changed.id}' was changed meanwhile; read it again")
            values = {**_columns(changed), "revision": now.revision + 1}
            connection.execute(schedules.update().where(schedules.c.id == changed.id).values(**values))
            return _get(connection, changed.id)

    def delete(self, id: str, revisions: Tags) -> None:
        """Forget a schedule and its slots; its jobs and calibrations stay."""
        with self._database.write("schedules") as connection:
            now = _get(connection, id)
            if revisions is not None and str(now.revision) not in revisions:
                raise PreconditionError(f"schedule '{id}' was changed meanwhile; read it again")
            connection.execute(schedule_slots.delete().where(schedule_slots.c.schedule == id))
            connection.execute(schedules.delete().where(schedules.c.id == id))

    def get(self, id: str) -> Schedule:
        """The schedule; NotFoundError if there is none."""
        with self._database.read() as connection:
            return _get(connection, id)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Schedule]:
        """Newest first, narrowed to what is given."""
        return listed(self._database, schedules, _schedule, limit, after, **narrowed)

    def enabled(self) -> tuple[Schedule, ...]:
        """All that run, the oldest first."""
        query = sa.select(schedules).where(schedules.c.enabled).order_by(schedules.c.number)
        with self._database.read() as connection:
            return tuple(_schedule(row) for row in connection.execute(query))

    def busy(self, machine: str) -> bool:
        """Whether a recalibration of the machine is not over."""
        with self._database.read() as connection:
            return self._recalibrations.unfinished(connection, machine) is not None

    def order(self, new: Recalibration) -> None:
        """Store a recalibration that somebody wants now; ConflictError if one of the machine is not over."""
        with self._database.write("jobs", "recalibrations") as connection:
            self._recalibrations.insert(connection, new)

    def claim(
        self, schedule: Schedule, slots: Sequence[str], new: Recalibration | None, notes: tuple[str, str]
    ) -> bool:
        """Give the newest of ``slots`` its turn, and the others theirs with it, in one transaction.

        Parameters
        ----------
        slots : UTC, oldest first
        new : what the newest does; None: it is missed
        notes : of the newest slot, and of the others

        Returns
        -------
        False if another process was quicker, the schedule was changed, or the newest slot had its turn before the
        clock was set back; nothing is ordered then.

        Raises
        ------
        ConflictError
            If a recalibration of the machine is not over.
        """
        newest = slots[-1]
        with self._database.write("schedules", "jobs", "recalibrations") as connection:
            moved = connection.execute(
                schedules.update()
                .where(
                    schedules.c.id == schedule.id,
                    schedules.c.revision == schedule.revision,
                    schedules.c.considered < newest,
                )
                .values(considered=newest)
            )
            if moved.rowcount == 0:
                return False
            known = sa.select(schedule_slots.c.slot).where(
                schedule_slots.c.schedule == schedule.id, schedule_slots.c.slot >= slots[0]
            )
            had = set(connection.execute(known).scalars())
            if newest in had:
                return False
            if new is not None:
                self._recalibrations.insert(connection, new)
            for slot in (slot for slot in slots if slot not in had):
                last = slot == newest
                state = "coalesced" if not last else "missed" if new is None else "ordered"
                connection.execute(
                    schedule_slots.insert().values(
                        schedule=schedule.id,
                        slot=slot,
                        job=new.job if last and new is not None else None,
                        state=state,
                        note=notes[0] if last else notes[1],
                    )
                )
        return True

    def go_back(self, schedule: Schedule, moment: str) -> None:
        """Let a schedule that came further than the time is go on from ``moment``; nothing if it was changed."""
        with self._database.write("schedules") as connection:
            connection.execute(
                schedules.update()
                .where(
                    schedules.c.id == schedule.id,
                    schedules.c.revision == schedule.revision,
                    schedules.c.considered == schedule.considered,
                )
                .values(considered=moment)
            )

    def slots(self, id: str, limit: int) -> tuple[Slot, ...]:
        """The newest slots, newest first."""
        query = (
            sa.select(
                schedule_slots.c.slot,
                schedule_slots.c.job,
                schedule_slots.c.state,
                schedule_slots.c.note,
                jobs.c.state.label("ran"),
                recalibrations.c.calibration,
            )
            .join(jobs, jobs.c.id == schedule_slots.c.job, isouter=True)
            .join(recalibrations, recalibrations.c.job == schedule_slots.c.job, isouter=True)
            .where(schedule_slots.c.schedule == id)
            .order_by(schedule_slots.c.slot.desc())
            .limit(limit)
        )
        states = {"queued": "running", "running": "running", "done": "done", "failed": "failed", "cancelled": "failed"}
        with self._database.read() as connection:
            _get(connection, id)
            return tuple(
                Slot(row.slot, row.job, states.get(row.ran, row.state), row.note, row.calibration)
                for row in connection.execute(query)
            )


def _get(connection: sa.Connection, id: str) -> Schedule:
    row = connection.execute(sa.select(schedules).where(schedules.c.id == id)).first()
    if row is None:
        raise NotFoundError(f"there is no schedule '{id}'", schedule=id)
    return _schedule(row)


def _columns(schedule: Schedule) -> dict[str, Any]:
    return {**schedule.__dict__, "plan": schedule.plan.content()}


def _schedule(row: sa.Row[Any]) -> Schedule:
    values = {key: value for key, value in row._mapping.items() if key != "number"}
    return Schedule(**{**values, "plan": Plan.of(values["plan"])})
