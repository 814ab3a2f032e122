"""``/status``: the service at a glance."""

from __future__ import annotations

from fastapi import APIRouter, Response

from server.access.guard import PrincipalDep, require
from server.access.route import TypedRoute
from server.resources import Status
from server.routes.common import ServiceDep

router = APIRouter(prefix="/status", tags=["status"], route_class=TypedRoute)


@router.get("", response_model=Status, dependencies=[require("read")])
async def status(service: ServiceDep, principal: PrincipalDep) -> Response:
    """Revision counters, jobs and acquisition."""
    found = await service.status()
    found = found.model_copy(update={"acquisition": principal.visible(found.acquisition)})
    # Serialised once, by pydantic's own serialiser; FastAPI would validate it again and build dictionaries of it first.
    return Response(found.model_dump_json(), media_type="application/json")
