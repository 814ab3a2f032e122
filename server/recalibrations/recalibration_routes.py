"""``/recalibrations``: what a schedule's slot, or a run by hand, recorded, fitted, compared and proposed."""

from __future__ import annotations

from fastapi import APIRouter

from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep, problems
from server.recalibrations.recalibration_schemas import RecalibrationResource
from server.recalibrations.recalibration_store import Recalibrations

router = APIRouter(prefix="/recalibrations", tags=["schedules"], route_class=TypedRoute)


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> RecalibrationResource:
    """Read a recalibration, with the table of errors before and after."""
    return RecalibrationResource.of(service[Recalibrations].get(id))
