"""``/machines/{name}/monitor``: the live residual against the active calibration."""

from __future__ import annotations

from fastapi import APIRouter

from server.machines.machine_store import Machines
from server.monitor.monitor_schemas import MonitorResource
from server.monitor.monitor_supervisor import Monitors
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep, problems

router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)


@router.get("/{name}/monitor", responses=problems(404, 422), dependencies=[require("read")])
def monitor(name: str, service: ServiceDep) -> MonitorResource:
    """Whether a machine still does what its active calibration says, joint by joint."""
    service[Machines].get(name)
    return MonitorResource(**service[Monitors].state(name))
