"""Identifications of valves in the store, as orders, as jobs, and what they left."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel

from fitting.pipeline.stage_names import VALVE_REPORT
from server.identifications.identification_job import FitKind
from server.identifications.identification_order import Orders
from server.identifications.identification_results import FitResults
from server.identifications.identification_store import Fit, Fits, recordings_table


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

    verdict: Literal["nothing_missing", "effect_added", "ambiguous", "unexplained"]
    handed_out: Literal["model", "before", "static"]
    error: float
    judged_on: Literal["train", "validate"]
    delay: float
    edges: dict[str, float]
    speeds: dict[str, float]
    effects: list[ValveEffect]


class ValveFit(Fit, table="valves", noun="identification of valves"):
    """One identification of valves; ``axes`` is what the report says of each, in short."""

    axes: dict[str, ValveAxis] | None = None


valves, valve_recordings = ValveFit.table, recordings_table("valve", "valves")


class ValveFits(Fits[ValveFit]):
    """Repository of identifications of valves."""

    of, one, used = ValveFit, "valve", valve_recordings


class ValveOrders(Orders[ValveFit]):
    """Orders of them: whatever moved the axes, and, to judge by, another motion in the role ``validate``."""

    fits, prefix, label, kind = ValveFits, "vlv", "Valves of {}", ("valve",)
    needed = (("train", "operation", "repeat", "unloaded"),)


class ValveKind(FitKind):
    """One stage, which leaves the report and the inverses."""

    name, fits, report = "valve", ValveFits, VALVE_REPORT

    def outcome(self, report: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a list shows of each axis."""
        return {"axes": {joint: _summary(axis) for joint, axis in report["axes"].items()}}


class ValveResults(FitResults):
    """Their files."""

    fits = ValveFits


def _summary(axis: Mapping[str, Any]) -> dict[str, Any]:
    moving = {way: own for way, own in axis["directions"].items() if own["moves"]}
    return {
        "verdict": axis["verdict"],
        "handed_out": axis["handed_out"],
        "error": axis["errors"]["handed_out"],
        "judged_on": axis["errors"]["role"],
        "delay": axis["delay"]["value"],
        "edges": {way: own["edge_at_2_percent"]["value"] for way, own in moving.items()},
        "speeds": {way: own["speed_at_largest"]["value"] for way, own in moving.items()},
        "effects": [{"id": own["id"], "probability": own["probability"]} for own in axis["effects"]],
    }
