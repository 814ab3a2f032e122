"""``/status``: the service at a glance."""

from __future__ import annotations

from fastapi import APIRouter

from server.access.guard import PrincipalDep, require
from server.resources import Status
from server.routes.common import ServiceDep

router = APIRouter(prefix="/status", tags=["status"])


@router.get("", dependencies=[require("read")])
def status(service: ServiceDep, principal: PrincipalDep) -> Status:
    """Revision counters, jobs and acquisition."""
    found = service.status()
    return found.model_copy(update={"acquisition": principal.visible(found.acquisition)})
