"""Physical effects that a rigid body with Stribeck friction lacks: the catalogue, one file each.

The catalogue is whatever is registered under the entry-point group ``hilfit.effects``; a package of its own adds an
effect with one file, one line of TOML and one call of :func:`fitting.effects.conformance.check_effect`.
"""

from __future__ import annotations

from functools import lru_cache

from daq.seams import EFFECTS
from fitting.effects.base import DriveView, Effect, Parameter

__all__ = ["DriveView", "Effect", "Parameter", "effect", "effects"]


@lru_cache(maxsize=1)
def effects() -> tuple[Effect, ...]:
    """All registered effects, sorted by id."""
    return EFFECTS.all(Effect)


def effect(name: str) -> Effect:
    """The effect with this id (KeyError if there is none)."""
    return {e.id: e for e in effects()}[name]
