"""What ``GET /logs`` gives."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from server.platform.http.bodies import Shown


class LogLine(Shown):
    """A line of the log; ``detail`` is what it says beside time, level, logger and event."""

    number: int
    time: str
    level: str
    logger: str
    event: str
    detail: dict[str, Any]


class LogLines(BaseModel):
    """Lines, oldest first; ``newest``: number of the newest line there is, to go on from."""

    items: list[LogLine]
    newest: int
