"""``/machines``: upload, list, read, acquire."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

from daq.messages import Sentence
from server.machines.acquisition import Acquisition
from server.machines.machine_desk import MachineDesk
from server.machines.machine_reader import MachineReader
from server.machines.machine_store import MachineRow, Machines
from server.platform.authorization.guard import Principal, PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import NotFoundError
from server.platform.http.bodies import Body, Flag, Listed
from server.platform.http.route_parameters import KnownTags, PageDep, ServiceDep, problems
from server.platform.service import Service


class MachineSummary(MachineRow):
    """A machine: its current version, and whether it is acquired."""


class MachineCheck(BaseModel):
    """A machine file without fault: the machine's name, and the version that it would be (the current one as it is)."""

    name: str
    version: int


class MachineDetail(MachineSummary):
    """A machine with its validated file and the state of its acquisition."""

    versions: list[int]
    machine: dict[str, Any]
    acquisition: dict[str, Any]


class MachineList(Listed[MachineSummary]):
    """A page of machines; ``next`` is the cursor of the next page."""


class AcquisitionWish(Body, json_schema_extra={"examples": [{"enabled": True}]}):
    """Whether acquisition of a machine should run."""

    enabled: Flag


router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)
YAML = "application/yaml"
Version = Annotated[int | None, Query(ge=1, le=2**53, description="By default the current one")]
_FILE: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "description": "The text of a machine file (YAML, or JSON, which is YAML too)",
        "content": {YAML: {"schema": {"type": "string"}}},
    }
}


@router.post(
    "",
    status_code=201,
    responses={200: {"model": MachineSummary}, **problems(404, 409, 412, 413, 422)},
    openapi_extra=_FILE,
    dependencies=[require("engineer")],
)
async def upload(
    request: Request, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> MachineSummary:
    """Upload a machine file: a new machine or a new version (200 if it is the current version already)."""
    async with service.heavy.place(principal.id) as place:
        row, made = await place.run(service[MachineDesk].upload, await request.body(), principal.may_see, tags)
    response.status_code = 201 if made else 200
    response.headers["Location"] = f"/api/v1/machines/{row.name}"
    response.headers["ETag"] = f'"{row.current}"'
    return MachineSummary.of(row)


@router.post("/check", responses=problems(404, 409, 413, 422), openapi_extra=_FILE, dependencies=[require("engineer")])
async def check(request: Request, service: ServiceDep, principal: PrincipalDep) -> MachineCheck:
    """Check a machine file as an upload of it would; nothing is stored."""
    async with service.heavy.place(principal.id) as place:
        name, version = await place.run(service[MachineDesk].check, await request.body(), principal.may_see)
    return MachineCheck(name=name, version=version)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_machines(service: ServiceDep, page: PageDep) -> MachineList:
    """List machines; ``label`` is looked for in their names, and a machine's time is that of its current version."""
    return MachineList.of(service[Machines].list(**page))


@router.get("/{name}", responses=problems(404, 422), dependencies=[require("read")])
async def get(
    name: str, response: Response, service: ServiceDep, principal: PrincipalDep, version: Version = None
) -> MachineDetail:
    """Read a machine: its file, validated, as JSON, and the state of its acquisition."""
    detail = await _detail(service, principal, name, version)
    response.headers["ETag"] = f'"{detail.current}"'
    return detail


@router.get(
    "/{name}/file",
    response_class=Response,
    responses={200: {"content": {YAML: {"schema": {"type": "string"}}}}, **problems(404, 422)},
    dependencies=[require("read")],
)
def file(name: str, service: ServiceDep, version: Version = None) -> Response:
    """Read a machine file as it was uploaded."""
    row = service[Machines].get(name, version)
    content = service.files.machine_file(name, row.version).read_bytes()
    return Response(content, media_type=YAML, headers={"ETag": f'"{row.current}"'})


@router.put("/{name}/acquisition", responses=problems(404, 409, 422), dependencies=[require("engineer")])
async def acquisition(name: str, wish: AcquisitionWish, service: ServiceDep, principal: PrincipalDep) -> MachineDetail:
    """Start or stop acquiring a machine; restarts keep that."""
    await service.heavy.aside(service[MachineDesk].set_acquisition, name, wish.enabled)
    return await _detail(service, principal, name, None)


async def _detail(service: Service, principal: Principal, name: str, version: int | None) -> MachineDetail:
    row = await run_in_threadpool(service[Machines].get, name, version)
    path = service.files.machine_file(name, row.version)
    content = service[MachineReader].known(path)
    if content is None:  # not since this start: reading it takes a while
        if not path.is_file():
            raise NotFoundError(Sentence("server.file_machine_gone", row=name))
        content = await service.heavy.run(principal.id, service[MachineReader].content, path)
    return MachineDetail(
        **row.__dict__,
        versions=[entry.version for entry in await run_in_threadpool(service[Machines].versions, name)],
        machine=content,
        acquisition=service[Acquisition].statistics(name),
    )
