"""What the routes of excitations take and give."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from server.excitations.excitation_store import Excitation
from server.platform.authorization.named_things import MachineName
from server.platform.http.bodies import Body, Label, Listed


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
