"""The physical effects that the loop knows, for people to read; loaded when first asked for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from server.platform.errors import NotFoundError

if TYPE_CHECKING:
    from fitting.effects import Effect


def effects() -> list[dict[str, Any]]:
    """All registered effects, sorted by id."""
    from fitting.effects import effects as registered

    return [_describe(entry) for entry in registered()]


def effect(id: str) -> dict[str, Any]:
    """One effect; NotFoundError if there is none of this id."""
    for entry in effects():
        if entry["id"] == id:
            return entry
    raise NotFoundError(f"there is no effect '{id}'; read the list of effects", effect=id)


def _describe(entry: Effect) -> dict[str, Any]:
    return {
        "id": entry.id,
        "title": entry.title,
        "level": entry.level,
        "equation": entry.equation,
        "parity": entry.dependence,
        "parameters": [
            {"name": p.name, "unit": p.unit, "low": _finite(p.low), "high": _finite(p.high)} for p in entry.parameters
        ],
        "confounders": list(entry.confounders),
        "experiment": entry.experiment,
        "look_at": entry.look_at,
        "source": entry.source,
        "machine_wide": entry.machine_wide,
    }


def _finite(bound: float) -> float | None:
    return bound if math.isfinite(bound) else None
