"""``/excitations``: design motions, download them, hand them to the simulated machine's controller."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from server.access.guard import PrincipalDep, require
from server.access.names import MachineName
from server.access.route import TypedRoute
from server.errors import ConflictError
from server.routes.common import Cursor, Idempotency, Limit, MachineQuery, ServiceDep, problems
from server.service import Service
from server.store.excitations import Excitation

router = APIRouter(prefix="/excitations", tags=["excitations"], route_class=TypedRoute)


class ExcitationOrder(BaseModel):
    """What motion to design.

    ``rods``: ``pinned`` moves the arm, ``unpinned`` the free cylinders (stage 1). ``joints``: only these move.
    ``use``: share of every limit that may be used. Limits that are not given are those of the machine file.
    """

    model_config = ConfigDict(extra="forbid")

    machine: MachineName
    label: Annotated[str, Field(max_length=200)] = ""
    rods: Literal["pinned", "unpinned"] = "pinned"
    joints: Annotated[list[Annotated[str, Field(max_length=80)]], Field(min_length=1, max_length=32)] | None = None
    duration_s: Annotated[float, Field(ge=5, le=600)] | None = None
    use: Annotated[float, Field(gt=0, le=1)] | None = None
    max_frequency_hz: Annotated[float, Field(gt=0, le=10)] | None = None
    max_flow_l_min: Annotated[float, Field(gt=0, le=1e4)] | None = None
    max_pressure_bar: Annotated[float, Field(gt=0, le=1e4)] | None = None
    starts: Annotated[int, Field(ge=1, le=20)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0


class ExcitationResource(BaseModel):
    """An excitation; what its design found is there once its job is done.

    ``not_told``: parameters that the motion tells nothing about. ``limits``: how much of each is used.
    """

    id: str
    machine: str
    machine_version: int
    label: str
    job: str
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    options: dict[str, Any]
    created: str
    condition_number: float | None = None
    seconds: float | None = None
    rods: Literal["pinned", "unpinned"] | None = None
    joints: list[str] | None = None
    limits: list[dict[str, Any]] | None = None
    not_told: list[str] | None = None

    @classmethod
    def of(cls, service: Service, value: Excitation) -> ExcitationResource:
        """From the store."""
        row = {key: item for key, item in value.__dict__.items() if key != "result"}
        return cls(**row, state=service.jobs.get(value.job).state, **(value.result or {}))


class ExcitationList(BaseModel):
    """A page of excitations."""

    items: list[ExcitationResource]
    next: int | None


class Sent(BaseModel):
    """The controller has the motion, and follows it after those that came before."""

    name: str


@router.post("", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
def order(
    body: ExcitationOrder,
    response: Response,
    service: ServiceDep,
    idempotency_key: Idempotency = None,
) -> ExcitationResource:
    """Order the design of a motion: its job is at ``Location``; one ``Idempotency-Key`` makes one job."""
    options = body.model_dump(exclude={"machine", "label"})
    excitation = service.design(body.machine, options, body.label, idempotency_key)
    response.headers["Location"] = f"/api/v1/jobs/{excitation.job}"
    return ExcitationResource.of(service, excitation)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_excitations(
    service: ServiceDep,
    principal: PrincipalDep,
    machine: MachineQuery = None,
    limit: Limit = 50,
    cursor: Cursor = 0,
) -> ExcitationList:
    """List excitations, newest first."""
    page = service.excitations.list(limit, cursor, machine=machine, machines=principal.machines)
    return ExcitationList(items=[ExcitationResource.of(service, value) for value in page.items], next=page.next)


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> ExcitationResource:
    """Read an excitation."""
    return ExcitationResource.of(service, service.excitations.get(id))


@router.get(
    "/{id}/motion.csv",
    response_class=FileResponse,
    responses={200: {"content": {"text/csv": {}}}, **problems(404, 409, 422)},
    dependencies=[require("read")],
)
def motion(id: str, service: ServiceDep) -> FileResponse:
    """The motion file, for the arm's own controller."""
    excitation = service.excitations.get(id)
    path = service.designs.motion(id)
    if excitation.result is None or not path.is_file():
        state = service.jobs.get(excitation.job).state
        raise ConflictError(f"excitation '{id}' has no motion: its job {excitation.job} is {state}")
    return FileResponse(path, media_type="text/csv", filename=f"{excitation.machine}-{id}.csv")


@router.post("/{id}/send", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
def send(id: str, service: ServiceDep) -> Sent:
    """Hand the motion to the simulated machine's controller; 409 for a real machine, whose controller is its own."""
    service.site.send(id, id)
    return Sent(name=id)
