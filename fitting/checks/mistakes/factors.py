"""Discrete explanations of a continuous number: which mistake a gain looks like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_DEGREE = 180.0 / np.pi


@dataclass(frozen=True)
class Factor:
    """What was written, and what it should have been, if values have to be multiplied by ``gain``."""

    gain: float
    says: str


PRESSURE = (
    Factor(1e5, "bar"),
    Factor(1e3, "kPa"),
    Factor(6894.757, "psi"),
    Factor(1e6, "MPa"),
    Factor(1e2, "hPa (mbar)"),
    Factor(1.0, "Pa"),
)
ANGLE = (Factor(1.0, "rad"), Factor(1 / _DEGREE, "deg"), Factor(1e-3, "mrad"), Factor(2 * np.pi, "turn"),
         Factor(np.pi / 200, "grad"))  # fmt: skip
LENGTH = (Factor(1.0, "m"), Factor(1e-3, "mm"), Factor(1e-2, "cm"), Factor(0.0254, "inch"), Factor(1e-6, "um"))
FORCE = (Factor(1.0, "N"), Factor(1e3, "kN"), Factor(9.80665, "kgf"), Factor(4.448222, "lbf"))
TORQUE = (Factor(1.0, "N m"), Factor(1e3, "kN m"), Factor(1e-3, "N mm"), Factor(9.80665, "kgf m"),
          Factor(1.355818, "lbf ft"), Factor(1e-2, "N cm"))  # fmt: skip


def family(si_unit: str) -> tuple[Factor, ...]:
    """Units of a quantity with their size in SI."""
    return {"Pa": PRESSURE, "rad": ANGLE, "m": LENGTH, "N": FORCE, "N m": TORQUE}.get(si_unit, ())


#: Units that people seldom use: a common one that fits nearly as well is said instead.
RARE = ("grad", "turn", "mrad", "um", "hPa (mbar)", "inch", "N cm")


def gains(si_unit: str, declared: float) -> dict[float, str]:
    """Numbers that SI values have to be multiplied with, if the values were in another unit than declared.

    Parameters
    ----------
    declared : size of the declared unit in SI
    """
    return {own.gain / declared: own.says for own in family(si_unit) if abs(own.gain / declared - 1) > 0.05}
