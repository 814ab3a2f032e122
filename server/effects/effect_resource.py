"""The resource ``effects``: the catalogue of physical effects."""

from __future__ import annotations

from server.effects.effect_routes import router
from server.platform.resource import Resource

EFFECTS = Resource(name="effects", routers=(router,), of_no_machine=frozenset({"effects"}), kept={"/effects": ()})
