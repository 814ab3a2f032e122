"""A service whose stages, acquisition and recorder are small fakes; everything else is the real thing."""

from __future__ import annotations

import asyncio
import atexit
import getpass
import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fake_stages import REPORT, STAGES
from starlette.testclient import TestClient

from daq import Machine, parse_machine, write_recording
from daq.acquisition.acquisition import AcquisitionStatistics
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.errors import AcquisitionError
from daq.frames.frame import Frame, row_dtype
from server.composition.app import create_app
from server.composition.declarations import RESOURCES
from server.identifications.identification_job import StageProgram
from server.identifications.identification_order import IdentificationOrders, Wish
from server.identifications.identification_resource import STAGE_PROGRAM
from server.identifications.identification_store import Identification
from server.jobs.job_store import Jobs
from server.machines.machine_resource import LAUNCH
from server.platform.processes import children
from server.platform.processes.file_children import FileChildren
from server.platform.resource import Key, Resource
from server.platform.service import Service
from server.platform.settings import Settings
from server.recordings.recording_resource import RECORDER
from server.recordings.recording_sessions import RecordOrder
from server.valves.valve_resource import VALVE_PROGRAM

__all__ = ["REPORT"]
API = "/api/v1"
#: An administrator who lets machines be acquired from wherever their files say.
ANY_PLACE = ("can:*:*", "serial:*", "tcp:0.0.0.0/0:*", "driver:*")
#: One joint driven directly: the smallest machine that can be acquired and identified.
MACHINE = """\
schema: hilfit/machine/1
name: lever
rate_hz: 50
gravity: [0.0, -9.81, 0.0]
joints:
  - name: joint1
    type: revolute
    dh: {a: 1.0, alpha: 0.0, d: 0.0, theta: 0.0}
    limits: {position: [-1.0, 1.0], velocity: 1.0, acceleration: 2.0}
channels:
  - name: joint1.angle
    quantity: joint_position
    joint: joint1
    unit: deg
    source: {bus: can, node: 1, object: 0x6004, data_type: int32}
  - name: joint1.torque
    quantity: joint_effort
    joint: joint1
    unit: N m
    source: {bus: can, node: 2, object: 0x6130, data_type: float32}
buses:
  - {name: can, type: canopen, interface: virtual, channel: tests}
"""


def motion(seconds: float, seed: int = 1) -> tuple[np.ndarray[Any, Any], dict[str, np.ndarray[Any, Any]]]:
    """Time and SI values of a plausible recording of :data:`MACHINE`."""
    time = np.arange(round(seconds * 50)) / 50
    angle = 0.5 * np.sin(2 * np.pi * (0.2 + 0.05 * seed) * time)
    noise = np.random.default_rng(seed).normal(0, 1e-3, (2, len(time)))
    return time, {"joint1.angle": angle + noise[0] * 0.1, "joint1.torque": 20 * np.cos(angle) + noise[1]}


def recording_bytes(directory: Path, role: str = "train", suffix: str = ".csv", seconds: float = 10) -> bytes:
    """A file as a client would upload it."""
    time, values = motion(seconds)
    path = write_recording(directory / f"made{suffix}", parse_machine(MACHINE), role, time, values)
    return path.read_bytes()


class FakeFeed:
    """An acquisition that wrote one frame into a real ring buffer and now stands still."""

    def __init__(self, ring_name: str) -> None:
        self.ring_name = ring_name
        self.alive = True
        writer = RingWriter(ring_name)
        frame = Frame(
            cycle=7,
            monotonic_ns=1,
            utc_ns=2,
            time=0.14,
            values=np.array([np.pi / 6, np.nan]),
            ages=np.array([0.001, np.nan]),
            quality=np.array([0, 2], dtype=np.uint8),
        )
        writer.write(frame)
        writer.close()

    def check(self) -> None:
        if not self.alive:
            raise AcquisitionError("the bus went away")

    def statistics(self) -> AcquisitionStatistics:
        return AcquisitionStatistics(state="running", cycles=1)


class FakeAcquisition:
    """Launches fake feeds; a test makes the next launches fail, or a running feed die."""

    def __init__(self) -> None:
        self.failures: list[str] = []
        self.feeds: list[FakeFeed] = []
        self.ended = 0
        self.up = threading.Event()

    @contextmanager
    def __call__(self, machine: Machine) -> Iterator[FakeFeed]:
        if self.failures:
            raise AcquisitionError(self.failures.pop(0))
        with ring_buffer(row_dtype(len(machine.channels)), 16) as name:
            feed = FakeFeed(name)
            self.feeds.append(feed)
            self.up.set()
            try:
                yield feed
            finally:
                self.ended += 1


