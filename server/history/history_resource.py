"""The resource ``history``: what happened to a machine."""

from __future__ import annotations

from server.alarms.alarm_desk import Alarms
from server.history.found_effects import FoundEffects
from server.history.history_routes import router
from server.history.machine_history import MachineHistory
from server.identifications.identification_results import IdentificationResults
from server.platform.database.engine import Database
from server.platform.resource import Resource

HISTORY = Resource(
    name="history",
    routers=(router,),
    provides={
        FoundEffects: lambda parts: FoundEffects(parts[IdentificationResults]),
        MachineHistory: lambda parts: MachineHistory(parts[Database], parts[Alarms], parts[FoundEffects]),
    },
)
