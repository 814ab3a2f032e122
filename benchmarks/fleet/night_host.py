"""``night_host ORDER [NAME]``: a server with acquisition and recorder at speed, or a worker with light stages.

An acquisition is a ring buffer in which nothing changes; a recording waits for its time, divided by the order's speed,
and is then one that was simulated before, of the arm that the machine is, of that role and length. Schedules go by
the true clock until the file ``tomorrow`` is there beside the order, and then are a day ahead. Everything else is what
``hilfit serve`` and ``hilfit worker`` are.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from benchmarks.storm import stages
from daq import Machine
from daq.acquisition.acquisition import AcquisitionStatistics
from daq.acquisition.ring import ring_buffer
from daq.frames.frame import row_dtype
from server.composition.serve import serve
from server.composition.worker import work
from server.identifications.identification_job import StageProgram
from server.identifications.identification_resource import STAGE_PROGRAM
from server.machines.machine_resource import LAUNCH
from server.platform.processes.leaving import leave
from server.platform.resource import Key
from server.platform.settings import load_settings
from server.recordings.recording_resource import RECORDER
from server.recordings.recording_sessions import RecordOrder
from server.schedules.schedule_resource import CLOCK

#: Rows of a ring buffer in which nothing changes.
ROWS = 16
#: Where machines may be, though nothing is sent there.
PLACES = ("can:*:*", "tcp:127.0.0.0/8:*")


@dataclass(frozen=True)
class NightOrder:
    """The order of a host: its data directory, machine seconds per second, and where simulated recordings are."""

    data_dir: str
    speed: float
    recordings: str


class _StillFeed:
    """An acquisition whose ring buffer stands still."""

    alive = True

    def __init__(self, ring_name: str) -> None:
        self.ring_name = ring_name

    def check(self) -> None:
        """Pass; it never fails."""

    def statistics(self) -> AcquisitionStatistics:
        """Return what it counted."""
        return AcquisitionStatistics(state="running", cycles=1)


@contextmanager
def _launch(machine: Machine) -> Iterator[_StillFeed]:
    """Acquire a machine."""
    with ring_buffer(row_dtype(len(machine.channels)), ROWS) as name:
        yield _StillFeed(name)


class _QuickRecorder:
    """Records at speed; see the module."""

    def __init__(self, speed: float, recordings: Path) -> None:
        self._speed, self._recordings = speed, recordings

    def record(self, order: RecordOrder) -> dict[str, Any]:
        """Wait, and copy what was simulated."""
        assert order.seconds is not None
        order.stop.wait(order.seconds / self._speed)
        shutil.copyfile(made_file(self._recordings, order.machine.name, order.role, order.seconds), order.path)
        statistics = {"rows": round(order.seconds * order.machine.rate_hz)}
        order.report(statistics)
        return statistics

    def recover(self, directory: Path) -> Mapping[Path, int]:
        """Recover nothing: nothing is ever left behind, the server is not killed."""
        return {}


def made_file(directory: Path, machine: str, role: str, seconds: float) -> Path:
    """Locate the simulated recording of a machine; its name ends with the number of its arm."""
    return directory / f"{machine.rpartition('-')[2]}-{role}-{seconds:.0f}.parquet"


def _main(order_file: Path, worker: str | None) -> None:
    """Run until ordered to stop."""
    order = NightOrder(**json.loads(order_file.read_text(encoding="utf-8")))
    tomorrow = order_file.with_name("tomorrow")
    data_dir = order.data_dir if worker is None else order_file.parent / worker
    settings = load_settings(data_dir=data_dir, port=0, local_jobs=False, bus_places=PLACES)

    def clock() -> datetime:
        return datetime.now(UTC) + timedelta(days=tomorrow.is_file())

    def show(text: str) -> None:
        print(json.dumps({"url": text}), flush=True)

    command = (sys.executable, "-I", "-S", str(Path(stages.__file__)), "--idle")
    if worker is None:
        parts: dict[Key, Any] = {
            LAUNCH: _launch,
            RECORDER: _QuickRecorder(order.speed, Path(order.recordings)),
            CLOCK: clock,
        }
        serve(settings, show, parts)
    else:
        light: dict[Key, Any] = {STAGE_PROGRAM: lambda: StageProgram(stages.STAGES, command)}
        work(settings, worker, lambda: show(""), light)
    leave()


if __name__ == "__main__":
    _main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None)