class FakeRecorder:
    """Records made-up motion once stopped; a file ``<id>.journal`` is what a killed recorder leaves."""

    def __init__(self) -> None:
        self.fail: str | None = None

    def record(self, order: RecordOrder) -> dict[str, Any]:
        order.report({"rows": 1})
        if order.seconds is None:
            assert order.stop.wait(30)
        if self.fail is not None:
            raise AcquisitionError(self.fail)
        time, values = motion(10)
        write_recording(order.path, order.machine, order.role, time, values)
        return {"rows": len(time)}

    def recover(self, directory: Path) -> dict[Path, int]:
        found = {}
        for journal in directory.glob("*.journal"):
            time, values = motion(10)
            path = journal.with_suffix(".parquet")
            write_recording(path, parse_machine(MACHINE), "train", time, values)
            journal.unlink()
            found[path] = len(time)
        return found


@cache
def file_children() -> FileChildren:
    """What looks at uploads, one for all services of this process: it takes two seconds to load."""
    room = Path(tempfile.gettempdir(), f"pytest-of-{getpass.getuser()}")  # the directories of all services are in it
    room.mkdir(mode=0o700, exist_ok=True)
    shared = FileChildren(room=room)
    atexit.register(shared.close)
    return shared


class Fakes:
    """The fakes behind a service."""

    def __init__(self) -> None:
        self.acquisition = FakeAcquisition()
        self.recorder = FakeRecorder()
        script = Path(__file__).with_name("fake_stages.py")
        self.parts: dict[Key, Any] = {
            STAGE_PROGRAM: lambda: StageProgram(STAGES, (sys.executable, str(script))),
            VALVE_PROGRAM: lambda: StageProgram(("valve",), (sys.executable, str(script))),
            LAUNCH: self.acquisition,
            RECORDER: self.recorder,
            FileChildren: file_children(),
        }


class Running:
    """A service that runs, a client of it, and the fakes behind it."""

    def __init__(self, service: Service, client: TestClient, fakes: Fakes) -> None:
        self.service = service
        self.client = client
        self.fakes = fakes
        self._chosen: list[dict[str, str]] = []

    def upload(self, content: bytes, role: str, name: str = "made.csv") -> str:
        response = self.client.post(
            f"{API}/recordings/upload",
            params={"machine": "lever", "role": role, "name": name},
            content=content,
        )
        assert response.status_code == 201, response.text
        return str(response.json()["id"])

    def choices(self, content: bytes) -> list[dict[str, str]]:
        """Two recordings to identify from; they are uploaded the first time."""
        if not self._chosen:
            self.client.post(f"{API}/machines", content=MACHINE)
            self._chosen = [{"id": self.upload(content, role)} for role in ("train", "validate")]
        return self._chosen

    def order(self, content: bytes, **options: Any) -> Identification:
        """Order an identification, past the check of its options: they steer the fake stages."""
        recordings = tuple((choice["id"], None) for choice in self.choices(content))
        return self.service[IdentificationOrders].order(Wish("lever", recordings, options, ""), None)

    def follow(self, job: str, until: Callable[[dict[str, Any]], bool] = lambda event: False) -> list[dict[str, Any]]:
        """Events of a job until it ends or ``until`` is true."""
        seen: list[dict[str, Any]] = []
        after = 0
        while True:
            number = self.service.changes.number
            for event in self.service[Jobs].events(job, after):
                after = event.number
                seen.append(event.__dict__)
                if event.state in ("done", "failed", "cancelled") or until(event.__dict__):
                    return seen
            assert wait_for_change(self.service, number), f"{job} stands still at {seen[-1:]}"


def wait_for_change(service: Service, number: int, timeout: float = 60) -> bool:
    """Wait, in a thread without an event loop of its own, until the store changed after ``number``."""
    return asyncio.run(service.changes.wait(number, timeout))


#: What children of a service that is not tested have.
NICENESS = children.NICENESS


@contextmanager
def children_as_important_as_tests() -> Iterator[None]:
    """Children of a service are as important as the test that waits for them: the last has no turn beside others."""
    kept = children.NICENESS, children.SESSION_NICENESS
    children.NICENESS, children.SESSION_NICENESS = os.getpriority(os.PRIO_PROCESS, 0), 0
    try:
        yield
    finally:
        children.NICENESS, children.SESSION_NICENESS = kept


@contextmanager
def running_service(
    data_dir: Path, fakes: Fakes, *, resources: Sequence[Resource] = RESOURCES, **settings: Any
) -> Iterator[Running]:
    settings = {"bus_places": ANY_PLACE, **settings}
    with children_as_important_as_tests():
        service = Service(Settings(data_dir=data_dir, **settings), resources, fakes.parts)
        try:
            service.start()
            with TestClient(create_app(service), "http://127.0.0.1:8350", raise_server_exceptions=False) as client:
                yield Running(service, client, fakes)
        finally:
            service.stop()


def ran(running: Running, identification: str) -> list[str]:
    """Stages that really ran, in order."""
    path = running.service.files.identifications / identification / "ran.txt"
    return [line.split()[0] for line in path.read_text().splitlines()]


def read_json(path: Path) -> Any:
    return json.loads(path.read_text())
