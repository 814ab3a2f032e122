"""The resource ``effects``: the catalogue of physical effects."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fastapi import APIRouter

from server.platform.authorization.guard import TypedRoute, require
from server.platform.errors import NotFoundError
from server.platform.http.bodies import finite
from server.platform.http.route_parameters import problems
from server.platform.resource import Resource

if TYPE_CHECKING:
    from fitting.effects import Effect


def effects() -> list[dict[str, Any]]:
    """List all registered effects, sorted by id."""
    from fitting.effects import effects as registered

    return [_describe(entry) for entry in registered()]


def effect(id: str) -> dict[str, Any]:
    """Return one effect; NotFoundError if there is none of this id."""
    for entry in effects():
        if entry["id"] == id:
            return entry
    raise NotFoundError("server.no_effect", id=id).about(effect=id)


def _describe(entry: Effect) -> dict[str, Any]:
    return {
        "id": entry.id,
        "title": entry.title,
        "level": entry.level,
        "equation": entry.equation,
        "parity": entry.dependence,
        "parameters": [
            {"name": p.name, "unit": p.unit, "low": finite(p.low), "high": finite(p.high)} for p in entry.parameters
        ],
        "confounders": list(entry.confounders),
        "experiment": entry.experiment,
        "look_at": entry.look_at,
        "source": entry.source,
        "machine_wide": entry.machine_wide,
    }


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
