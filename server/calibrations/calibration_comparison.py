"""Two calibrations side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from server.calibrations.calibration_content import Parameter
from server.platform.http.bodies import Shown


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
