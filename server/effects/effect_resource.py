"""The resource ``effects``: the catalogue of physical effects."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from server.effects.effect_catalogue import effect, effects
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import problems
from server.platform.resource import Resource

router = APIRouter(prefix="/effects", tags=["effects"], route_class=TypedRoute)


@router.get("", responses=problems(503), dependencies=[require("read")])
def list_effects() -> dict[str, list[dict[str, Any]]]:
    """List effects."""
    return {"items": effects()}


@router.get("/{id}", responses=problems(404, 422, 503), dependencies=[require("read")])
def get(id: str) -> dict[str, Any]:
    """Read an effect."""
    return effect(id)


EFFECTS = Resource(name="effects", routers=(router,), of_no_machine=frozenset({"effects"}), kept={"/effects": ()})
