"""``/live``: the newest frame of each machine that is acquired."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query

from server.routes.common import ServiceDep, problems

router = APIRouter(prefix="/live", tags=["live"])


@router.get("", responses=problems(404, 422, 503))
def snapshot(
    service: ServiceDep, machine: Annotated[str | None, Query(max_length=80)] = None
) -> dict[str, dict[str, Any]]:
    """The newest values, with quality and age, of one machine or of all, by machine name."""
    return service.live(machine)
