"""The resource ``log_lines``: the newest lines of the log."""

from __future__ import annotations

from collections.abc import Iterator

from server.log_lines.log_memory import LogMemory
from server.log_lines.log_routes import router
from server.platform.parts import Parts
from server.platform.resource import Phase, Resource, Running


def _running(parts: Parts) -> Iterator[Running]:
    memory = parts[LogMemory]
    yield Running(Phase.RECOVERY, memory.start, memory.stop)


LOG_LINES = Resource(
    name="log_lines",
    routers=(router,),
    provides={LogMemory: lambda parts: LogMemory()},
    running=_running,
)
