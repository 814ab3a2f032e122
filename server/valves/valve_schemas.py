"""What the routes of valves take and give."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from server.identifications.identification_schemas import ORDER_EXAMPLE, RecordingChoices
from server.platform.authorization.named_things import MachineName
from server.platform.http.bodies import Body, Flag, Label, Listed
from server.valves.valve_fits import ValveFit


class ValveOptions(Body):
    """Choices: ``loop``: look for effects. ``bandwidth_hz``: of the filter; 3 Hz, or a fifth of a slower rate."""

    loop: Flag = True
    bandwidth_hz: Annotated[float, Field(gt=0)] | None = None


class ValveOrder(Body, json_schema_extra=ORDER_EXAMPLE):
    """Whose valves to identify, from recordings with commands; those in the role ``validate`` are judged on."""

    machine: MachineName
    recordings: RecordingChoices
    options: ValveOptions = ValveOptions()
    label: Label = ""


class ValveResource(ValveFit):
    """An identification of valves; ``axes`` are there, by joint, once its job is done."""


class ValveList(Listed[ValveResource]):
    """A page of identifications of valves."""
