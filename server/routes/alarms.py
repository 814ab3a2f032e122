"""``/alarms``: what is wrong, who has seen it, what is shelved."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query

from server.access.guard import PrincipalDep, require
from server.alarms.resources import AlarmList, AlarmResource, Shelf
from server.routes.common import Cursor, Limit, ServiceDep, problems

router = APIRouter(prefix="/alarms", tags=["alarms"])


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_alarms(
    service: ServiceDep,
    principal: PrincipalDep,
    machine: Annotated[str | None, Query(max_length=80)] = None,
    state: Literal["active", "cleared"] | None = None,
    limit: Limit = 50,
    cursor: Cursor = 0,
) -> AlarmList:
    """List alarms, newest first; one of the service as a whole has no machine."""
    return AlarmList.of(service.alarms.list(limit, cursor, machine=machine, machines=principal.machines, state=state))


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> AlarmResource:
    """Read an alarm."""
    return AlarmResource.of(service.alarms.get(id))


@router.post("/{id}/acknowledge", responses=problems(404, 422), dependencies=[require("operate")])
def acknowledge(id: str, service: ServiceDep, principal: PrincipalDep) -> AlarmResource:
    """Say that somebody has seen it; the first who says so stays named."""
    return AlarmResource.of(service.alarms.acknowledge(id, principal.name))


@router.post("/{id}/shelve", responses=problems(404, 422), dependencies=[require("operate")])
def shelve(id: str, shelf: Shelf, service: ServiceDep, principal: PrincipalDep) -> AlarmResource:
    """Keep an alarm quiet for a while: it is tracked, but nobody is to be called."""
    return AlarmResource.of(service.alarms.shelve(id, principal.name, shelf.reason, shelf.seconds))


@router.post("/{id}/unshelve", responses=problems(404, 422), dependencies=[require("operate")])
def unshelve(id: str, service: ServiceDep) -> AlarmResource:
    """Let a shelved alarm be heard again."""
    return AlarmResource.of(service.alarms.unshelve(id))
