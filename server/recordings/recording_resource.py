"""The resource ``recordings``: recorded here or uploaded, kept as files that never change."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import sqlalchemy as sa
from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse
from prometheus_client.core import GaugeMetricFamily, Metric
from pydantic import BaseModel, Field
from starlette.background import BackgroundTask

from daq.acquisition import recorder as ring_recorder
from daq.acquisition.journal import recover
from daq.errors import AcquisitionError
from server.machines.acquisition import Acquisition
from server.machines.machine_desk import BEING_RECORDED
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.authorization.named_things import MachineName
from server.platform.database.engine import Database
from server.platform.files import DataDirectory, Free, free_bytes, receive
from server.platform.http.bodies import PLAIN, Body, Label, Listed
from server.platform.http.route_parameters import (
    BYTES,
    Idempotency,
    MachineQuery,
    OneMachine,
    PageDep,
    ServiceDep,
    problems,
    sends,
    takes,
)
from server.platform.processes.file_children import FileChildren
from server.platform.resource import BackedUp, NamedFiles, PartName, Parts, Phase, Resource, Running
from server.recordings.formats.exports import FORMATS, Exports, Format
from server.recordings.recording_sessions import Recorder, RecordOrder, Sessions
from server.recordings.recording_store import RecordingRole, RecordingRow, Recordings, State, recordings
from server.recordings.recording_uploads import RecordingUploads


class RecordingStart(
    Body,
    json_schema_extra={"examples": [{"machine": "folding-arm", "role": "train", "label": "morning", "seconds": 60}]},
):
    """Start recording a machine that is being acquired; without ``seconds`` until it is stopped."""

    machine: MachineName
    role: RecordingRole
    label: Label = ""
    seconds: Annotated[float, Field(gt=0, le=86400)] | None = None


class RecordingResource(RecordingRow):
    """A recording; ``statistics`` count rows, gaps and what the acquisition lost while it ran."""


class RecordingList(Listed[RecordingResource]):
    """A page of recordings."""


class ChannelStatistics(BaseModel):
    """One channel in the unit of the file; null where no value is finite."""

    minimum: float | None
    maximum: float | None
    mean: float | None
    std: float | None
    missing: int
    quality: dict[str, int]


class RecordingStatistics(BaseModel):
    """A recording's rows, its time in s, its gaps (steps of more than one and a half periods), and its channels."""

    rows: int
    seconds: float
    rate_hz: float
    gaps: int
    channels: dict[str, ChannelStatistics]


#: Seconds between two looks at whether a recording should stop.
LOOK_S = 0.2


class RingRecorder:
    """Records from the ring buffer of a running acquisition (:class:`daq.acquisition.recorder.Recorder`)."""

    def record(self, order: RecordOrder) -> dict[str, Any]:
        """Record until the time is over, stopped, or the acquisition ends; rows that came before are kept."""
        recorder = ring_recorder.Recorder(order.ring_name, order.machine, order.role, order.path)
        recorder.start(order.seconds)
        while recorder.active and not order.stop.wait(LOOK_S):
            order.report({"rows": recorder.rows, "seconds": recorder.rows / order.machine.rate_hz})
        try:
            summary = recorder.stop()
        except AcquisitionError as error:
            if not order.path.is_file():
                raise
            return {
                "rows": recorder.rows,
                "seconds": recorder.rows / order.machine.rate_hz,
                "ended_early": str(error).replace(f"{order.path.parent}/", ""),
            }
        return {
            "rows": summary.rows,
            "seconds": summary.seconds,
            "missed_cycles": summary.missed_cycles,
            "quality": summary.quality,
            "events": summary.events,
        }

    def recover(self, directory: Path) -> dict[Path, int]:
        """Seal the journals that a killed server left in ``directory``."""
        return {found.file: found.rows for found in recover(directory) if found.file is not None}


router = APIRouter(prefix="/recordings", tags=["recordings"], route_class=TypedRoute)
_UPLOADED = dict.fromkeys(
    (*(FORMATS[kind][0] for kind in ("parquet", "csv", "mdf4")), "application/octet-stream"), BYTES
)
_DOWNLOADED = dict.fromkeys((media for media, _ in FORMATS.values()), BYTES)


@router.post("", status_code=201, responses=problems(404, 409, 422, 503), dependencies=[require("operate")])
def start(
    wish: RecordingStart,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    idempotency_key: Idempotency = None,
) -> RecordingResource:
    """Start recording a machine that is being acquired; one ``Idempotency-Key`` starts one recording."""

    def begin() -> str:
        return service[Sessions].start(wish.machine, wish.role, wish.label, wish.seconds).id

    id = service.replays.once(principal.id, "recordings", idempotency_key, wish.model_dump(), begin)
    response.headers["Location"] = f"/api/v1/recordings/{id}"
    return RecordingResource.of(service[Recordings].get(id))


