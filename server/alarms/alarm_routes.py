"""``/alarms``: what is wrong, who has seen it, what is shelved."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, Response

from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_lifecycle import Alarm, tag
from server.alarms.alarm_schemas import AlarmList, AlarmResource, Shelf
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import (
    BetweenDep,
    Cursor,
    KnownTags,
    Limit,
    MachineQuery,
    ServiceDep,
    problems,
)

router = APIRouter(prefix="/alarms", tags=["alarms"], route_class=TypedRoute)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_alarms(
    service: ServiceDep,
    principal: PrincipalDep,
    between: BetweenDep,
    machine: MachineQuery = None,
    state: Literal["active", "cleared"] | None = None,
    limit: Limit = 50,
    cursor: Cursor = 0,
) -> AlarmList:
    """List alarms, newest first; one of the service as a whole has no machine; ``label`` is looked for in the text."""
    own = service[Alarms].list(
        limit, cursor, machine=machine, machines=principal.machines, state=state, between=between
    )
    return AlarmList.of(own)


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, response: Response, service: ServiceDep) -> AlarmResource:
    """Read an alarm; its ``ETag`` is for changing it."""
    return _tagged(service[Alarms].get(id), response)


@router.post("/{id}/acknowledge", responses=problems(404, 412, 422), dependencies=[require("operate")])
def acknowledge(
    id: str, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> AlarmResource:
    """Say that somebody has seen it; the first who says so stays named."""
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
    """Let a shelved alarm be heard again."""
    return _tagged(service[Alarms].unshelve(id, tags), response)


def _tagged(alarm: Alarm, response: Response) -> AlarmResource:
    response.headers["ETag"] = f'"{tag(alarm)}"'
    return AlarmResource.of(alarm)
