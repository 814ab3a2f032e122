"""The resource ``bus_checks``: what the buses of an acquired machine bring, looked at when somebody asks."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from server.bus_checks.bus_check import BusChecks
from server.bus_checks.bus_check_schemas import BusCheck
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import Resource

router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)


@router.get("/{name}/bus-check", responses=problems(404, 409, 422, 503), dependencies=[require("read")])
async def bus_check(
    name: str,
    service: ServiceDep,
    principal: PrincipalDep,
    seconds: Annotated[float, Query(ge=2, le=50, description="Of the newest frames, at rest")] = 20.0,
    depressurised: Annotated[bool, Query(description="Pump off, lines open: pressures have to be zero")] = False,
) -> BusCheck:
    """Check the buses of an acquired machine by its newest frames: identity, mapping, latency, noise, zero, drift."""
    service[Machines].get(name)
    checks = service[BusChecks]
    return BusCheck.of(await service.heavy.run(principal.id, checks.check, name, seconds, depressurised))


BUS_CHECKS = Resource(
    name="bus_checks",
    routers=(router,),
    provides={BusChecks: lambda parts: BusChecks(parts[Acquisition])},
)
