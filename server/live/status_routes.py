"""``/status``: the service at a glance."""

from __future__ import annotations

from fastapi import APIRouter, Response

from server.live.overview import Overview, Status
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep

router = APIRouter(prefix="/status", tags=["status"], route_class=TypedRoute)


@router.get("", response_model=Status, dependencies=[require("read")])
async def status(service: ServiceDep, principal: PrincipalDep) -> Response:
    """Return revision counters, jobs and acquisition."""
    found = await service[Overview].status()
    found = found.model_copy(update={"acquisition": principal.visible(found.acquisition)})
    # Serialised once, by pydantic's own serialiser; FastAPI would validate it again and build dictionaries of it first.
    return Response(found.model_dump_json(), media_type="application/json")
