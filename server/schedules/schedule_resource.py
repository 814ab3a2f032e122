"""The resource ``schedules``: when machines are recalibrated."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from datetime import datetime
from functools import partial
from itertools import islice
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, Field

from server.excitations.excitation_store import Excitations
from server.identifications.identification_resource import IdentificationOptions
from server.jobs.job_resource import JobResource
from server.jobs.job_runner import JobRunner
from server.jobs.job_store import Jobs
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.authorization.named_things import ExcitationId, MachineName
from server.platform.database.engine import Database, as_stored, utc_now
from server.platform.errors import InvalidError
from server.platform.http.bodies import Flag, Label, Listed
from server.platform.http.route_parameters import (
    Idempotency,
    KnownTags,
    Limit,
    MachineQuery,
    PageDep,
    ServiceDep,
    problems,
)
from server.platform.resource import PartName, Phase, Resource, Running
from server.platform.service import Service
from server.recalibrations.recalibration_site import Site
from server.recalibrations.recalibration_store import Plan
from server.schedules import schedule_slots as slots
from server.schedules.schedule_clock import ScheduleClock, next_slot
from server.schedules.schedule_store import Schedule, Schedules, SlotResource, schedule_slots, schedules


class ScheduleWish(
    BaseModel,
    extra="forbid",
    json_schema_extra={
        "examples": [{"machine": "folding-arm", "cron": "30 2 * * 1", "timezone": "Europe/Vienna", "duration_s": 600}]
    },
):
    """When and how a machine is recalibrated.

    ``motion``: record normal ``operation`` for ``duration_s`` of machine time (two thirds are fitted, one third
    judges the fit), or the ``standard`` motion: ``excitations`` names one or two, the first to fit, the last to judge
    by. ``deadline_s``: how long it waits for the machine, or for the person who runs the motion. ``activate``: only
    ``if_better`` lets it activate what it finds.
    """

    machine: MachineName
    label: Label = ""
    cron: Annotated[str, Field(max_length=200)]
    timezone: Annotated[str, Field(max_length=64)] = "UTC"
    enabled: Flag = True
    motion: Literal["operation", "standard"] = "operation"
    duration_s: Annotated[float, Field(ge=30, le=86400)] = 300.0
    excitations: Annotated[list[ExcitationId], Field(max_length=2)] = []
    deadline_s: Annotated[float, Field(ge=10, le=86400)] = 3600.0
    options: IdentificationOptions = IdentificationOptions()
    activate: Literal["never", "if_better"] = "never"

    def plan(self) -> Plan:
        """Return what a slot does."""
        own = self.model_dump(include=set(Plan.__dataclass_fields__))
        return Plan(**{**own, "excitations": tuple(self.excitations)})


class ScheduleResource(ScheduleWish):
    """A schedule; ``next`` is its next slot in UTC, ``last`` the last that had its turn."""

    id: str
    created: str
    next: str | None
    last: str | None

    @classmethod
    def of(cls, schedule: Schedule, last: SlotResource | None) -> ScheduleResource:
        """Build it from the store."""
        known = {**vars(schedule.plan), **vars(schedule), "next": next_slot(schedule), "last": last and last.slot}
        return cls(**{name: known[name] for name in cls.model_fields})


class ScheduleList(Listed[ScheduleResource]):
    """A page of schedules."""


class UpcomingSlots(BaseModel):
    """The next slots of a cron expression, in UTC; fewer where it ends."""

    slots: list[str]


class SlotList(BaseModel):
    """The newest slots of a schedule, newest first."""

    items: list[SlotResource]


router = APIRouter(prefix="/schedules", tags=["schedules"], route_class=TypedRoute)
#: Slots that are told ahead.
UPCOMING = 5


@router.post("", status_code=201, responses=problems(404, 409, 422), dependencies=[require("engineer")])
def create(
    wish: ScheduleWish,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    idempotency_key: Idempotency = None,
) -> ScheduleResource:
    """Make a schedule; its first slot is the next one from now. One ``Idempotency-Key`` makes one schedule."""

    def make() -> str:
        schedule = _checked(service, wish, f"sch-{secrets.token_hex(8)}")
        service[Schedules].keep(schedule)
        return schedule.id

    id = service.replays.once(principal.id, "schedules", idempotency_key, wish.model_dump(), make)
    response.headers["Location"] = f"/api/v1/schedules/{id}"
    return _resource(service, service[Schedules].get(id), response)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_schedules(service: ServiceDep, page: PageDep, machine: MachineQuery = None) -> ScheduleList:
    """List schedules, newest first."""
    return ScheduleList.of(service[Schedules].list(**page, machine=machine), partial(_resource, service))


@router.get("/upcoming", responses=problems(422), dependencies=[require("read")])
def upcoming(
    service: ServiceDep,
    cron: Annotated[str, Query(max_length=200)],
    timezone: Annotated[str, Query(max_length=64)] = "UTC",
) -> UpcomingSlots:
    """Return when a schedule with this expression would run next; refused as a schedule with it would be."""
    now = service[ScheduleClock].now()
    slots.check(cron, timezone, now)
    return UpcomingSlots(slots=[as_stored(slot) for slot in islice(slots.upcoming(cron, timezone, now), UPCOMING)])


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, response: Response, service: ServiceDep) -> ScheduleResource:
    """Read a schedule; its ``ETag`` is for changing it."""
    return _resource(service, service[Schedules].get(id), response)


@router.put("/{id}", responses=problems(404, 412, 422), dependencies=[require("engineer")])
def change(id: str, wish: ScheduleWish, response: Response, service: ServiceDep, tags: KnownTags) -> ScheduleResource:
    """Change a schedule; slots before now that had no turn are forgotten."""
    before = service[Schedules].get(id)
    changed = _checked(service, wish, id, before.created)
    return _resource(service, service[Schedules].replace(changed, tags), response)


@router.delete("/{id}", status_code=204, responses=problems(404, 412, 422), dependencies=[require("engineer")])
def delete(id: str, service: ServiceDep, tags: KnownTags) -> None:
    """Delete a schedule; its jobs and calibrations remain."""
    service[Schedules].delete(id, tags)


@router.post("/{id}/run", status_code=202, responses=problems(404, 409, 422), dependencies=[require("operate")])
def run(id: str, response: Response, service: ServiceDep, principal: PrincipalDep) -> JobResource:
    """Recalibrate now, whatever the clock; its job is at ``Location``."""
    job = service[ScheduleClock].order(service[Schedules].get(id), principal)
    response.headers["Location"] = f"/api/v1/jobs/{job}"
    return JobResource.of(service[Jobs].get(job))


@router.get("/{id}/slots", responses=problems(404, 422), dependencies=[require("read")])
def list_slots(id: str, service: ServiceDep, limit: Limit = 50) -> SlotList:
    """List the newest slots that had their turn, newest first."""
    return SlotList(items=[*service[Schedules].slots(id, limit)])


def _checked(service: Service, wish: ScheduleWish, id: str, created: str | None = None) -> Schedule:
    """Return the schedule of a wish; by default it is made at this moment of the schedules' clock."""
    service[Machines].get(wish.machine)
    now = service[ScheduleClock].now()
    slots.check(wish.cron, wish.timezone, now)
    for excitation in wish.excitations:
        machine = service[Excitations].get(excitation).machine
        if machine != wish.machine:
            raise InvalidError(
                "server.excitation_machine_not", excitation=excitation, machine=machine, machine_2=wish.machine
            )
    if wish.motion == "standard" and not wish.excitations:
        raise InvalidError("server.standard_motion_needs_excitations")
    return Schedule(
        id=id,
        label=wish.label or f"Recalibration of {wish.machine}",
        **wish.model_dump(include={"machine", "cron", "timezone", "enabled"}),
        plan=wish.plan(),
        considered=as_stored(now),
        created=created or as_stored(now),
    )


def _resource(service: Service, schedule: Schedule, response: Response | None = None) -> ScheduleResource:
    if response is not None:
        response.headers["ETag"] = f'"{schedule.revision}"'
    last = service[Schedules].slots(schedule.id, 1)
    return ScheduleResource.of(schedule, last[0] if last else None)


#: What schedules go by.
CLOCK: PartName[Callable[[], datetime]] = PartName("clock of the schedules")


SCHEDULES = Resource(
    name="schedules",
    routers=(router,),
    tables=(schedules, schedule_slots),
    of_a_machine={"schedules": schedules},
    kept={"/schedules": ("schedules", "jobs", "recalibrations")},
    provides={
        Schedules: lambda parts: Schedules(parts[Database]),
        CLOCK: lambda parts: utc_now,
        ScheduleClock: lambda parts: ScheduleClock(
            parts[Database], parts[JobRunner].enqueue, parts[Site].ready, parts[CLOCK]
        ),
    },
    running=lambda parts: [Running(Phase.CLOCKS, parts[ScheduleClock].rounds.start, parts[ScheduleClock].rounds.stop)],
)
