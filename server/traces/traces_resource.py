"""The resource ``traces``: signals over time, of machines and of recordings."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import orjson
from fastapi import APIRouter, Query, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, Field, model_validator

from daq.errors import BadValueError
from daq.recordings.recording import MINIMUM_SECONDS
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.files import DataDirectory
from server.platform.http.bodies import Body, Label, Message
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import Phase, Resource, Running
from server.recordings.formats.exports import Exports
from server.recordings.recording_resource import RecordingResource
from server.recordings.recording_store import Recordings
from server.recordings.recording_uploads import RecordingUploads
from server.traces.extremes import Extremes, runs
from server.traces.recorded_signals import RecordedSignals
from server.traces.signal_collector import SignalCollector

Seconds = Annotated[float, Field(ge=0, le=1e7, allow_inf_nan=False)]


class ChannelTrace(BaseModel):
    """One channel, in its unit, per moment.

    ``high`` is null where each moment is one row: then ``low`` is its value. ``doubtful`` are the times from which to
    which a value was not measured in the row where it stands.
    """

    unit: str
    low: list[float | None]
    high: list[float | None] | None
    doubtful: list[tuple[float, float]]


class Signals(BaseModel):
    """Signals over time; moments are ``moment_s`` long, 0 for rows as they are.

    Times are seconds since 1970 for a machine, since the first row for a recording; ``first_utc`` is then the time of
    that row in seconds since 1970 where the recording has it.
    """

    start: float
    end: float
    moment_s: float
    first_utc: float | None
    time: list[float]
    channels: dict[str, ChannelTrace]


class Spectrum(BaseModel):
    """Power spectral density of one channel, unit^2/Hz, over frequency in Hz; ``seconds`` of it without a gap."""

    channel: str
    unit: str
    seconds: float
    frequency: list[float]
    density: list[float]


class RecordedEventResource(BaseModel):
    """What happened to a device: ``time`` in s since the first row; ``seconds`` null for what lasted on at the end."""

    time: float | None
    device: str
    what: str
    text: str
    text_message: Message | None = None
    seconds: float | None
    count: int


class RecordingRemarks(BaseModel):
    """What is said beside a recording: its events, and what ``hilfit check`` finds in it."""

    events: list[RecordedEventResource]
    findings: list[dict[str, Any]]


class Cut(Body, json_schema_extra={"examples": [{"start": 12.5, "end": 42.5, "label": "without the stop at the end"}]}):
    """A part of a recording, s since its first row."""

    start: Seconds
    end: Seconds
    label: Label = ""

    @model_validator(mode="after")
    def _forward(self) -> Cut:
        if self.end - self.start < MINIMUM_SECONDS:
            raise BadValueError("server.end_before_start", minimum_seconds=MINIMUM_SECONDS)
        return self


router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)
of_recordings = APIRouter(prefix="/recordings", tags=["recordings"], route_class=TypedRoute)
#: Longest range of a machine's signals, s.
LONGEST_S = 8 * 3600.0
Moments = Annotated[int, Query(ge=2, le=4000, description="Most moments; about the pixels of the plot")]
Channel = Annotated[str, Query(min_length=1, max_length=80)]
Wanted = Annotated[
    list[Annotated[str, Query(max_length=80)]] | None,
    Query(max_length=256, description="Channels; by default all"),
]
Place = Annotated[float, Query(ge=0, le=1e7, allow_inf_nan=False, description="s since the first row")]


@router.get(
    "/{name}/signals",
    response_class=Response,
    responses={200: {"model": Signals}, **problems(404, 422)},
    dependencies=[require("read")],
)
async def signals(
    name: str,
    service: ServiceDep,
    seconds: Annotated[float, Query(gt=0, le=LONGEST_S, allow_inf_nan=False)] = 600.0,
    end: Annotated[
        float | None, Query(ge=0, le=1e11, allow_inf_nan=False, description="s since 1970; by default the newest row")
    ] = None,
    moments: Moments = 1000,
    channel: Wanted = None,
) -> Response:
    """Return a machine's channels in the last hours, as far back as eight and as the start of the service.

    The smallest and largest value of each moment. As rows for the last ten minutes (at 50 Hz), as moments of a tenth of
    a second for half an hour, of a second before that.
    """
    await run_in_threadpool(service[Machines].get, name)
    found = await run_in_threadpool(service[SignalCollector].read, name, seconds, end, moments, channel)
    if found is None:
        empty = Signals(start=0, end=0, moment_s=0, first_utc=None, time=[], channels={})
        return Response(empty.model_dump_json(), media_type="application/json")
    channels, columns, traces, (start, stop) = found
    named = [(channels.names[column], channels.units[column]) for column in columns]
    return Response(_text(traces, named, start, stop), media_type="application/json")


@of_recordings.get(
    "/{id}/signals",
    response_class=Response,
    responses={200: {"model": Signals}, **problems(404, 409, 422, 429, 503)},
    dependencies=[require("read")],
)
async def recorded(
    id: str,
    service: ServiceDep,
    principal: PrincipalDep,
    start: Place | None = None,
    end: Place | None = None,
    moments: Moments = 1000,
    channel: Wanted = None,
) -> Response:
    """Return the channels of a sealed recording: the smallest and largest value of each moment."""
    row = await run_in_threadpool(service[Recordings].get, id)
    about, columns, traces, (first, last) = await service.heavy.run(
        principal.id, service[RecordedSignals].read, row, start, end, moments, channel
    )
    named = [(about.channels[column], about.units[column]) for column in columns]
    return Response(_text(traces, named, first, last, about.first_utc), media_type="application/json")


@of_recordings.get("/{id}/spectrum", responses=problems(404, 409, 422, 429, 503), dependencies=[require("read")])
async def spectrum(
    id: str,
    service: ServiceDep,
    principal: PrincipalDep,
    channel: Channel,
    start: Place = 0.0,
    end: Place | None = None,
) -> Spectrum:
    """Compute the power spectral density of a sealed recording's channel, over its longest part without a gap."""
    row = await run_in_threadpool(service[Recordings].get, id)
    unit, seconds, frequency, density = await service.heavy.run(
        principal.id, service[RecordedSignals].spectrum, row, channel, start, end
    )
    return Spectrum(channel=channel, unit=unit, seconds=seconds, frequency=frequency.tolist(), density=density.tolist())


