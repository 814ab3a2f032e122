"""A server, or a worker, as installed but for two things; :mod:`benchmarks.storm.clock` is the program.

Its identifications run the light stages of :mod:`benchmarks.storm.stages`, and its schedules go by a quick clock, so
that a slot comes every few seconds. Acquisition, recorder, store, jobs and HTTP are those of ``hilfit serve``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from benchmarks.storm import stages
from server.composition.serve import serve
from server.composition.worker import work
from server.identifications.identification_job import StageProgram
from server.identifications.identification_resource import STAGE_PROGRAM
from server.platform.processes.leaving import leave
from server.platform.resource import Key
from server.platform.settings import Settings
from server.schedules.schedule_resource import CLOCK

#: Seconds of the schedules' clock per second: a slot every five minutes comes every five seconds.
HASTE = 60.0


@dataclass(frozen=True)
class HostOrder:
    """The order of a host.

    Attributes
    ----------
    storage_url : where workers, each with a directory of its own beside the order, find what they work on
    began : when the schedules' clock began to run quickly (ISO 8601)
    """

    data_dir: str
    database_url: str | None
    storage_url: str | None
    began: str


def worker_directory(order: Path, worker: str) -> Path:
    """Return the data directory of a worker."""
    return order.with_name(f"{worker}-files")


def _quick(began: datetime, now: datetime, wrong_s: float) -> datetime:
    """Compute the schedules' clock, from the true time and the wall clock's error."""
    return (began + HASTE * (now - began) if now > began else now) + timedelta(seconds=wrong_s)


def main(order: Path, worker: str | None, wrong_s: Callable[[], float]) -> None:
    """Run until ordered to stop.

    Parameters
    ----------
    wrong_s : s by which the wall clock is wrong now
    """
    content = HostOrder(**json.loads(order.read_text(encoding="utf-8")))
    began = datetime.fromisoformat(content.began)
    settings = Settings(
        data_dir=Path(content.data_dir) if worker is None else worker_directory(order, worker),
        database_url=content.database_url,
        storage_url=content.storage_url,
        port=0,
        bus_places=("can:*:*", "tcp:127.0.0.0/8:*"),
    )

    command = (sys.executable, "-I", "-S", str(Path(stages.__file__)))
    parts: dict[Key, Any] = {
        STAGE_PROGRAM: lambda: StageProgram(stages.STAGES, command),
        CLOCK: lambda: _quick(began, datetime.now(UTC), wrong_s()),
    }

    def show(text: str) -> None:
        print(text, flush=True)

    if worker is None:
        serve(settings, show, parts)
    else:
        work(settings, worker, lambda: show("ready"), parts)
    leave()