@router.post(
    "/upload",
    status_code=201,
    responses=problems(404, 409, 413, 415, 422),
    openapi_extra=takes(_UPLOADED, "The bytes of the file"),
    dependencies=[require("operate")],
)
async def upload(
    request: Request,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    machine: OneMachine,
    role: RecordingRole,
    name: Annotated[
        str,
        Query(
            min_length=1,
            max_length=200,
            pattern=PLAIN,
            description="File name, with .csv, .txt, .tsv, .parquet, .mf4, .mat, .db3 or .mcap",
        ),
    ],
    columns: Annotated[
        str | None,
        Query(min_length=1, max_length=8000, description="Which column is which channel: YAML, 'channel: column'"),
    ] = None,
    resample: Annotated[bool, Query(description="Bring another rate to the machine's; the report says so")] = False,
) -> RecordingResource:
    """Upload a recording; one that ``hilfit identify`` would refuse is refused here."""
    async with service.heavy.place(principal.id) as place:
        uploads, length = service[RecordingUploads], request.headers.get("content-length", "0")
        size = int(length) if length.isdecimal() else 0
        incoming = await run_in_threadpool(uploads.incoming, machine, role, name, size)
        await receive(request.stream(), incoming, service.settings.maximum_upload_bytes, place.io, uploads.room)
        row = await place.run(uploads.add, incoming, machine, role, name, columns, resample)
    response.headers["Location"] = f"/api/v1/recordings/{row.id}"
    return RecordingResource.of(row)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_recordings(
    service: ServiceDep,
    page: PageDep,
    machine: MachineQuery = None,
    role: RecordingRole | None = None,
    state: State | None = None,
) -> RecordingList:
    """List recordings, newest first."""
    return RecordingList.of(service[Recordings].list(**page, machine=machine, role=role, state=state))


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> RecordingResource:
    """Read a recording; while it is being recorded its statistics are live."""
    row = service[Recordings].get(id)
    # A session ends a little after its row is sealed: what was counted last stands in the row by then.
    live = service[Sessions].statistics(id) if row.state == "recording" else None
    resource = RecordingResource.of(row)
    return resource if live is None else resource.model_copy(update={"statistics": live})


@router.get("/{id}/data", **sends(_DOWNLOADED, 404, 409, 422, 503), dependencies=[require("read")])
async def data(id: str, service: ServiceDep, principal: PrincipalDep, format: Format | None = None) -> FileResponse:
    """Download a recording, by default in the form in which it is kept."""
    row = await run_in_threadpool(service[Recordings].get, id)
    if format in (None, row.format):
        path, temporary = await run_in_threadpool(service[Exports].source, row), False
    else:
        path, temporary = await service.heavy.run(principal.id, service[Exports].file, row, format), True
    media_type, suffix = FORMATS[format or row.format]
    return FileResponse(
        path,
        media_type=media_type,
        filename=f"{row.machine}-{row.role}-{id}{suffix}",
        background=BackgroundTask(path.unlink, missing_ok=True) if temporary else None,
    )


@router.get("/{id}/statistics", responses=problems(404, 409, 422, 503), dependencies=[require("read")])
async def statistics(id: str, service: ServiceDep, principal: PrincipalDep) -> RecordingStatistics:
    """Return what a sealed recording holds, channel by channel."""
    row = await run_in_threadpool(service[Recordings].get, id)
    if service[Exports].kept_statistics(id).is_file():
        return RecordingStatistics(**await run_in_threadpool(service[Exports].statistics, row))
    return RecordingStatistics(**await service.heavy.run(principal.id, service[Exports].statistics, row))


@router.post("/{id}/stop", responses=problems(404, 409, 422), dependencies=[require("operate")])
async def stop(id: str, service: ServiceDep) -> RecordingResource:
    """Stop a recording and seal its file."""
    return RecordingResource.of(await service.heavy.aside(service[Sessions].stop, id))


@router.delete("/{id}", status_code=204, responses=problems(404, 409, 422), dependencies=[require("engineer")])
def delete(id: str, service: ServiceDep) -> None:
    """Delete a recording; one that an identification was made of is kept."""
    service[RecordingUploads].delete(id)


RECORDER: PartName[Recorder] = PartName("what records")
#: Bytes that are free for recordings.
FREE: PartName[Free] = PartName("free bytes for recordings")


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
        Sessions: lambda parts: Sessions(
            parts[Database], parts[DataDirectory], parts[Acquisition], parts[RECORDER], parts[FREE]
        ),
    },
    running=_running,
    backed_up=BackedUp("recordings", _files, unchanging=True),
    metrics=_metrics,
)
