"""The resource ``schedules``: when machines are recalibrated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime

from server.jobs.job_runner import JobRunner
from server.platform.database.engine import Database, utc_now
from server.platform.parts import PartName, Parts
from server.platform.resource import Phase, Resource, Running
from server.recalibrations.recalibration_site import Site
from server.schedules.recalibration_orders import RecalibrationOrders
from server.schedules.schedule_clock import ScheduleClock
from server.schedules.schedule_routes import router
from server.schedules.schedule_store import Schedules, schedule_slots, schedules

#: What schedules go by.
CLOCK: PartName[Callable[[], datetime]] = PartName("clock of the schedules")


def _clock(parts: Parts) -> ScheduleClock:
    return ScheduleClock(parts[Database], parts[JobRunner].enqueue, parts[Site].ready, parts[CLOCK])


def _running(parts: Parts) -> Iterator[Running]:
    clock = parts[ScheduleClock]
    yield Running(Phase.CLOCKS, clock.rounds.start, clock.rounds.stop)


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
        CLOCK: lambda parts: utc_now,
        ScheduleClock: _clock,
        RecalibrationOrders: _orders,
    },
    running=_running,
)
