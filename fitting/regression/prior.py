"""What is known before any measurement: a cylinder's moving mass.

In a recording that moves slowly, the moving mass of a cylinder is all but invisible, and its estimate trades off
against the stiffness (`x''` and `x` are opposite in a sine). But a piston and its rod are made of steel, and the
machine file gives their size: a rod as long as 1.2 strokes and a piston as long as its bore, give or take half. That
enters as one more row per cylinder, of the weight of its uncertainty; data that can tell the mass outweigh it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.machine_file import Cylinder, Machine
from fitting.regression.design import Parameters, WhiteRows
from fitting.regression.drive import drive_names

FloatArray = npt.NDArray[np.float64]

_STEEL, _OIL = 7850.0, 870.0  # kg/m^3
_RELATIVE_STD = 0.4


@dataclass(frozen=True)
class Prior:
    """Per joint the expected moving mass in kg and its standard deviation; NaN where nothing is expected."""

    mass: FloatArray
    std: FloatArray


def moving_mass(cylinder: Cylinder) -> float:
    """Mass in kg of a steel piston and rod of the cylinder's size, and of the oil that moves with them."""
    rod = cylinder.rod**2 * 1.2 * cylinder.stroke
    piston = cylinder.bore**2 * cylinder.bore
    oil = cylinder.bore**2 * cylinder.stroke
    return float(np.pi / 4 * (_STEEL * (rod + piston) + _OIL * oil))


def mass_prior(machine: Machine) -> Prior:
    """Prior of every cylinder whose moving mass the machine file does not give."""
    names = drive_names(machine)
    mass = np.array(
        [
            moving_mass(joint.cylinder) if joint.cylinder is not None and "m" in own else np.nan
            for joint, own in zip(machine.joints, names, strict=True)
        ]
    )
    return Prior(mass, _RELATIVE_STD * mass)


def prior_row(parameters: Parameters, prior: Prior, joint: int, columns: int) -> tuple[FloatArray, float] | None:
    """A joint's prior as one row of unit noise: its ``columns`` coefficients and its target; None without a prior."""
    if np.isnan(prior.mass[joint]):
        return None
    row = np.zeros(columns)
    row[parameters.drive_slice(joint).start + parameters.drive[joint].index("m")] = 1.0 / prior.std[joint]
    return row, float(prior.mass[joint] / prior.std[joint])


def with_prior(rows: Sequence[WhiteRows], parameters: Parameters, prior: Prior) -> tuple[WhiteRows, ...]:
    """The rows with one more per joint for its prior (last row of each joint's block)."""
    result = []
    for joint, own in enumerate(rows):
        row = prior_row(parameters, prior, joint, own.A.shape[1])
        if row is None:
            result.append(own)
            continue
        result.append(WhiteRows(np.vstack([own.A, row[0]]), np.append(own.b, row[1]), own.sections))
    return tuple(result)
