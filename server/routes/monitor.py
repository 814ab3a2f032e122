"""``/machines/{name}/monitor``: the live residual against the active calibration."""

from __future__ import annotations

from fastapi import APIRouter

from server.access.guard import require
from server.access.route import TypedRoute
from server.monitor.resources import MonitorResource
from server.routes.common import ServiceDep, problems

router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)


@router.get("/{name}/monitor", responses=problems(404, 422), dependencies=[require("read")])
def monitor(name: str, service: ServiceDep) -> MonitorResource:
    """Whether a machine still does what its active calibration says, joint by joint."""
    service.machines.get(name)
    return MonitorResource(**service.monitors.state(name))
