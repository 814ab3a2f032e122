"""``/excitations``: design motions, download them, hand them to the simulated machine's controller."""

from __future__ import annotations

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse

from server.excitations.excitation_job import ExcitationKind
from server.excitations.excitation_schemas import ExcitationList, ExcitationOrder, ExcitationResource, Sent
from server.excitations.excitation_store import Excitation, Excitations
from server.excitations.motion_delivery import MotionDelivery
from server.jobs.job_runner import JobRunner
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import ConflictError
from server.platform.http.route_parameters import (
    BetweenDep,
    Cursor,
    Idempotency,
    Limit,
    MachineQuery,
    ServiceDep,
    problems,
)

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
def list_excitations(
    service: ServiceDep,
    principal: PrincipalDep,
    between: BetweenDep,
    machine: MachineQuery = None,
    limit: Limit = 50,
    cursor: Cursor = 0,
) -> ExcitationList:
    """List excitations, newest first."""
    page = service[Excitations].list(limit, cursor, machine=machine, machines=principal.machines, between=between)
    return ExcitationList.of(page, _resource)


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> ExcitationResource:
    """Read an excitation."""
    return _resource(service[Excitations].get(id))


@router.get(
    "/{id}/motion.csv",
    response_class=FileResponse,
    responses={200: {"content": {"text/csv": {}}}, **problems(404, 409, 422)},
    dependencies=[require("read")],
)
def motion(id: str, service: ServiceDep) -> FileResponse:
    """The motion file, for the arm's own controller."""
    excitation = service[Excitations].get(id)
    path = service[ExcitationKind].motion(id)
    if excitation.result is None or not path.is_file():
        raise ConflictError(f"excitation '{id}' has no motion: its job {excitation.job} is {excitation.state}")
    return FileResponse(path, media_type="text/csv", filename=f"{excitation.machine}-{id}.csv")


@router.post("/{id}/send", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
def send(id: str, service: ServiceDep) -> Sent:
    """Hand the motion to the simulated machine's controller; 409 for a real machine, whose controller is its own."""
    service[MotionDelivery].send(id, id)
    return Sent(name=id)


def _resource(value: Excitation) -> ExcitationResource:
    return ExcitationResource.of(value, **(value.result or {}))
