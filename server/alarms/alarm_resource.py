"""The resource ``alarms``: what is wrong now, and who has seen it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from fastapi import APIRouter, Response
from prometheus_client.core import GaugeMetricFamily, Metric
from pydantic import Field

from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_lifecycle import LONGEST_SHELF_S, Alarm, tag
from server.alarms.alarm_watch import Watch
from server.machines.acquisition import Acquisition
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.database.engine import Database
from server.platform.http.bodies import PLAIN, Body, Listed
from server.platform.http.route_parameters import KnownTags, MachineQuery, PageDep, ServiceDep, problems
from server.platform.resource import TROUBLES, Parts, Phase, Resource, Running
from server.platform.service import Service
from server.recordings.recording_resource import FREE
from server.recordings.recording_sessions import Sessions


class AlarmResource(Alarm):
    """An alarm: ``raised`` is when it came last, ``count`` how often before somebody acknowledged it."""


class AlarmList(Listed[AlarmResource]):
    """A page of alarms."""


class Shelf(Body, json_schema_extra={"examples": [{"seconds": 28800, "reason": "the sensor is replaced"}]}):
    """How long an alarm is to be quiet, and why."""

    seconds: Annotated[float, Field(gt=0, le=LONGEST_SHELF_S)]
    reason: Annotated[str, Field(min_length=1, max_length=200, pattern=PLAIN)]


router = APIRouter(prefix="/alarms", tags=["alarms"], route_class=TypedRoute)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_alarms(
    service: ServiceDep, page: PageDep, machine: MachineQuery = None, state: Literal["active", "cleared"] | None = None
) -> AlarmList:
    """List alarms, newest first; one of the service as a whole has no machine; ``label`` is looked for in the text."""
    return AlarmList.of(service[Alarms].list(**page, machine=machine, state=state))


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, response: Response, service: ServiceDep) -> AlarmResource:
    """Read an alarm; its ``ETag`` is for changing it."""
    return _tagged(service[Alarms].get(id), response)


@router.post("/{id}/acknowledge", responses=problems(404, 412, 422), dependencies=[require("operate")])
def acknowledge(
    id: str, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> AlarmResource:
    """Note that somebody has seen it; the first who does so remains named."""
    return _tagged(service[Alarms].acknowledge(id, principal.name, tags), response)


@router.post("/{id}/shelve", responses=problems(404, 412, 422), dependencies=[require("operate")])
def shelve(
    id: str, shelf: Shelf, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> AlarmResource:
    """Keep an alarm quiet for a while: it is tracked, but nobody is to be called."""
    changed = service[Alarms].shelve(id, principal.name, shelf.reason, shelf.seconds, tags)
    return _tagged(changed, response)


@router.post("/{id}/unshelve", responses=problems(404, 412, 422), dependencies=[require("operate")])
def unshelve(id: str, response: Response, service: ServiceDep, tags: KnownTags) -> AlarmResource:
    """End an alarm's shelf, so that it shows again."""
    return _tagged(service[Alarms].unshelve(id, tags), response)


def _tagged(alarm: Alarm, response: Response) -> AlarmResource:
    response.headers["ETag"] = f'"{tag(alarm)}"'
    return AlarmResource.of(alarm)


def _watch(parts: Parts) -> Watch:
    look, troubles = parts[Service].look_for_damage, parts[TROUBLES]
    return Watch(parts[Acquisition], parts[Alarms], parts[FREE], parts[Sessions].end_all, troubles, look)


def _running(parts: Parts) -> Iterator[Running]:
    watch = parts[Watch]
    yield Running(Phase.WATCHING, watch.rounds.start, watch.rounds.stop)


def _metrics(parts: Parts) -> Iterator[Metric]:
    active = GaugeMetricFamily("hilfit_alarms_active", "Active alarms.", labels=["machine", "kind", "severity"])
    for alarm in parts[Alarms].active():
        active.add_metric([alarm.machine or "", alarm.kind, alarm.severity], 1)
    yield active


ALARMS = Resource(
    name="alarms",
    routers=(router,),
    tables=(Alarm.table,),
    of_a_machine={"alarms": Alarm.table},
    kept={"/alarms": ("alarms",)},
    provides={
        Alarms: lambda parts: Alarms(parts[Database]),
        Watch: _watch,
    },
    running=_running,
    metrics=_metrics,
)
