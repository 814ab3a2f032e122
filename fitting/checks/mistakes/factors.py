"""Discrete explanations of a continuous number: which mistake a gain looks like."""

from __future__ import annotations

import numpy as np

_DEGREE = 180.0 / np.pi
#: Units of a quantity, by its SI unit, with their size in SI.
_UNITS: dict[str, dict[str, float]] = {
    "Pa": {"bar": 1e5, "kPa": 1e3, "psi": 6894.757, "MPa": 1e6, "hPa (mbar)": 1e2, "Pa": 1.0},
    "rad": {"rad": 1.0, "deg": 1 / _DEGREE, "mrad": 1e-3, "turn": 2 * np.pi, "grad": np.pi / 200},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "um": 1e-6},
    "N": {"N": 1.0, "kN": 1e3, "kgf": 9.80665, "lbf": 4.448222},
    "N m": {"N m": 1.0, "kN m": 1e3, "N mm": 1e-3, "kgf m": 9.80665, "lbf ft": 1.355818, "N cm": 1e-2},
}
#: Units that people seldom use: a common one that fits nearly as well is said instead.
RARE = ("grad", "turn", "mrad", "um", "hPa (mbar)", "inch", "N cm")


def gains(si_unit: str, declared: float) -> dict[float, str]:
    """Return the factors for SI values, by the unit they may have been in instead of the declared one.

    Parameters
    ----------
    declared : size of the declared unit in SI
    """
    return {size / declared: unit for unit, size in _UNITS.get(si_unit, {}).items() if abs(size / declared - 1) > 0.05}
