"""The resource ``history``: what happened to a machine."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.concurrency import run_in_threadpool

from server.alarms.alarm_desk import Alarms
from server.history.found_effects import FoundEffects
from server.history.history_schemas import History
from server.history.machine_history import MachineHistory
from server.identifications.identification_results import IdentificationResults
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.database.engine import Database, as_stored
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import Resource

router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)
Days = Annotated[int, Query(ge=1, le=3660, description="How far back, in days of 24 h")]


@router.get("/{name}/history", responses=problems(404, 422), dependencies=[require("read")])
async def history(name: str, service: ServiceDep, principal: PrincipalDep, days: Days = 365) -> History:
    """List calibrations, identifications with effects, drifts, alarms and versions of a machine in time order."""
    await run_in_threadpool(service[Machines].get, name)
    since = datetime.fromisoformat(service.now()) - timedelta(days=days)
    return await service.heavy.run(principal.id, service[MachineHistory].gather, name, as_stored(since))


HISTORY = Resource(
    name="history",
    routers=(router,),
    provides={
        FoundEffects: lambda parts: FoundEffects(parts[IdentificationResults]),
        MachineHistory: lambda parts: MachineHistory(parts[Database], parts[Alarms], parts[FoundEffects]),
    },
)