@of_recordings.get("/{id}/remarks", responses=problems(404, 409, 422, 429, 503), dependencies=[require("read")])
async def remarks(id: str, service: ServiceDep, principal: PrincipalDep) -> RecordingRemarks:
    """Return events of a sealed recording, and what the checks find in it."""
    row = await run_in_threadpool(service[Recordings].get, id)
    known = service[RecordedSignals]
    async with service.heavy.place(principal.id) as place:
        events = await place.run(known.events, row)
        findings = await place.run(known.findings, row)
    return RecordingRemarks(events=events, findings=findings)  # type: ignore[arg-type]  # pydantic reads them


@of_recordings.post(
    "/{id}/cut",
    status_code=201,
    responses=problems(404, 409, 422, 429, 503),
    dependencies=[require("operate")],
)
async def cut(
    id: str, wish: Cut, response: Response, service: ServiceDep, principal: PrincipalDep
) -> RecordingResource:
    """Store a part of a sealed recording as a recording of its own; the whole one remains."""
    row = await run_in_threadpool(service[Recordings].get, id)
    label = wish.label or f"{row.label or row.id}, {wish.start:.1f} s to {wish.end:.1f} s"[:200]
    async with service.heavy.place(principal.id) as place:
        file = await place.run(service[RecordedSignals].cut, row, wish.start, wish.end)
        made = await place.run(service[RecordingUploads].add, file, row.machine, row.role, label)
    response.headers["Location"] = f"/api/v1/recordings/{made.id}"
    return RecordingResource.of(made)


def _text(
    traces: Extremes, named: list[tuple[str, str]], start: float, end: float, first_utc: float | None = None
) -> bytes:
    """Write a :class:`Signals` as JSON; numbers that are none become null."""
    rows = traces.width == 0
    content = {
        "start": start,
        "end": end,
        "moment_s": traces.width,
        "first_utc": first_utc,
        "time": traces.time,
        "channels": {
            name: {
                "unit": unit,
                "low": np.ascontiguousarray(traces.low[:, column], dtype=np.float32),
                "high": None if rows else np.ascontiguousarray(traces.high[:, column], dtype=np.float32),
                "doubtful": runs(traces.time, traces.flagged[:, column], traces.width),
            }
            for column, (name, unit) in enumerate(named)
        },
    }
    return orjson.dumps(content, option=orjson.OPT_SERIALIZE_NUMPY)


TRACES = Resource(
    name="traces",
    routers=(router, of_recordings),
    provides={
        SignalCollector: lambda parts: SignalCollector(parts[Acquisition]),
        RecordedSignals: lambda parts: RecordedSignals(parts[DataDirectory], parts[Exports]),
    },
    running=lambda parts: [Running(Phase.WATCHING, parts[SignalCollector].start, parts[SignalCollector].stop)],
)
