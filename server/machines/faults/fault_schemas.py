"""What ``/machines/{name}/faults`` takes and gives."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field


class FaultOffer(BaseModel):
    """A fault that the simulated machine can have: its name, what it is of, and its keys of a fault file."""

    fault: str
    target: str
    entry: dict[str, Any]


class MachineFaults(BaseModel):
    """What can be broken, and what is: keys of a fault file, with ``left_s`` seconds until it is over.

    ``simulated`` is false for a machine of this world, which has no offers.
    """

    simulated: bool
    offers: list[FaultOffer]
    running: list[dict[str, Any]]


class FaultWish(
    BaseModel,
    json_schema_extra={
        "examples": [{"faults": [{"at": 0, "for": 5, "fault": "node_death", "bus": "can", "node": 31}]}]
    },
):
    """Faults to begin, with the keys of a fault file (``hilfit/faults/1``); ``at`` counts from now.

    ``{"faults": [{"at": 0, "for": 5, "fault": "node_death", "bus": "can", "node": 31}]}``
    """

    model_config = ConfigDict(extra="forbid")

    faults: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=20)]
