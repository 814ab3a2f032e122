"""The resource ``recordings``: recorded here or uploaded, kept as files that never change."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import sqlalchemy as sa
from prometheus_client.core import GaugeMetricFamily, Metric

from server.machines.acquisition import Acquisition
from server.machines.machine_desk import BEING_RECORDED
from server.platform.database.engine import Database
from server.platform.disk import Free, free_bytes
from server.platform.files import DataDirectory
from server.platform.parts import PartName, Parts
from server.platform.processes.file_children import FileChildren
from server.platform.resource import BackedUp, NamedFiles, Phase, Resource, Running
from server.recordings.formats.exports import Exports
from server.recordings.recording_routes import router
from server.recordings.recording_sessions import Recorder, Sessions
from server.recordings.recording_store import Recordings, recordings
from server.recordings.recording_uploads import RecordingUploads
from server.recordings.ring_recorder import RingRecorder

RECORDER: PartName[Recorder] = PartName("what records")
#: Bytes that are free for recordings.
FREE: PartName[Free] = PartName("free bytes for recordings")


def _sessions(parts: Parts) -> Sessions:
    return Sessions(parts[Database], parts[DataDirectory], parts[Acquisition], parts[RECORDER], parts[FREE])


def _being_recorded(parts: Parts) -> Callable[[str], str | None]:
    def recording(machine: str) -> str | None:
        found = parts[Recordings].list(1, machine=machine, state="recording").items
        return found[0].id if found else None

    return recording


def _running(parts: Parts) -> Iterator[Running]:
    yield Running(Phase.RECOVERY, start=parts[Sessions].recover)
    yield Running(Phase.RECORDING, stop=parts[Sessions].stop_all)


def _files(connection: sa.Connection) -> NamedFiles:
    needed: set[str] = set()
    others: set[str] = set()
    for row in connection.execute(sa.select(recordings.c.id, recordings.c.format, recordings.c.state)):
        (needed if row.state == "sealed" else others).add(f"recordings/{row.id}.{row.format}")
        others.add(f"recordings/{row.id}.statistics.json")
    return NamedFiles(frozenset(needed), frozenset(others))


def _metrics(parts: Parts) -> Iterator[Metric]:
    text = "Bytes that are free for recordings."
    yield GaugeMetricFamily("hilfit_disk_free_bytes", text, value=parts[FREE]())


RECORDINGS = Resource(
    name="recordings",
    routers=(router,),
    tables=(recordings,),
    of_a_machine={"recordings": recordings},
    kept={"/recordings": ("recordings",)},
    large_uploads=frozenset({"/recordings/upload"}),
    provides={
        RECORDER: lambda parts: RingRecorder(),
        FREE: lambda parts: partial(free_bytes, parts[DataDirectory].recordings),
        BEING_RECORDED: _being_recorded,
        Recordings: lambda parts: Recordings(parts[Database]),
        Exports: lambda parts: Exports(parts[DataDirectory], parts[FileChildren]),
        RecordingUploads: lambda parts: RecordingUploads(
            parts[Database], parts[DataDirectory], parts[FileChildren], parts[FREE]
        ),
        Sessions: _sessions,
    },
    running=_running,
    backed_up=BackedUp("recordings", _files, unchanging=True),
    metrics=_metrics,
)
