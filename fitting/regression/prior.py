"""Prior knowledge, before any measurement: a plausible arm, a cylinder's moving mass, and by how much efforts are late.

Links and drives are drawn toward a plausible arm (:mod:`fitting.regression.plausible_arm`): rows at the point that the
data and it find most probable together, at the end of the last joint's, before those of its mass and delay.

In a recording that moves slowly, the moving mass of a cylinder is all but invisible, and its estimate trades off
against the stiffness (`x''` and `x` are opposite in a sine). But a piston and its rod are made of steel, and the
machine file gives their size: a rod as long as 1.2 strokes and a piston as long as its bore, give or take half. That
enters as one more row per cylinder, of the weight of its uncertainty; data that determine the mass outweigh it.

Where a joint's efforts come over another bus than its positions, and the machine file gives by how much that bus is
behind (``delays``, measured once by ``hilfit bus check``), that is a measurement of the joint's delay: one more row,
the last of the joint's, which no column of the base model explains, but that of a delay does. So an explanation without
a delay pays for the buses' delays, one with another delay pays for the difference, and its value is drawn to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from daq.machine.machine_file import Cylinder, Machine
from fitting.arrays import FloatArray
from fitting.regression.design import Parameters
from fitting.regression.drive import drive_names
from fitting.regression.plausible_arm import Optimum, PlausibleArm
from fitting.regression.solving import WhiteRows

#: Where a model holds a joint's delay: its column, and the seconds by which its efforts were moved already.
Late = tuple[int, float]

_STEEL, _OIL = 7850.0, 870.0  # kg/m^3
_RELATIVE_STD = 0.4


@dataclass(frozen=True)
class Prior:
    """Prior values of each joint; NaN where there are none.

    Attributes
    ----------
    mass, std : (n,) moving mass in kg, and its standard deviation
    delay, delay_std : (n,) s by which its efforts are later than its positions, and its standard deviation; None: of no
        joint
    arm : the plausible arm, None where no effort was measured yet
    point : where the arm's prior is taken as rows; None for no such rows
    refused : True where the recordings refuse the arm, and least squares is kept
        (:meth:`fitting.estimators.effort_fit.EffortRows.settled`)
    """

    mass: FloatArray
    std: FloatArray
    delay: FloatArray | None = None
    delay_std: FloatArray | None = None
    arm: PlausibleArm | None = field(default=None, repr=False)
    point: Optimum | None = field(default=None, repr=False)
    refused: bool = False

    def delay_of(self, joint: int) -> tuple[float, float] | None:
        """Return a joint's expected delay of efforts and its standard deviation, s."""
        if self.delay is None or self.delay_std is None or np.isnan(self.delay[joint]):
            return None
        return float(self.delay[joint]), float(self.delay_std[joint])

    def own_rows(self, joint: int) -> int:
        """Count the rows of a joint's mass and delay at its block's end."""
        return int(not np.isnan(self.mass[joint])) + int(self.delay_of(joint) is not None)

    def undelayed(self) -> Prior:
        """Return the same without delays: of replicas, whose efforts and positions match."""
        return self if self.delay is None else replace(self, delay=0.0 * self.delay)

    def settled(self, A: FloatArray, b: FloatArray) -> Prior:
        """Return the prior at the point of these unit-noise rows (all other priors among them) and the arm."""
        if self.arm is None or self.refused:
            return self
        return replace(self, point=self.arm.optimum(A, b, self.point))

    def unsettled(self) -> Prior:
        """Return the same without the arm's rows."""
        return self if self.point is None else replace(self, point=None)

    def arm_rows(self, columns: int) -> tuple[FloatArray, FloatArray]:
        """Return the arm's prior as unit-noise rows, (R, columns) and (R,); none without point."""
        if self.point is None:
            return np.zeros((0, columns)), np.zeros(0)
        A, b = self.point.rows
        return np.hstack([A, np.zeros((len(A), columns - A.shape[1]))]), b


def moving_mass(cylinder: Cylinder) -> float:
    """Estimate the mass in kg of a steel piston and rod of this size, and of the oil moved."""
    rod = cylinder.rod**2 * 1.2 * cylinder.stroke
    piston = cylinder.bore**2 * cylinder.bore
    oil = cylinder.bore**2 * cylinder.stroke
    return float(np.pi / 4 * (_STEEL * (rod + piston) + _OIL * oil))


def mass_prior(machine: Machine) -> Prior:
    """Build the prior of cylinders whose mass the machine file omits."""
    names = drive_names(machine)
    mass = np.array(
        [
            moving_mass(joint.cylinder) if joint.cylinder is not None and "m" in own else np.nan
            for joint, own in zip(machine.joints, names, strict=True)
        ]
    )
    return Prior(mass, _RELATIVE_STD * mass)


def prior_row(parameters: Parameters, prior: Prior, joint: int, columns: int) -> tuple[FloatArray, float] | None:
    """Return a joint's prior as a unit-noise row: its ``columns`` coefficients and target; None without a prior."""
    if np.isnan(prior.mass[joint]):
        return None
    row = np.zeros(columns)
    row[parameters.drive_slice(joint).start + parameters.drive[joint].index("m")] = 1.0 / prior.std[joint]
    return row, float(prior.mass[joint] / prior.std[joint])


