"""The resource ``log_lines``: the newest lines of the log."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel

from server.log_lines.log_memory import LogLine, LogMemory
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import Limit, ServiceDep, problems
from server.platform.parts import Parts
from server.platform.resource import Phase, Resource, Running


class LogLines(BaseModel):
    """Lines, oldest first; ``newest``: number of the newest line there is, to go on from."""

    items: list[LogLine]
    newest: int


router = APIRouter(
    prefix="/logs", tags=["logs"], dependencies=[require("admin", every_machine=True)], route_class=TypedRoute
)
Level = Literal["debug", "info", "warning", "error", "critical"]


@router.get("", responses=problems(422))
def log_lines(
    service: ServiceDep,
    after: Annotated[int, Query(ge=0, le=2**53, description="Number of the last line seen; 0: all that are kept")] = 0,
    level: Annotated[Level, Query(description="Least severe level")] = "info",
    containing: Annotated[str, Query(max_length=200, description="A part of the line, in whatever case")] = "",
    limit: Limit = 200,
) -> LogLines:
    """Return the newest lines of the service's log since its start, oldest first; workers have their own."""
    memory = service[LogMemory]
    newest = memory.count
    lines = memory.after(after, limit, logging.getLevelNamesMapping()[level.upper()], containing)
    return LogLines(items=[*lines], newest=max(newest, *(line.number for line in lines), 0))


def _running(parts: Parts) -> Iterator[Running]:
    memory = parts[LogMemory]
    yield Running(Phase.RECOVERY, memory.start, memory.stop)


LOG_LINES = Resource(
    name="log_lines",
    routers=(router,),
    provides={LogMemory: lambda parts: LogMemory()},
    running=_running,
)
