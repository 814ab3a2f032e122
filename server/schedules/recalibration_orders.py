"""Recalibrations that begin now: a person orders them, or a residual that drifts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import structlog

from daq.messages import Sentence
from server.platform.authorization.principals import Principal
from server.platform.database.engine import Database
from server.platform.errors import ConflictError
from server.recalibrations.recalibration_job import new_recalibration
from server.schedules.schedule_store import Schedule, Schedules

_log = structlog.stdlib.get_logger(__name__)


class RecalibrationOrders:
    """Orders what a schedule does.

    Parameters
    ----------
    enqueue : queues a stored job
    ready : raises ConflictError where a machine cannot be recalibrated now
    """

    def __init__(self, database: Database, enqueue: Callable[[str], None], ready: Callable[[str], None]) -> None:
        self._database = database
        self._schedules = Schedules(database)
        self._enqueue = enqueue
        self._ready = ready

    def order(self, schedule: Schedule, by: Principal | None = None) -> str:
        """Do now what a schedule does; return the job. ConflictError if the machine is being recalibrated.

        Parameters
        ----------
        by : the person who orders it
        """
        self._ready(schedule.machine)
        plan = replace(schedule.plan, ordered_by=None if by is None else (by.id, by.name))
        now = self._database.now()
        new = new_recalibration(schedule.machine, schedule.id, schedule.label, plan, now)
        self._schedules.order(new)
        self._enqueue(new.job)
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
            raise ConflictError(Sentence("server.machine_drifts_no_enabled", machine=machine))
        _log.info("recalibration_ordered", machine=machine, job=self.order(schedule), reason=reason)