def _delay_row(prior: Prior, joint: int, columns: int, late: Late | None) -> tuple[FloatArray, float] | None:
    """Return the buses' prior of a joint's delay as a unit-noise row; ``late`` is the term that explains it."""
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


def data_share(covariance: FloatArray, parameters: Parameters, prior: Prior) -> FloatArray:
    """Compute each parameter's share (p,) of information from data: ``1 - (L H^-1)_ii``.

    Parameters
    ----------
    covariance : (p, p) ``H^-1``, of rows of unit noise and the prior's together
    prior : whose rows have the information ``L``
    """
    A, _ = rows_of_prior(parameters, prior, len(covariance))
    known = A.T @ A
    return np.asarray(np.clip(1.0 - np.einsum("ij,ji->i", known, covariance), 0.0, 1.0))


def rows_of_prior(parameters: Parameters, prior: Prior, width: int) -> tuple[FloatArray, FloatArray]:
    """Return the prior as rows of unit noise, (R, width) and (R,)."""
    nothing = [WhiteRows(np.zeros((0, width)), np.zeros(0), ()) for _ in parameters.joints]
    rows = with_prior(nothing, parameters, prior)
    return np.vstack([own.A for own in rows]), np.concatenate([own.b for own in rows])


def with_prior(
    rows: Sequence[WhiteRows], parameters: Parameters, prior: Prior, late: Mapping[int, Late] | None = None
) -> tuple[WhiteRows, ...]:
    """Append the plausible arm's rows to the last joint's, then one more per joint for each of its own priors (mass,
    then delay: the last rows of each joint's block).

    Parameters
    ----------
    late : by joint, the column that holds its delay, and the seconds by which its efforts were moved already
    """
    result = []
    for joint, own in enumerate(rows):
        width = own.A.shape[1]
        if joint == len(rows) - 1:
            A, b = prior.arm_rows(width)
            own = WhiteRows(np.vstack([own.A, A]), np.concatenate([own.b, b]), own.sections)
        known = (prior_row(parameters, prior, joint, width), _delay_row(prior, joint, width, (late or {}).get(joint)))
        for row in known:
            if row is not None:
                own = WhiteRows(np.vstack([own.A, row[0]]), np.append(own.b, row[1]), own.sections)
        result.append(own)
    return tuple(result)


POSITIONS = ("joint_position", "piston_position", "motor_position")
#: s, standard deviation of what a transmitter's own filter adds, of which buses know nothing: response times of
#: hydraulic pressure transmitters are 1 to 30 ms.
OWN_FILTER_S = 0.01
EFFORTS = ("head_pressure", "rod_pressure", "cylinder_force", "joint_effort", "motor_effort")


def expected_delays(machine: Machine) -> tuple[FloatArray, FloatArray] | None:
    """Return seconds (n,) by which efforts lag each joint's positions, and standard deviations (n,).

    NaN where the machine file lacks the two buses, where efforts or positions come over several buses, and
    where efforts would be earlier: then positions are late, which no effect of a joint is. None: of no joint.

    Delays are those between buses; deviations hold :data:`OWN_FILTER_S` as well.
    """
    if not machine.delays:
        return None
    delay, std = np.full(len(machine.joints), np.nan), np.full(len(machine.joints), np.nan)
    for number, joint in enumerate(machine.joints):
        positions, efforts = _buses(machine, joint.name, POSITIONS), _buses(machine, joint.name, EFFORTS)
        if len(positions) == len(efforts) == 1:
            behind = _behind(machine, efforts.pop(), positions.pop())
            if behind is not None and behind[0] > -2.0 * behind[1]:
                delay[number], std[number] = behind[0], float(np.hypot(behind[1], OWN_FILTER_S))
    return None if np.isnan(delay).all() else (delay, std)


def _buses(machine: Machine, joint: str, quantities: tuple[str, ...]) -> set[str]:
    own = [c for c in machine.channels if c.joint == joint and c.quantity in quantities]
    return {"" if c.source is None else c.source.bus for c in own}


def _behind(machine: Machine, bus: str, base: str) -> tuple[float, float] | None:
    """Compute the lag of ``bus`` behind ``base``, s, and standard deviation, along the fewest known delays."""
    reached: dict[str, tuple[float, float]] = {base: (0.0, 0.0)}
    edge = [base]
    while edge and bus not in reached:
        here = edge.pop(0)
        for delay in machine.delays:
            for other, near, sign in ((delay.bus, delay.behind, 1.0), (delay.behind, delay.bus, -1.0)):
                if near == here and other not in reached:
                    seconds, variance = reached[here]
                    reached[other] = (seconds + sign * delay.seconds, variance + delay.std**2)
                    edge.append(other)
    if bus == base or bus not in reached:
        return None
    seconds, variance = reached[bus]
    return seconds, float(np.sqrt(variance))
