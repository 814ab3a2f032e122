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
    recordings,
    schedules,
    status,
)

ROUTERS = (
    machines.router,
    monitor.router,
    recordings.router,
    identifications.router,
    excitations.router,
    schedules.router,
    calibrations.router,
    calibrations.machine_router,
    backups.router,
    jobs.router,
    effects.router,
    alarms.router,
    live.router,
    live.socket_router,
    events.router,
    status.router,
    access.router,
    audit.router,
)

__all__ = ["ROUTERS"]
