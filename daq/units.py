"""Units at the edges: channels declare any unit that pint knows, everything inside is SI."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

SI_UNITS: dict[str, str] = {
    "joint_position": "rad",  # m for a prismatic joint
    "piston_position": "m",
    "head_pressure": "Pa",
    "rod_pressure": "Pa",
    "cylinder_force": "N",
    "joint_effort": "N m",  # N for a prismatic joint
    "motor_position": "rad",
    "motor_effort": "N m",
    "external_force": "N",
    "oil_temperature": "K",
    "supply_pressure": "Pa",
    "tank_pressure": "Pa",
    "base_roll": "rad",
    "base_pitch": "rad",
}


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


@dataclass(frozen=True)
class Conversion:
    """Affine conversion into SI: ``si = factor * value + offset``."""

    factor: float
    offset: float

    def to_si(self, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Values in the declared unit, as SI."""
        return self.factor * np.asarray(values, dtype=float) + self.offset

    def from_si(self, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """SI values, in the declared unit."""
        return (np.asarray(values, dtype=float) - self.offset) / self.factor


@lru_cache(maxsize=256)
def conversion(unit: str, si_unit: str) -> Conversion:
    """Conversion from ``unit`` to ``si_unit``.

    Raises
    ------
    ValueError
        If pint does not know the unit, or it measures something else.
    """
    if unit == si_unit:
        return Conversion(factor=1.0, offset=0.0)  # most channels; loading pint takes a second
    import pint

    registry = _registry()
    try:
        zero = float(registry.Quantity(0.0, unit).to(si_unit).magnitude)
        one = float(registry.Quantity(1.0, unit).to(si_unit).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"unit '{unit}' cannot be turned into {si_unit}") from None
    except Exception:  # its parser raises whatever Python's tokenizer or an assertion makes of the text
        raise ValueError(f"unknown unit '{unit}'; use one that measures {si_unit}") from None
    return Conversion(factor=one - zero, offset=zero)
