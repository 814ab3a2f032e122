"""The resource ``live``: signals, events and the service at a glance; what pages ask for most."""

from __future__ import annotations

from fastapi.concurrency import run_in_threadpool

from server.jobs.job_store import Jobs
from server.live import event_routes, live_routes, status_routes
from server.live.live_reader import Hub
from server.live.overview import Overview
from server.live.revisions import Revisions
from server.machines.acquisition import Acquisition
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.parts import Parts
from server.platform.resource import Resource


def _revisions(parts: Parts) -> Revisions:
    database = parts[Database]

    async def read() -> dict[str, int]:
        return await run_in_threadpool(database.revisions)

    return Revisions(parts[Changes], read, own=database.own_revisions)


def _overview(parts: Parts) -> Overview:
    return Overview(parts[Revisions], parts[Jobs], parts[Acquisition], parts[Database].now())


LIVE = Resource(
    name="live",
    routers=(status_routes.router, live_routes.router, live_routes.socket_router, event_routes.router),
    provides={
        Hub: lambda parts: Hub(parts[Acquisition], lambda: parts[Changes].closed),
        Revisions: _revisions,
        Overview: _overview,
    },
)
