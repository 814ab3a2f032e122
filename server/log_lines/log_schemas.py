"""What ``GET /logs`` gives."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from server.log_lines.log_memory import Line


class LogLine(BaseModel):
    """A line of the log; ``detail`` is what it says beside time, level, logger and event."""

    number: int
    time: str
    level: str
    logger: str
    event: str
    detail: dict[str, Any]

    @classmethod
    def of(cls, line: Line) -> LogLine:
        """From memory."""
        return cls(**line.__dict__)


class LogLines(BaseModel):
    """Lines, oldest first; ``newest``: number of the newest line there is, to go on from."""

    items: list[LogLine]
    newest: int
