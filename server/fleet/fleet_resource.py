"""The resource ``fleet``: all machines at a glance."""

from __future__ import annotations

from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import Calibrations
from server.fleet.fleet_routes import router
from server.fleet.fleet_view import FleetView
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.monitor.monitor_supervisor import Monitors
from server.platform.resource import Resource

FLEET = Resource(
    name="fleet",
    routers=(router,),
    provides={
        FleetView: lambda parts: FleetView(
            parts[Machines], parts[Acquisition], parts[Monitors], parts[Calibrations], parts[Alarms]
        )
    },
)
