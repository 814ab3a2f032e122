"""What is known before any measurement: a cylinder's moving mass, and by how much efforts are late.

In a recording that moves slowly, the moving mass of a cylinder is all but invisible, and its estimate trades off
against the stiffness (`x''` and `x` are opposite in a sine). But a piston and its rod are made of steel, and the
machine file gives their size: a rod as long as 1.2 strokes and a piston as long as its bore, give or take half. That
enters as one more row per cylinder, of the weight of its uncertainty; data that can tell the mass outweigh it.

Where a joint's efforts come over another bus than its positions, and the machine file says by how much that bus is
behind (``delays``, measured once by ``hilfit bus check``), that is a measurement of the joint's delay: one more row,
the last of the joint's, which no column of the base model explains, but that of a delay does. So an explanation without
a delay pays for what the buses say, one with another delay pays for the difference, and its value is drawn towards it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Cylinder, Machine
from fitting.regression.design import Parameters
from fitting.regression.drive import drive_names
from fitting.regression.solving import WhiteRows

FloatArray = npt.NDArray[np.float64]

#: Where a model holds a joint's delay: its column, and the seconds by which its efforts were moved already.
Late = tuple[int, float]

_STEEL, _OIL = 7850.0, 870.0  # kg/m^3
_RELATIVE_STD = 0.4


@dataclass(frozen=True)
class Prior:
    """What is expected of each joint; NaN where nothing is.

    Attributes
    ----------
    mass, std : (n,) moving mass in kg, and its standard deviation
    delay, delay_std : (n,) s by which its efforts are later than its positions, and its standard deviation; None: of no
        joint
    """

    mass: FloatArray
    std: FloatArray
    delay: FloatArray | None = None
    delay_std: FloatArray | None = None

    def delay_of(self, joint: int) -> tuple[float, float] | None:
        """Expected delay of a joint's efforts and its standard deviation, s."""
        if self.delay is None or self.delay_std is None or np.isnan(self.delay[joint]):
            return None
        return float(self.delay[joint]), float(self.delay_std[joint])

    def undelayed(self) -> Prior:
        """The same where nothing is late: of replicas, whose efforts and positions belong together."""
        return self if self.delay is None else replace(self, delay=0.0 * self.delay)


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


def delay_row(prior: Prior, joint: int, columns: int, late: Late | None) -> tuple[FloatArray, float] | None:
    """What the buses say of a joint's delay as one row of unit noise; ``late`` is the term that can explain it."""
    expected = prior.delay_of(joint)
    if expected is None:
        return None
    seconds, std = expected
    row = np.zeros(columns)
    if late is not None:
        column, moved = late
        row[column] = 1.0 / std
        seconds -= moved
    return row, seconds / std


def with_prior(
    rows: Sequence[WhiteRows], parameters: Parameters, prior: Prior, late: Mapping[int, Late] | None = None
) -> tuple[WhiteRows, ...]:
    """The rows with one more per joint for each of its priors (mass, then delay: the last rows of each joint's block).

    Parameters
    ----------
    late : by joint, the column that holds its delay, and the seconds by which its efforts were moved already
    """
    result = []
    for joint, own in enumerate(rows):
        width = own.A.shape[1]
        known = (prior_row(parameters, prior, joint, width), delay_row(prior, joint, width, (late or {}).get(joint)))
        for row in known:
            if row is not None:
                own = WhiteRows(np.vstack([own.A, row[0]]), np.append(own.b, row[1]), own.sections)
        result.append(own)
    return tuple(result)
