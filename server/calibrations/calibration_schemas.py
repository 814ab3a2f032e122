"""What the routes of calibrations take and give."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from server.calibrations.calibration_comparison import compare_errors, compare_parameters
from server.calibrations.calibration_store import Calibration
from server.platform.authorization.named_things import IdentificationId
from server.platform.http.bodies import Body, Label, Listed, Shown


class Proposal(
    Body, json_schema_extra={"examples": [{"identification": "idf-0123456789abcdef", "label": "after the new seal"}]}
):
    """Propose an identification as a calibration; without a label it has the identification's."""

    identification: IdentificationId
    label: Label = ""


class Decision(Body, json_schema_extra={"examples": [{"note": "fits better than the one in use at every joint"}]}):
    """Why."""

    note: Annotated[str, Field(max_length=2000)] = ""


class Parameter(BaseModel):
    """A parameter in the unit that it has in the report."""

    name: str
    value: float | None
    std: float | None
    unit: str | None


class StepResource(Shown):
    """Who did what to a calibration, when."""

    time: str
    action: Literal["proposed", "approved", "rejected", "activated", "retired"]
    by: str
    note: str


class CalibrationResource(Shown):
    """A calibration; ``errors`` per joint and ``overall`` are the report's, before and after the loop.

    ``proposed_by_id``: the principal that may not approve it, where the policy asks for a second person. ``history``:
    who did what, when, oldest first.
    """

    id: str
    machine: str
    identification: str
    label: str
    state: Literal["proposed", "approved", "rejected", "active", "retired"]
    proposed_by: str
    proposed_by_id: str
    approved_by: str | None
    created: str
    activated: str | None
    verdict: str
    overall: dict[str, Any]
    errors: dict[str, Any]
    parameters: list[Parameter]
    note: str
    history: list[StepResource]


class CalibrationList(Listed[CalibrationResource]):
    """A page of calibrations."""


class ShiftResource(Shown):
    """A parameter in both; ``sigmas`` is how far b is from a in standard deviations of the difference."""

    name: str
    unit: str | None
    a: float | None
    a_std: float | None
    b: float | None
    b_std: float | None
    sigmas: float | None


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
        """Of two calibrations."""
        return cls(
            a=CalibrationResource.of(a),
            b=CalibrationResource.of(b),
            parameters=[ShiftResource.of(shift) for shift in compare_parameters(a.parameters, b.parameters)],
            errors={joint: JointErrors(**entry) for joint, entry in compare_errors(a.errors, b.errors).items()},
        )
