"""The resource ``excitations``: motions that are designed for a machine."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from server.excitations.excitation_job import PROGRAM, ExcitationKind, MotionDelivery
from server.excitations.excitation_store import Excitation, Excitations
from server.jobs.job_places import named_results
from server.jobs.job_runner import JobRunner
from server.machines.machine_desk import MachineDesk
from server.platform.authorization.guard import TypedRoute, require
from server.platform.authorization.named_things import MachineName
from server.platform.database.engine import Database
from server.platform.errors import ConflictError
from server.platform.files import DataDirectory
from server.platform.http.bodies import Body, Label, Listed
from server.platform.http.route_parameters import Idempotency, MachineQuery, PageDep, ServiceDep, problems, sends
from server.platform.resource import BackedUp, PartName, Parts, Resource


class ExcitationOrder(
    Body,
    json_schema_extra={"examples": [{"machine": "folding-arm", "rods": "pinned", "duration_s": 60, "use": 0.8}]},
):
    """What motion to design.

    ``rods``: ``pinned`` moves the arm, ``unpinned`` the free cylinders (stage 1). ``joints``: only these move.
    ``use``: share of every limit that may be used. Limits that are not given are those of the machine file.
    """

    machine: MachineName
    label: Label = ""
    rods: Literal["pinned", "unpinned"] = "pinned"
    joints: Annotated[list[Annotated[str, Field(max_length=80)]], Field(min_length=1, max_length=32)] | None = None
    duration_s: Annotated[float, Field(ge=5, le=600)] | None = None
    use: Annotated[float, Field(gt=0, le=1)] | None = None
    max_frequency_hz: Annotated[float, Field(gt=0, le=10)] | None = None
    max_flow_l_min: Annotated[float, Field(gt=0, le=1e4)] | None = None
    max_pressure_bar: Annotated[float, Field(gt=0, le=1e4)] | None = None
    starts: Annotated[int, Field(ge=1, le=20)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0


class ExcitationResource(Excitation):
    """An excitation; what its design found is there once its job is done.

    ``not_told``: parameters that the motion tells nothing about. ``limits``: how much of each is used.
    """

    condition_number: float | None = None
    seconds: float | None = None
    rods: Literal["pinned", "unpinned"] | None = None
    joints: list[str] | None = None
    limits: list[dict[str, Any]] | None = None
    not_told: list[str] | None = None


class ExcitationList(Listed[ExcitationResource]):
    """A page of excitations."""


class Sent(BaseModel):
    """The controller has the motion, and follows it after those that came before."""

    name: str


router = APIRouter(prefix="/excitations", tags=["excitations"], route_class=TypedRoute)


@router.post("", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
def order(
    body: ExcitationOrder,
    response: Response,
    service: ServiceDep,
    idempotency_key: Idempotency = None,
) -> ExcitationResource:
    """Order the design of a motion: its job is at ``Location``; one ``Idempotency-Key`` makes one job."""
    options = body.model_dump(exclude={"machine", "label"})
    excitation = service[ExcitationKind].order(body.machine, options, body.label, idempotency_key)
    service[JobRunner].enqueue(excitation.job)
    response.headers["Location"] = f"/api/v1/jobs/{excitation.job}"
    return _resource(excitation)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_excitations(service: ServiceDep, page: PageDep, machine: MachineQuery = None) -> ExcitationList:
    """List excitations, newest first."""
    return ExcitationList.of(service[Excitations].list(**page, machine=machine), _resource)


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> ExcitationResource:
    """Read an excitation."""
    return _resource(service[Excitations].get(id))


@router.get("/{id}/motion.csv", **sends({"text/csv": {}}, 404, 409, 422), dependencies=[require("read")])
def motion(id: str, service: ServiceDep) -> FileResponse:
    """Download the motion file, for the arm's own controller."""
    excitation = service[Excitations].get(id)
    path = service[ExcitationKind].motion(id)
    if excitation.result is None or not path.is_file():
        raise ConflictError("server.excitation_no_motion_job", id=id, job=excitation.job, state=excitation.state)
    return FileResponse(path, media_type="text/csv", filename=f"{excitation.machine}-{id}.csv")


@router.post("/{id}/send", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
def send(id: str, service: ServiceDep) -> Sent:
    """Send the motion to the simulated machine's controller; 409 for a real machine, whose controller is its own."""
    service[MotionDelivery].send(id, id)
    return Sent(name=id)


def _resource(value: Excitation) -> ExcitationResource:
    return ExcitationResource.of(value, **(value.result or {}))


DESIGN: PartName[Sequence[str]] = PartName("the program that designs motions")


def _delivery(parts: Parts) -> MotionDelivery:
    desk = parts[MachineDesk]
    return MotionDelivery(parts[DataDirectory], parts[Excitations], parts[ExcitationKind], lambda: desk.simulated)


EXCITATIONS = Resource(
    name="excitations",
    routers=(router,),
    tables=(Excitation.table,),
    of_a_machine={"excitations": Excitation.table},
    kept={"/excitations": ("excitations", "jobs")},
    provides={
        DESIGN: lambda parts: PROGRAM,
        Excitations: lambda parts: Excitations(parts[Database]),
        ExcitationKind: lambda parts: ExcitationKind(parts[Database], parts[DataDirectory], parts[DESIGN]),
        MotionDelivery: _delivery,
    },
    job_kinds=(ExcitationKind,),
    backed_up=BackedUp("excitations", partial(named_results, Excitation.table)),
)
