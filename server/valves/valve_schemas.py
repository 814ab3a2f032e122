"""What the routes of valves take and give."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from server.identifications.identification_schemas import RecordingChoices, ShownChoices
from server.platform.authorization.named_things import MachineName
from server.platform.http.bodies import Body, Flag, Label, Listed, Shown


class ValveOptions(Body):
    """Choices: ``loop``: look for effects. ``bandwidth_hz``: of the filter; 3 Hz, or a fifth of a slower rate."""

    loop: Flag = True
    bandwidth_hz: Annotated[float, Field(gt=0)] | None = None


class ValveOrder(
    Body,
    json_schema_extra={
        "examples": [
            {
                "machine": "folding-arm",
                "recordings": [
                    {"id": "rec-0123456789abcdef", "role": "train"},
                    {"id": "rec-fedcba9876543210", "role": "validate"},
                ],
            }
        ]
    },
):
    """Whose valves to identify, from recordings with commands; those in the role ``validate`` are judged on."""

    machine: MachineName
    recordings: RecordingChoices
    options: ValveOptions = ValveOptions()
    label: Label = ""


class ValveEffect(BaseModel):
    """What the model of a valve lacked."""

    id: str
    probability: float


class ValveAxis(BaseModel):
    """One axis in short.

    ``handed_out``: which model the inverse is made of. ``error``: of the speed, over its RMS, on ``judged_on``.
    ``delay``: s. By direction: ``edges``, commands that give 2 % of the speed, as share of full; ``speeds``, m/s at the
    largest recorded command.
    """

    verdict: Literal["nothing_missing", "effect_added", "ambiguous"]
    handed_out: Literal["model", "before", "static"]
    error: float
    judged_on: Literal["train", "validate"]
    delay: float
    edges: dict[str, float]
    speeds: dict[str, float]
    effects: list[ValveEffect]


class ValveResource(Shown):
    """An identification of valves; ``axes`` are there, by joint, once its job is done."""

    id: str
    job: str
    machine: str
    machine_version: int
    label: str
    recordings: ShownChoices
    options: dict[str, Any]
    created: str
    axes: dict[str, ValveAxis] | None


class ValveList(Listed[ValveResource]):
    """A page of identifications of valves."""
