"""The resource ``live``: signals, events and the service at a glance; what pages ask for most."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from importlib.metadata import version
from typing import Any

import anyio
import orjson
from fastapi import APIRouter, Response, WebSocket, WebSocketDisconnect
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse
from pydantic import BaseModel

from server.jobs.job_store import Jobs
from server.live.live_reader import Client, Hub
from server.live.revisions import Revisions
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.errors import NotFoundError
from server.platform.http.route_parameters import TEXT, MachineQuery, OneMachine, ServiceDep, sends
from server.platform.resource import Parts, Resource
from server.platform.service import Service


class Status(BaseModel):
    """The service at a glance; a list need not be read again until its number in ``revisions`` moves."""

    version: str
    started: str
    revisions: dict[str, int]
    jobs: dict[str, int]
    acquisition: dict[str, dict[str, Any]]


class Overview:
    """The answer of ``/status``; jobs are counted anew only when one has changed.

    Parameters
    ----------
    started : when the service did
    """

    def __init__(self, revisions: Revisions, jobs: Jobs, acquisition: Acquisition, started: str) -> None:
        self._revisions = revisions
        self._jobs = jobs
        self._acquisition = acquisition
        self._started = started
        self._version = version("hilfit")
        self._counting = asyncio.Lock()
        self._counted: tuple[int, dict[str, int]] = 0, {}

    async def status(self) -> Status:
        """Return the service's present state."""
        revisions = await self._revisions.current()
        number = revisions.get("jobs", 0)  # 0: there never was one
        if self._counted[0] < number:
            async with self._counting:  # one of those who ask counts for all who asked before it began
                if self._counted[0] < number:
                    newest = (await self._revisions.current()).get("jobs", 0)
                    self._counted = newest, await run_in_threadpool(self._jobs.counts)
        acquisition = self._acquisition
        return Status(
            version=self._version,
            started=self._started,
            revisions=dict(revisions),
            jobs=self._counted[1],
            acquisition={name: acquisition.statistics(name) for name in acquisition.names()},
        )


live_router = APIRouter(prefix="/live", tags=["live"], route_class=TypedRoute)
#: Outside ``live_router``: a WebSocket's guard is another one than that of requests.
socket_router = APIRouter(prefix="/live", tags=["live"], route_class=TypedRoute)
SUBPROTOCOL = "hilfit.v1"
#: Close codes (RFC 6455 section 7.4, IANA): going away; policy; try again later.
GOING_AWAY, POLICY, TRY_AGAIN = 1001, 1008, 1013
_FRAMES = {"schema": {"type": "object", "additionalProperties": {"type": "object", "additionalProperties": True}}}


@live_router.get("", **sends({"application/json": _FRAMES}, 404, 409, 422, 503), dependencies=[require("read")])
async def snapshot(service: ServiceDep, principal: PrincipalDep, machine: MachineQuery = None) -> Response:
    """Return the newest values, with quality and age, of one machine or of all, by machine name."""
    if machine is not None:
        await run_in_threadpool(service[Machines].get, machine)
    # A look into shared memory: a thread for it would take longer than it does.
    content = principal.visible(service[Acquisition].newest(machine))
    return Response(orjson.dumps(content), media_type="application/json")


@socket_router.websocket("/stream", dependencies=[require("read")])
async def stream(socket: WebSocket, machine: OneMachine) -> None:
    """Stream every sample of one machine, ten messages a second: a snapshot, then frames and heartbeats.

    What the client sends is not read. It is closed with 1013 when it does not keep up, 1001 when the service stops.
    """
    service = socket.app.state.service
    assert isinstance(service, Service)
    offered = socket.scope.get("subprotocols", [])
    await socket.accept(subprotocol=SUBPROTOCOL if SUBPROTOCOL in offered else None)
    try:
        await run_in_threadpool(service[Machines].get, machine)
    except NotFoundError:
        await socket.close(POLICY, "there is no such machine")
        return
    client = Client()
    with service[Hub].client(machine, client):
        async with anyio.create_task_group() as group:

            async def run(work: Callable[[], Awaitable[object]]) -> None:
                await work()
                group.cancel_scope.cancel()  # the first that ends ends all

            for work in (partial(_send, socket, client), partial(_receive, socket), client.dropped.wait):
                group.start_soon(run, work)
    if client.dropped.is_set():
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # it may be gone by itself
            await socket.close(GOING_AWAY if service.changes.closed else TRY_AGAIN)


async def _send(socket: WebSocket, client: Client) -> None:
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            await socket.send_text(await client.next())


async def _receive(socket: WebSocket) -> None:
    """Return when the client has gone; nothing that it sends has any effect."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass


status_router = APIRouter(prefix="/status", tags=["status"], route_class=TypedRoute)


@status_router.get("", response_model=Status, dependencies=[require("read")])
async def status(service: ServiceDep, principal: PrincipalDep) -> Response:
    """Return revision counters, jobs and acquisition."""
    found = await service[Overview].status()
    found = found.model_copy(update={"acquisition": principal.visible(found.acquisition)})
    # Serialised once, by pydantic's own serialiser; FastAPI would validate it again and build dictionaries of it first.
    return Response(found.model_dump_json(), media_type="application/json")


event_router = APIRouter(prefix="/events", tags=["events"], route_class=TypedRoute)


@event_router.get("", **sends({"text/event-stream": TEXT}), dependencies=[require("read")])
async def events(service: ServiceDep) -> StreamingResponse:
    """Follow the revision counters of ``/status``: all of them at first, then each when it moves.

    The data of an event is ``{"resource": ..., "revision": ...}``; a comment each ten seconds says that the connection
    lives.
    """
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_lines(service), media_type="text/event-stream", headers=headers)


async def _lines(service: Service) -> AsyncIterator[bytes]:
    async for change in service[Revisions].follow():
        if change is None:
            yield b": alive\n\n"
        else:
            content = json.dumps({"resource": change[0], "revision": change[1]})
            yield f"data: {content}\n\n".encode()


def _revisions(parts: Parts) -> Revisions:
    database = parts[Database]

    async def read() -> dict[str, int]:
        return await run_in_threadpool(database.revisions)

    return Revisions(parts[Changes], read, own=database.own_revisions)


LIVE = Resource(
    name="live",
    routers=(status_router, live_router, socket_router, event_router),
    provides={
        Hub: lambda parts: Hub(parts[Acquisition], lambda: parts[Changes].closed),
        Revisions: _revisions,
        Overview: lambda parts: Overview(parts[Revisions], parts[Jobs], parts[Acquisition], parts[Database].now()),
    },
)
