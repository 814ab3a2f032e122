"""``/calibrations``: propose, approve by a second person, activate, roll back, compare, download."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field, model_validator

from daq.messages import Sentence
from server.calibrations.calibration_comparison import ShiftResource, compare_errors, compare_parameters
from server.calibrations.calibration_desk import Calibrations
from server.calibrations.calibration_store import Calibration, Of, State
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.named_things import IdentificationId, Names, ValvesId
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import ConflictError
from server.platform.http.bodies import Body, Label, Listed
from server.platform.http.route_parameters import (
    KnownTags,
    MachineQuery,
    PageDep,
    ServiceDep,
    problems,
)


class Proposal(
    Body, json_schema_extra={"examples": [{"identification": "idf-0123456789abcdef", "label": "after the new seal"}]}
):
    """Propose an identification, or one of ``valves``, as a calibration; without a label it has that one's."""

    identification: IdentificationId | None = None
    valves: ValvesId | None = None
    label: Label = ""

    @model_validator(mode="after")
    def _one(self) -> Proposal:
        if (self.identification is None) == (self.valves is None):
            raise ValueError(Sentence("server.give_one_of_both"))
        return self


class Decision(Body, json_schema_extra={"examples": [{"note": "fits better than the one in use at every joint"}]}):
    """Why."""

    note: Annotated[str, Field(max_length=2000)] = ""


class CalibrationResource(Calibration):
    """A calibration; ``errors`` per joint and ``overall`` are the report's, before and after the loop.

    ``proposed_by_id``: the principal that may not approve it, where the policy asks for a second person. ``history``:
    who did what, when, oldest first.
    """


class CalibrationList(Listed[CalibrationResource]):
    """A page of calibrations."""


class JointErrors(BaseModel):
    """Error of a joint on the validation motion, after each fit."""

    unit: str | None
    a: float | None
    b: float | None


class ComparisonResource(BaseModel):
    """Two calibrations side by side."""

    a: CalibrationResource
    b: CalibrationResource
    parameters: list[ShiftResource]
    errors: dict[str, JointErrors]

    @classmethod
    def of(cls, a: Calibration, b: Calibration) -> ComparisonResource:
        """Compare two calibrations."""
        return cls(
            a=CalibrationResource.of(a),
            b=CalibrationResource.of(b),
            parameters=compare_parameters(a.parameters, b.parameters),
            errors={joint: JointErrors(**entry) for joint, entry in compare_errors(a.errors, b.errors).items()},
        )


router = APIRouter(prefix="/calibrations", tags=["calibrations"], route_class=TypedRoute)
machine_router = APIRouter(prefix="/machines", tags=["calibrations"], route_class=TypedRoute)
Id = Annotated[str, Names("calibrations"), Query(max_length=80)]
READ, OPERATE, ENGINEER = [require("read")], [require("operate")], [require("engineer")]


@router.post(
    "",
    status_code=201,
    responses={200: {"model": CalibrationResource}, **problems(404, 409, 422)},
    dependencies=OPERATE,
)
def propose(body: Proposal, response: Response, service: ServiceDep, principal: PrincipalDep) -> CalibrationResource:
    """Propose an identification that is done; one that was proposed before is answered with 200 as it is."""
    of: Of = "valves" if body.identification is None else "identification"
    source = str(body.identification or body.valves)
    calibration, made = service[Calibrations].propose(source, body.label, principal, of)
    response.status_code = 201 if made else 200
    response.headers["Location"] = f"/api/v1/calibrations/{calibration.id}"
    return _tagged(calibration, response)


@router.get("", responses=problems(422), dependencies=READ)
def list_calibrations(
    service: ServiceDep, page: PageDep, machine: MachineQuery = None, state: State | None = None
) -> CalibrationList:
    """List calibrations, newest first."""
    return CalibrationList.of(service[Calibrations].list(**page, machine=machine, state=state))


@router.get("/compare", responses=problems(404, 409, 422), dependencies=READ)
def compare(a: Id, b: Id, service: ServiceDep) -> ComparisonResource:
    """Compare two calibrations of one machine: every parameter, how far it moved, and the errors per joint."""
    first, second = service[Calibrations].get(a), service[Calibrations].get(b)
    if first.machine != second.machine:
        raise ConflictError(
            Sentence("server.machines_differ", first=a, machine=first.machine, second=b, machine_2=second.machine)
        )
    if first.kind != second.kind:
        raise ConflictError(Sentence("server.not_same_valves", first=a, second=b))
    return ComparisonResource.of(first, second)


@router.get("/{id}", responses=problems(404, 422), dependencies=READ)
def get(id: str, response: Response, service: ServiceDep) -> CalibrationResource:
    """Read a calibration; its ``ETag`` is for changing it."""
    return _tagged(service[Calibrations].get(id), response)


@router.get(
    "/{id}/model.json",
    response_class=JSONResponse,
    responses={200: {"content": {"application/json": {}}}, **problems(404, 422)},
    dependencies=READ,
)
def model(id: str, service: ServiceDep) -> JSONResponse:
    """Download the fitted model (schema ``hilfit/model/1``), with the calibration's id in its provenance.

    Where the identification's files are gone: what the calibration kept of it (schema ``hilfit/calibration/1``).
    """
    name = f"{service[Calibrations].get(id).machine}-{id}-model.json"
    return JSONResponse(
        service[Calibrations].model_file(id), headers={"Content-Disposition": f'attachment; filename="{name}"'}
    )


@router.post("/{id}/approve", responses=problems(404, 409, 412, 422), dependencies=ENGINEER)
def approve(
    id: str,
    body: Decision,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    tags: KnownTags,
) -> CalibrationResource:
    """Approve a proposed calibration; whoever proposed it may only where the policy says so (``second_person``)."""
    return _tagged(service[Calibrations].decide(id, "approved", principal, body.note, tags), response)


@router.post("/{id}/reject", responses=problems(404, 409, 412, 422), dependencies=ENGINEER)
def reject(
    id: str,
    body: Decision,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    tags: KnownTags,
) -> CalibrationResource:
    """Reject a calibration that is not in use and never was."""
    return _tagged(service[Calibrations].decide(id, "rejected", principal, body.note, tags), response)


@router.post("/{id}/activate", responses=problems(404, 409, 412, 422), dependencies=ENGINEER)
def activate(
    id: str, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> CalibrationResource:
    """Use an approved calibration; the one in use before is retired."""
    return _tagged(service[Calibrations].activate(id, tags, principal), response)


@router.post("/{id}/deactivate", responses=problems(404, 409, 412, 422), dependencies=ENGINEER)
def deactivate(
    id: str,
    body: Decision,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    tags: KnownTags,
) -> CalibrationResource:
    """Take the calibration in use out of use: none is in use then, and the monitor rests. It can be activated again."""
    changed = service[Calibrations].deactivate(id, tags, principal, body.note)
    return _tagged(changed, response)


@machine_router.post("/{name}/calibrations/rollback", responses=problems(404, 409, 422), dependencies=ENGINEER)
def roll_back(
    name: str, response: Response, service: ServiceDep, principal: PrincipalDep, of: Of = "identification"
) -> CalibrationResource:
    """Use the calibration again that was in use before the active one, of the mechanics or of the valves."""
    service[Machines].get(name)
    return _tagged(service[Calibrations].roll_back(name, principal, of), response)


def _tagged(calibration: Calibration, response: Response) -> CalibrationResource:
    response.headers["ETag"] = f'"{calibration.revision}"'
    return CalibrationResource.of(calibration)
