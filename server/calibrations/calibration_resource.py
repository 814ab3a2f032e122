"""The resource ``calibrations``: identifications that a person approved."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field, model_validator

from daq.errors import BadValueError
from server.audit.audit_resource import Audit
from server.calibrations.calibration_content import Parameter
from server.calibrations.calibration_desk import ByPolicy, Calibrations
from server.calibrations.calibration_store import Calibration, Of, State, activations, calibration_steps, calibrations
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.authorization.named_things import IdentificationId, Names, ValvesId
from server.platform.database.engine import Database
from server.platform.errors import ConflictError
from server.platform.files import DataDirectory
from server.platform.http.bodies import Body, Label, Listed, Shown
from server.platform.http.route_parameters import KnownTags, MachineQuery, PageDep, ServiceDep, problems, sends
from server.platform.resource import Resource
from server.platform.settings import Settings


class ShiftResource(Shown):
    """A parameter in both; ``sigmas`` is how far b is from a in standard deviations of the difference."""

    name: str
    unit: str | None
    a: float | None
    a_std: float | None
    b: float | None
    b_std: float | None
    sigmas: float | None


def compare_parameters(a: Sequence[Parameter], b: Sequence[Parameter]) -> list[ShiftResource]:
    """Compare every parameter of both, in the order of ``a``, then what only ``b`` has.

    ``sigmas = (b - a) / sqrt(std_a^2 + std_b^2)``: the two were estimated from different recordings, so their errors
    are independent. None where it is not known, or has no meaning because the units differ.
    """
    of_a, of_b = ({entry.name: entry for entry in entries} for entries in (a, b))
    return [_shift(name, of_a.get(name), of_b.get(name)) for name in {**of_a, **of_b}]


def compare_errors(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Compare per joint unit and error after the fit on ``validate``, of both (None where one lacks it)."""
    joints: dict[str, dict[str, Any]] = {}
    for joint in {**a, **b}:
        entry = a.get(joint) or b[joint]
        joints[joint] = {"unit": entry.get("unit"), "a": _error(a.get(joint)), "b": _error(b.get(joint))}
    return joints


def _error(entry: Mapping[str, Any] | None) -> float | None:
    value = ((entry or {}).get("after") or {}).get("validate")
    return None if value is None else float(value)


def _shift(name: str, a: Parameter | None, b: Parameter | None) -> ShiftResource:
    nothing = Parameter(name=name, value=None, std=None, unit=None)
    first, second = a or nothing, b or nothing
    sigmas = None
    if None not in (first.value, second.value, first.std, second.std) and first.unit == second.unit:
        spread = math.hypot(first.std, second.std)  # type: ignore[arg-type]
        if spread > 0:
            sigmas = (second.value - first.value) / spread  # type: ignore[operator]
    unit = second.unit if a is None else a.unit
    return ShiftResource(
        name=name, unit=unit, a=first.value, a_std=first.std, b=second.value, b_std=second.std, sigmas=sigmas
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
            raise BadValueError("server.give_one_of_both")
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
            "server.machines_differ", first=a, machine=first.machine, second=b, machine_2=second.machine
        )
    if first.kind != second.kind:
        raise ConflictError("server.not_same_valves", first=a, second=b)
    return ComparisonResource.of(first, second)


@router.get("/{id}", responses=problems(404, 422), dependencies=READ)
def get(id: str, response: Response, service: ServiceDep) -> CalibrationResource:
    """Read a calibration; its ``ETag`` is for changing it."""
    return _tagged(service[Calibrations].get(id), response)


@router.get("/{id}/model.json", **sends({"application/json": {"schema": {}}}, 404, 422), dependencies=READ)
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
    id: str, body: Decision, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> CalibrationResource:
    """Approve a proposed calibration; whoever proposed it may only where the policy says so (``second_person``)."""
    return _tagged(service[Calibrations].decide(id, "approved", principal, body.note, tags), response)


@router.post("/{id}/reject", responses=problems(404, 409, 412, 422), dependencies=ENGINEER)
def reject(
    id: str, body: Decision, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
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
    id: str, body: Decision, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
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


CALIBRATIONS = Resource(
    name="calibrations",
    routers=(router, machine_router),
    tables=(calibrations, calibration_steps, activations),
    of_a_machine={"calibrations": calibrations},
    kept={"/calibrations": ("calibrations",)},
    provides={
        Calibrations: lambda parts: Calibrations(parts[Database], parts[DataDirectory], parts[Settings].approves_own),
        ByPolicy: lambda parts: ByPolicy(parts[Calibrations], parts[Audit]),
    },
)
