"""``/events``: which lists have changed, as server-sent events."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator

from fastapi import APIRouter
from fastapi.responses import StreamingResponse

from server.live.revisions import Revisions
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import ServiceDep
from server.platform.service import Service

router = APIRouter(prefix="/events", tags=["events"], route_class=TypedRoute)


@router.get(
    "",
    response_class=StreamingResponse,
    dependencies=[require("read")],
    responses={200: {"content": {"text/event-stream": {"schema": {"type": "string"}}}}},
)
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
