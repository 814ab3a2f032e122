"""``/workers``: the processes that run jobs, the server among them."""

from __future__ import annotations

import sqlalchemy as sa
from fastapi import APIRouter
from pydantic import BaseModel

from server.jobs.executors import Silence, executors, hosts
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep

router = APIRouter(prefix="/workers", tags=["jobs"], route_class=TypedRoute)


class WorkerResource(BaseModel):
    """A process that runs jobs.

    ``load``: processes that wanted to run on its host in the mean of the last minute. ``state``: works, or what it
    waits for. ``silent``: nothing was heard of it for so long that others go on with its jobs.
    """

    id: str
    host: str
    version: str
    cores: int
    load: float
    state: str
    heard: str
    silent: bool


class WorkerList(BaseModel):
    """All that were ever heard of, by name."""

    items: list[WorkerResource]
    next: None = None


@router.get("", dependencies=[require("read", every_machine=True)])
def list_workers(service: ServiceDep) -> WorkerList:
    """List the processes that run jobs; none where the service is alone."""
    query = sa.select(executors.c.host, hosts).join(hosts, hosts.c.id == executors.c.id).order_by(hosts.c.id)
    silence = service[Silence]
    with service.database.read() as connection:
        rows = [dict(row._mapping) for row in connection.execute(query)]
    return WorkerList(items=[WorkerResource(**row, silent=silence.silent(row["id"])) for row in rows])
