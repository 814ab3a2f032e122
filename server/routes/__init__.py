"""Routes of the REST interface, one file per resource; :data:`ROUTERS` lists them all."""

from server.routes import (
    access,
    alarms,
    audit,
    backups,
    calibrations,
    effects,
    events,
    excitations,
    identifications,
    jobs,
    live,
    machines,
    monitor,
    recalibrations,
    recordings,
    schedules,
    status,
)

#: Routes are tried in this order, one after the other: what pages ask for most comes first.
ROUTERS = (
    status.router,
    live.router,
    live.socket_router,
    events.router,
    machines.router,
    monitor.router,
    recordings.router,
    identifications.router,
    excitations.router,
    schedules.router,
    recalibrations.router,
    calibrations.router,
    calibrations.machine_router,
    backups.router,
    jobs.router,
    effects.router,
    alarms.router,
    access.router,
    audit.router,
)

__all__ = ["ROUTERS"]
