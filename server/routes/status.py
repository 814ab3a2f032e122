"""``/status``: the service at a glance."""

from __future__ import annotations

from fastapi import APIRouter

from server.resources import Status
from server.routes.common import ServiceDep

router = APIRouter(prefix="/status", tags=["status"])


@router.get("")
def status(service: ServiceDep) -> Status:
    """Revision counters, jobs and acquisition."""
    return service.status()
