"""Gives slots of schedules their turn, and orders recalibrations by hand or because a residual drifts.

What counts is the store: a slot's row, its job and how far the schedule has come are written in one transaction, so
whatever is killed when, and however many servers look at the clock, a slot has its turn once. Slots that were missed,
because the service was off or the machine was still being recalibrated, have it together, as one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import structlog

from daq.errors import HilfitError
from daq.messages import Sentence
from server.platform.authorization.principals import Principal
from server.platform.database.engine import Database, as_stored
from server.platform.errors import ConflictError
from server.platform.processes.rounds import Rounds
from server.recalibrations.recalibration_job import new_recalibration
from server.schedules import schedule_slots as slots
from server.schedules.schedule_store import Schedule, Schedules

#: Seconds between two looks at the clock: how late a slot may begin.
LOOK_S = 2.0
#: How far beyond the clock a schedule may have come: by more, the clock was wrong and has been set right.
HORIZON = timedelta(days=1)
#: Most missed slots that are written down one by one.
KEPT = 50
_TOGETHER = Sentence("server.had_its_turn_together")
_log = structlog.stdlib.get_logger(__name__)


@dataclass(eq=False)
class ScheduleClock:
    """Orders recalibrations: by the clock, by hand, and because a residual drifts.

    Attributes
    ----------
    enqueue : queues a stored job
    ready : raises HilfitError where a machine cannot be recalibrated now; the slot is missed then
    now : UTC; a schedule's first slot is after it, and every slot is due by it
    """

    database: Database
    enqueue: Callable[[str], None]
    ready: Callable[[str], None]
    now: Callable[[], datetime]

    def __post_init__(self) -> None:
        self._schedules = Schedules(self.database)
        self.rounds = Rounds("schedules", LOOK_S, self.look, at_once=True)

    def look(self) -> tuple[str, ...]:
        """Give every slot that is due its turn; return the jobs that were ordered."""
        ordered = (self._turn(schedule) for schedule in self._schedules.enabled())
        return tuple(job for job in ordered if job is not None)

    def _turn(self, schedule: Schedule) -> str | None:
        considered, now = datetime.fromisoformat(schedule.considered), self.now()
        if considered > now + HORIZON:  # else it would wait for the time that the clock once showed
            self._schedules.go_back(schedule, as_stored(now))
            _log.warning("schedule_set_back", schedule=schedule.id, considered=schedule.considered)
            return None
        # While the machine is being recalibrated its slots wait, and have their turn together afterwards.
        if self._schedules.busy(schedule.machine):
            return None
        due = slots.due(schedule.cron, schedule.timezone, considered, now, KEPT)
        if not due:
            return None
        written = [as_stored(slot) for slot in due]
        try:
            self.ready(schedule.machine)
        except HilfitError as error:
            self._schedules.claim(schedule, written, None, (str(error), _TOGETHER))
            _log.warning("slot_missed", schedule=schedule.id, slot=written[-1], reason=str(error))
            return None
        new = new_recalibration(schedule.machine, schedule.id, schedule.label, schedule.plan, self.database.now())
        note = Sentence("server.stands_for_earlier", count=len(due) - 1) if len(due) > 1 else ""
        try:
            if not self._schedules.claim(schedule, written, new, (note, _TOGETHER)):
                return None
        except ConflictError:  # somebody ordered one by hand at this moment
            return None
        # If we are killed here, the job is stored and is queued at the next start.
        self.enqueue(new.job)
        _log.info("slot_ordered", schedule=schedule.id, slot=written[-1], job=new.job)
        return new.job

    def order(self, schedule: Schedule, by: Principal | None = None) -> str:
        """Do now what a schedule does; return the job. ConflictError if the machine is being recalibrated.

        Parameters
        ----------
        by : the person who orders it
        """
        self.ready(schedule.machine)
        plan = replace(schedule.plan, ordered_by=None if by is None else (by.id, by.name))
        now = self.database.now()
        new = new_recalibration(schedule.machine, schedule.id, schedule.label, plan, now)
        self._schedules.order(new)
        self.enqueue(new.job)
        return new.job

    def order_drifted(self, machine: str, reason: str) -> None:
        """Do now what the machine's schedule does, because its residual drifts.

        Raises
        ------
        ConflictError
            If no schedule defines how, or the machine is being recalibrated.
        """
        schedule = next((own for own in self._schedules.enabled() if own.machine == machine), None)
        if schedule is None:
            raise ConflictError("server.machine_drifts_no_enabled", machine=machine)
        _log.info("recalibration_ordered", machine=machine, job=self.order(schedule), reason=reason)


def next_slot(schedule: Schedule) -> str | None:
    """Return a schedule's next slot that has not had its turn; None if it does not run."""
    if not schedule.enabled:
        return None
    after = datetime.fromisoformat(schedule.considered)
    found = next(slots.upcoming(schedule.cron, schedule.timezone, after), None)
    return None if found is None else as_stored(found)
