"""The resource ``bus_checks``: what the buses of an acquired machine bring, looked at when somebody asks."""

from __future__ import annotations

from server.bus_checks.bus_check import BusChecks
from server.bus_checks.bus_check_routes import router
from server.machines.acquisition import Acquisition
from server.platform.resource import Resource

BUS_CHECKS = Resource(
    name="bus_checks",
    routers=(router,),
    provides={BusChecks: lambda parts: BusChecks(parts[Acquisition])},
)
