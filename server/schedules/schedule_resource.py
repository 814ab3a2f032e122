"""The resource ``schedules``: when machines are recalibrated."""

from __future__ import annotations

from collections.abc import Iterator

from server.jobs.job_runner import JobRunner
from server.platform.database.engine import Database
from server.platform.parts import Parts
from server.platform.resource import Phase, Resource, Running
from server.platform.service import CLOCK
from server.recalibrations.recalibration_site import Site
from server.schedules.recalibration_orders import RecalibrationOrders
from server.schedules.schedule_clock import ScheduleClock
from server.schedules.schedule_routes import router
from server.schedules.schedule_store import Schedules
from server.schedules.schedule_tables import schedule_slots, schedules


def _clock(parts: Parts) -> ScheduleClock:
    return ScheduleClock(parts[Database], parts[JobRunner].enqueue, parts[Site].ready, parts[CLOCK])


def _running(parts: Parts) -> Iterator[Running]:
    clock = parts[ScheduleClock]
    yield Running(Phase.CLOCKS, clock.start, clock.stop)


def _orders(parts: Parts) -> RecalibrationOrders:
    return RecalibrationOrders(parts[Database], parts[JobRunner].enqueue, parts[Site].ready)


SCHEDULES = Resource(
    name="schedules",
    routers=(router,),
    tables=(schedules, schedule_slots),
    of_a_machine={"schedules": schedules},
    kept={"/schedules": ("schedules", "jobs", "recalibrations")},
    provides={
        Schedules: lambda parts: Schedules(parts[Database]),
        ScheduleClock: _clock,
        RecalibrationOrders: _orders,
    },
    running=_running,
)
