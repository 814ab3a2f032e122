"""Two calibrations side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Shift:
    """A parameter in both; what one of them lacks is None."""

    name: str
    unit: str | None
    a: float | None
    a_std: float | None
    b: float | None
    b_std: float | None
    sigmas: float | None


def compare_parameters(a: Sequence[Mapping[str, Any]], b: Sequence[Mapping[str, Any]]) -> list[Shift]:
    """Every parameter of both, in the order of ``a``, then what only ``b`` has.

    ``sigmas = (b - a) / sqrt(std_a^2 + std_b^2)``: the two were estimated from different recordings, so their errors
    are independent. None where it is not known, or has no meaning because the units differ.
    """
    of_a, of_b = ({entry["name"]: entry for entry in entries} for entries in (a, b))
    return [_shift(name, of_a.get(name), of_b.get(name)) for name in {**of_a, **of_b}]


def compare_errors(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Per joint the unit and the error after the fit on ``validate``, of both (None where one lacks it)."""
    joints: dict[str, dict[str, Any]] = {}
    for joint in {**a, **b}:
        entry = a.get(joint) or b[joint]
        joints[joint] = {"unit": entry.get("unit"), "a": _error(a.get(joint)), "b": _error(b.get(joint))}
    return joints


def _error(entry: Mapping[str, Any] | None) -> float | None:
    value = ((entry or {}).get("after") or {}).get("validate")
    return None if value is None else float(value)


def _shift(name: str, a: Mapping[str, Any] | None, b: Mapping[str, Any] | None) -> Shift:
    first: Mapping[str, Any] = a or {}
    second: Mapping[str, Any] = b or {}
    sigmas = None
    both = [first.get("value"), second.get("value"), first.get("std"), second.get("std")]
    if None not in both and first.get("unit") == second.get("unit"):
        spread = math.hypot(float(both[2]), float(both[3]))  # type: ignore[arg-type]
        if spread > 0:
            sigmas = (float(both[1]) - float(both[0])) / spread  # type: ignore[arg-type]
    unit = first.get("unit", second.get("unit"))
    return Shift(name, unit, both[0], both[2], both[1], both[3], sigmas)
