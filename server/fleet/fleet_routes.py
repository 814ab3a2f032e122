"""``/fleet``: all machines at a glance."""

from __future__ import annotations

from fastapi import APIRouter

from server.fleet.fleet_schemas import Fleet
from server.fleet.fleet_view import FleetView
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep

router = APIRouter(prefix="/fleet", tags=["fleet"], route_class=TypedRoute)


@router.get("", dependencies=[require("read")])
def fleet(service: ServiceDep, principal: PrincipalDep) -> Fleet:
    """All machines with their residual against its limit, the calibration in use, and how many alarms there are."""
    return service[FleetView].gather(principal.machines)
