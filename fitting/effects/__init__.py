"""Physical effects that a rigid body with Stribeck friction lacks: the catalogue, one file each, called as the id.

The catalogue is whatever is in this folder, or in the entry-point group ``hilfit.effects``: a package of its own adds
an effect with one file, one line of TOML and one call of :func:`fitting.effects.conformance.check_effect`.
"""

from __future__ import annotations

from functools import lru_cache

from daq.seams import EFFECTS
from fitting.effects.base import DriveView, Effect, FoundBy, Parameter, Parity

__all__ = ["DriveView", "Effect", "FoundBy", "Parameter", "Parity", "effect", "effects", "line_effect"]


@lru_cache(maxsize=1)
def effects() -> tuple[Effect, ...]:
    """List all effects, sorted by id."""
    return EFFECTS.all(Effect)


def effect(name: str) -> Effect:
    """Return the effect with this id (KeyError if there is none)."""
    return {e.id: e for e in effects()}[name]


def line_effect() -> Effect:
    """Return the effect of a spectral line of the residual."""
    return next(e for e in effects() if e.found_by is FoundBy.LINES)
