"""The resource ``can_signals``: what the DBC files of machines offer, and these files."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse

from daq.messages import Sentence
from server.can_signals.can_signals_schemas import (
    CanBus,
    CanFile,
    CanFileReplaced,
    CanSignal,
    CanSignalList,
    CanSignalQuantity,
    matching,
)
from server.can_signals.signal_files import SignalFiles
from server.machines.acquisition import Acquisition
from server.machines.machine_desk import BEING_RECORDED
from server.machines.machine_reader import MachineReader
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import NotFoundError
from server.platform.files import DataDirectory, receive
from server.platform.http.route_parameters import KnownTags, Limit, OneMachine, ServiceDep, problems
from server.platform.processes.file_children import FileChildren
from server.platform.resource import Resource

router = APIRouter(prefix="/can-signals", tags=["machines"], route_class=TypedRoute)
_BYTES: dict[str, Any] = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}
_FILE: dict[str, Any] = {"requestBody": {"required": True, "description": "The bytes of the file", "content": _BYTES}}
DbcFile = Annotated[str, Query(min_length=1, max_length=1000, description="As the machine's file names it in dbc")]


@router.get("", responses=problems(404, 422, 429, 503), dependencies=[require("read")])
async def list_signals(
    service: ServiceDep,
    principal: PrincipalDep,
    machine: OneMachine,
    bus: Annotated[str | None, Query(max_length=80, description="By default all")] = None,
    search: Annotated[str, Query(max_length=200, description="Words that a signal has to have")] = "",
    limit: Limit = 100,
) -> CanSignalList:
    """List the signals of a machine's buses of plain CAN or J1939, as their DBC files describe them."""
    return await service.heavy.run(principal.id, _listed, service[SignalFiles], machine, bus, search, limit)


@router.get(
    "/file",
    response_class=FileResponse,
    responses={200: {"content": _BYTES}, **problems(404, 422, 429, 503)},
    dependencies=[require("read")],
)
async def file(service: ServiceDep, principal: PrincipalDep, machine: OneMachine, name: DbcFile) -> FileResponse:
    """Download a DBC file that a machine's file names."""
    path = await service.heavy.run(principal.id, service[SignalFiles].path, machine, name)
    if not await run_in_threadpool(path.is_file):
        raise NotFoundError(Sentence("server.no_file_beside_file", name=name, machine=machine))
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.post(
    "/upload",
    responses=problems(404, 409, 412, 413, 415, 422, 429, 503),
    openapi_extra=_FILE,
    dependencies=[require("engineer")],
)
async def upload(
    request: Request,
    service: ServiceDep,
    response: Response,
    principal: PrincipalDep,
    machine: OneMachine,
    name: DbcFile,
    tags: KnownTags,
) -> CanFileReplaced:
    """Upload a DBC file in the place of one that a machine's file names; acquisition goes on with the new one."""
    files = service[SignalFiles]
    async with service.heavy.place(principal.id) as place:
        incoming = await place.run(files.incoming, machine, name)
        await receive(request.stream(), incoming, service.settings.maximum_upload_bytes, place.io)
        digest = await place.run(files.replace, incoming, machine, name, tags)
    response.headers["ETag"] = f'"{digest}"'
    return CanFileReplaced(name=name, sha256=digest)


def _listed(files: SignalFiles, machine: str, only: str | None, search: str, limit: int) -> CanSignalList:
    row, every = files.buses(machine)
    buses = [bus for bus in every if only in (None, bus["name"])]
    found = matching(buses, search)
    return CanSignalList(
        machine=machine,
        version=row.version,
        buses=[
            CanBus(
                name=bus["name"],
                files=[CanFile(**file, sha256=files.digest(machine, file["name"])) for file in bus["files"]],
                problems=bus["problems"],
                messages=bus["messages"],
                left_out=bus["left_out"],
            )
            for bus in buses
        ],
        found=len(found),
        items=[CanSignal(**signal) for signal in found[:limit]],
        quantities=CanSignalQuantity.all(),
    )


CAN_SIGNALS = Resource(
    name="can_signals",
    routers=(router,),
    provides={
        SignalFiles: lambda parts: SignalFiles(
            parts[DataDirectory],
            parts[Machines],
            parts[MachineReader],
            parts[Acquisition],
            parts[BEING_RECORDED],
            parts[FileChildren],
        ),
    },
    large_uploads=frozenset({"/can-signals/upload"}),
)
