"""``/logs``: what the service says of itself."""

from __future__ import annotations

import logging
from typing import Annotated, Literal

from fastapi import APIRouter, Query

from server.log_lines.log_memory import LogMemory
from server.log_lines.log_schemas import LogLine, LogLines
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.route_parameters import Limit, ServiceDep, problems

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
    """The newest lines of the service's log since its start, oldest first; workers have logs of their own."""
    memory = service[LogMemory]
    newest = memory.count
    lines = memory.after(after, limit, logging.getLevelNamesMapping()[level.upper()], containing)
    return LogLines(items=[LogLine.of(line) for line in lines], newest=max(newest, *(line.number for line in lines), 0))
