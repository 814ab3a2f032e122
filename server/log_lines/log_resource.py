"""The resource ``log_lines``: the newest lines of the log."""

from __future__ import annotations

import json
import logging
import threading
from collections import deque
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel

from server.platform.authorization.guard import TypedRoute, require
from server.platform.http.bodies import Shown
from server.platform.http.route_parameters import Limit, ServiceDep, problems
from server.platform.logs import json_lines
from server.platform.resource import Phase, Resource, Running

#: Lines that are kept, and characters of one: a trace of an error may be long.
MOST, LONGEST = 5000, 20_000
_OWN = ("timestamp", "level", "logger", "event")


class LogLine(Shown):
    """A line of the log; ``detail`` is what it says beside time, level, logger and event."""

    number: int  # from 1 since the start of the service
    time: str
    level: str
    logger: str
    event: str
    detail: dict[str, Any]


class LogMemory(logging.Handler):
    """Keeps the newest lines as :mod:`server.platform.logs` writes them: what is secret is hidden in them, too.

    Parameters
    ----------
    most : lines that are kept
    """

    def __init__(self, most: int = MOST) -> None:
        super().__init__()
        self.setFormatter(json_lines())
        self._lines: deque[LogLine] = deque(maxlen=most)
        self._count = 0
        self._guard = threading.Lock()

    def start(self) -> None:
        """Listen to every record of this process."""
        logging.getLogger().addHandler(self)

    def stop(self) -> None:
        """Listen no more; what was received remains."""
        logging.getLogger().removeHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record."""
        try:
            content = json.loads(self.format(record))
            detail = {name: _short(value) for name, value in content.items() if name not in _OWN}
            time, level, logger, event = (str(content.get(name, "")) for name in _OWN)
        except Exception:  # as every handler does: a line that cannot be written must not stop who wrote it
            self.handleError(record)
            return
        with self._guard:
            self._count += 1
            line = LogLine(
                number=self._count, time=time, level=level, logger=logger, event=_short(event), detail=detail
            )
            self._lines.append(line)

    def after(self, number: int, limit: int, least: int = logging.NOTSET, containing: str = "") -> tuple[LogLine, ...]:
        """Return lines after line ``number``, oldest first: the newest ``limit`` of them.

        Parameters
        ----------
        least : least severe level, as the standard library counts them
        containing : a part of the line, in whatever case
        """
        with self._guard:
            lines = [line for line in self._lines if line.number > number]
        wanted = containing.casefold()
        known = logging.getLevelNamesMapping()
        found = [
            line
            for line in lines
            if known.get(line.level.upper(), logging.CRITICAL) >= least and (not wanted or wanted in _text(line))
        ]
        return tuple(found[-limit:])

    @property
    def count(self) -> int:
        """Number of the newest line; 0 before the first."""
        with self._guard:
            return self._count


def _short(value: Any) -> Any:
    return f"{value[:LONGEST]} …" if isinstance(value, str) and len(value) > LONGEST else value


def _text(line: LogLine) -> str:
    return f"{line.logger} {line.event} {json.dumps(line.detail, ensure_ascii=False)}".casefold()


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


LOG_LINES = Resource(
    name="log_lines",
    routers=(router,),
    provides={LogMemory: lambda parts: LogMemory()},
    running=lambda parts: [Running(Phase.RECOVERY, parts[LogMemory].start, parts[LogMemory].stop)],
)
