"""The resource ``fleet``: all machines at a glance."""

from __future__ import annotations

from fastapi import APIRouter

from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import Calibrations
from server.fleet.fleet_view import Fleet, FleetView
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.monitor.monitor_supervisor import Monitors
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep
from server.platform.resource import Resource

router = APIRouter(prefix="/fleet", tags=["fleet"], route_class=TypedRoute)


@router.get("", dependencies=[require("read")])
def fleet(service: ServiceDep, principal: PrincipalDep) -> Fleet:
    """List all machines with their residual against its limit, the calibration in use, and number of alarms."""
    return service[FleetView].gather(principal.machines)


FLEET = Resource(
    name="fleet",
    routers=(router,),
    provides={
        FleetView: lambda parts: FleetView(
            parts[Machines], parts[Acquisition], parts[Monitors], parts[Calibrations], parts[Alarms]
        )
    },
)
