"""What the routes of identifications take and give."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, JsonValue

from server.identifications.identification_store import Identification, RecordingChoice
from server.platform.authorization.named_things import MachineName
from server.platform.http.bodies import Body, Flag, Label, Listed

#: What a fit is ordered of.
RecordingChoices = Annotated[list[RecordingChoice], Field(min_length=1, max_length=200)]
#: An order of one, as the OpenAPI description shows it.
ORDER_EXAMPLE: dict[str, JsonValue] = {
    "examples": [
        {
            "machine": "folding-arm",
            "recordings": [
                {"id": "rec-0123456789abcdef", "role": "train"},
                {"id": "rec-fedcba9876543210", "role": "validate"},
            ],
        }
    ]
}


class IdentificationOptions(Body):
    """Choices of an identification (:class:`fitting.loop.session.Options`).

    ``loop``: look for what the model lacks. ``bandwidth_hz``: identification bandwidth, None: from the motion.
    ``bootstrap``: most replicas that a null distribution is drawn from. ``forgetting``: factor of stage 1's recursion,
    1 forgets nothing. ``estimator``, ``covariance``: of stage 2. ``prior`` and ``columns`` name files: only the command
    line has them. ``resample``: stored recordings have the machine's rate already, so it changes nothing.
    """

    loop: Flag = True
    bandwidth_hz: Annotated[float, Field(gt=0)] | None = None
    bootstrap: Annotated[int, Field(ge=0, le=1000)] = 18
    forgetting: Annotated[float, Field(gt=0, le=1)] = 1.0
    estimator: Annotated[str, Field(max_length=64)] = "gls"
    covariance: Literal["hac", "bootstrap", "white"] = "hac"
    prior: None = None
    columns: None = None
    resample: bool = False


class IdentificationOrder(Body, json_schema_extra=ORDER_EXAMPLE):
    """What to identify."""

    machine: MachineName
    recordings: RecordingChoices
    options: IdentificationOptions = IdentificationOptions()
    label: Label = ""


class IdentificationResource(Identification):
    """An identification; ``verdict`` and ``overall`` are there once its job is done."""


class IdentificationList(Listed[IdentificationResource]):
    """A page of identifications."""
