"""Schedules and their slots; no slot has two rows, so none runs twice whoever tries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import sqlalchemy as sa

from daq.messages import message_of
from server.jobs.job_store import jobs
from server.platform.database.engine import Database
from server.platform.database.repository import Repository
from server.platform.database.schema import metadata
from server.platform.database.stored import Id, OfMachine, Revision, Stored
from server.platform.errors import PreconditionError
from server.platform.http.bodies import Message, Shown
from server.platform.http.route_parameters import Tags
from server.recalibrations.recalibration_store import Plan, Recalibration, Recalibrations, recalibrations


class Schedule(Stored, table="schedules", noun="schedule"):
    """Times to recalibrate a machine, and what a slot does; slots up to ``considered`` (UTC) have had their turn."""

    id: Id
    machine: OfMachine
    label: str
    cron: str
    timezone: str
    enabled: bool
    plan: Plan
    considered: str
    created: str
    revision: Revision = 1


class SlotResource(Shown):
    """A slot in UTC; ``coalesced``: it had its turn together with a later one."""

    slot: str
    job: str | None
    state: Literal["done", "failed", "missed", "coalesced", "running"]
    note: str
    note_message: Message | None = None
    calibration: str | None


schedules = Schedule.table
schedule_slots = sa.Table(
    "schedule_slots",
    metadata,
    sa.Column("schedule", sa.String, sa.ForeignKey("schedules.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("slot", sa.String, primary_key=True),  # UTC: no slot has two rows, so none runs twice
    sa.Column("job", sa.String, sa.ForeignKey("jobs.id")),  # none: it never ran
    sa.Column("state", sa.String, nullable=False),  # ordered, coalesced, missed
    sa.Column("note", sa.String, nullable=False),
    sa.Column("note_message", sa.JSON(none_as_null=True)),
)


class Schedules(Repository[Schedule]):
    """Repository of schedules."""

    of = Schedule

    def __init__(self, database: Database) -> None:
        super().__init__(database)
        self._recalibrations = Recalibrations(database)

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
            now = self._expected(connection, changed.id, revisions)
            self.update(connection, **{**changed.columns(), "revision": now.revision + 1})
            return self.found(connection, changed.id)

    def delete(self, id: str, revisions: Tags) -> None:
        """Forget a schedule and its slots; its jobs and calibrations remain."""
        with self._database.write("schedules") as connection:
            self._expected(connection, id, revisions)
            connection.execute(schedule_slots.delete().where(schedule_slots.c.schedule == id))
            connection.execute(schedules.delete().where(schedules.c.id == id))

    def _expected(self, connection: sa.Connection, id: str, revisions: Tags) -> Schedule:
        found = self.found(connection, id)
        if revisions is not None and str(found.revision) not in revisions:
            raise PreconditionError("server.schedule_changed_meanwhile", id=id)
        return found

    def enabled(self) -> tuple[Schedule, ...]:
        """List all that run, the oldest first."""
        return self.all(schedules.c.enabled)

    def busy(self, machine: str) -> bool:
        """Test whether a recalibration of the machine is not over."""
        with self._database.read() as connection:
            return self._recalibrations.unfinished(connection, machine) is not None

    def order(self, new: Recalibration) -> None:
        """Store a recalibration that somebody wants now; ConflictError if one of the machine is not over."""
        with self._database.write("jobs", "recalibrations") as connection:
            self._recalibrations.order(connection, new)

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
                self._recalibrations.order(connection, new)
            for slot in (slot for slot in slots if slot not in had):
                last = slot == newest
                note = notes[0] if last else notes[1]
                state = "coalesced" if not last else "missed" if new is None else "ordered"
                connection.execute(
                    schedule_slots.insert().values(
                        schedule=schedule.id,
                        slot=slot,
                        job=new.job if last and new is not None else None,
                        state=state,
                        note=note,
                        note_message=message_of(note),
                    )
                )
        return True

    def go_back(self, schedule: Schedule, moment: str) -> None:
        """Set back to ``moment`` a schedule that is past the present; nothing if it was changed."""
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

    def slots(self, id: str, limit: int) -> tuple[SlotResource, ...]:
        """List the newest slots, newest first."""
        query = (
            sa.select(schedule_slots, jobs.c.state.label("ran"), recalibrations.c.calibration)
            .join(jobs, jobs.c.id == schedule_slots.c.job, isouter=True)
            .join(recalibrations, recalibrations.c.job == schedule_slots.c.job, isouter=True)
            .where(schedule_slots.c.schedule == id)
            .order_by(schedule_slots.c.slot.desc())
            .limit(limit)
        )
        states = {"queued": "running", "running": "running", "done": "done", "failed": "failed", "cancelled": "failed"}
        with self._database.read() as connection:
            self.found(connection, id)
            return tuple(
                SlotResource.of(row, state=states.get(row.ran, row.state)) for row in connection.execute(query)
            )
