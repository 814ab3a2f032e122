"""``/live``: the newest frame of each machine, and a WebSocket with every sample of one."""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable
from functools import partial

import anyio
import orjson
from fastapi import APIRouter, Response, WebSocket, WebSocketDisconnect
from fastapi.concurrency import run_in_threadpool

from server.live.live_client import Client
from server.live.live_reader import Hub
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import NotFoundError
from server.platform.http.route_parameters import MachineQuery, OneMachine, ServiceDep, problems
from server.platform.service import Service

router = APIRouter(prefix="/live", tags=["live"], route_class=TypedRoute)
#: Outside ``router``: a WebSocket's guard is another one than that of requests.
socket_router = APIRouter(prefix="/live", tags=["live"], route_class=TypedRoute)
SUBPROTOCOL = "hilfit.v1"
#: Close codes (RFC 6455 section 7.4, IANA): going away; policy; try again later.
GOING_AWAY, POLICY, TRY_AGAIN = 1001, 1008, 1013
_FRAMES = {"type": "object", "additionalProperties": {"type": "object", "additionalProperties": True}}


@router.get(
    "",
    response_class=Response,
    responses={200: {"content": {"application/json": {"schema": _FRAMES}}}, **problems(404, 409, 422, 503)},
    dependencies=[require("read")],
)
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
