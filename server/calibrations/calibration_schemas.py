"""What the routes of calibrations take and give."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, Field

from server.calibrations.calibration_comparison import ShiftResource, compare_errors, compare_parameters
from server.calibrations.calibration_store import Calibration
from server.platform.authorization.named_things import IdentificationId
from server.platform.http.bodies import Body, Label, Listed


class Proposal(
    Body, json_schema_extra={"examples": [{"identification": "idf-0123456789abcdef", "label": "after the new seal"}]}
):
    """Propose an identification as a calibration; without a label it has the identification's."""

    identification: IdentificationId
    label: Label = ""


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
        """Of two calibrations."""
        return cls(
            a=CalibrationResource.of(a),
            b=CalibrationResource.of(b),
            parameters=compare_parameters(a.parameters, b.parameters),
            errors={joint: JointErrors(**entry) for joint, entry in compare_errors(a.errors, b.errors).items()},
        )
