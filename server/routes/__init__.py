"""Routes of the REST interface, one file per resource; :data:`ROUTERS` lists them all."""

from server.routes import effects, identifications, jobs, live, machines, recordings, status

ROUTERS = (
    machines.router,
    recordings.router,
    identifications.router,
    jobs.router,
    effects.router,
    live.router,
    status.router,
)

__all__ = ["ROUTERS"]
