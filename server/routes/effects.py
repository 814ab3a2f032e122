"""``/effects``: the physical effects that the loop knows."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from server.access.guard import require
from server.access.route import TypedRoute
from server.effects import effect, effects
from server.routes.common import problems

router = APIRouter(prefix="/effects", tags=["effects"], route_class=TypedRoute)


@router.get("", responses=problems(503), dependencies=[require("read")])
def list_effects() -> dict[str, list[dict[str, Any]]]:
    """List effects."""
    return {"items": effects()}


@router.get("/{id}", responses=problems(404, 422, 503), dependencies=[require("read")])
def get(id: str) -> dict[str, Any]:
    """Read an effect."""
    return effect(id)
