"""Friction of a cylinder and the pressures of its chambers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.truth import CylinderTruth, Hydraulics, Truth

# Half-width of the smoothed Coulomb jump in m/s: below the speed that smoothed 50 Hz encoders resolve (some 2e-5 m/s),
# so that what is measured is a jump.
REVERSAL_SPEED = 1.0e-5


def direction(v: FloatArray, width: float = REVERSAL_SPEED) -> FloatArray:
    """Smooth the sign of the speed ``v`` (m/s) over ``width``: no jump of force between two samples."""
    return np.tanh(v / width)


@dataclass(frozen=True)
class CylinderBank:
    """The cylinders of an arm side by side, arrays (J,); a joint without one has zeros and counts as ``driven``."""

    head_area: FloatArray  # m^2
    rod_area: FloatArray
    m: FloatArray  # kg
    c: FloatArray  # N s/m
    K: FloatArray  # N/m
    f_c: FloatArray  # N
    f_v: FloatArray  # N s/m
    f_s: FloatArray  # N (s/m)^(1/3)
    driven: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, machine: Machine, truth: Truth) -> CylinderBank:
        """Combine declared sizes and dampings with true laws."""
        none = CylinderTruth(0.0, 0.0, 0.0, 0.0, 0.0)
        cylinders = [joint.cylinder for joint in machine.joints]
        laws = [truth.cylinders[j.name] if j.cylinder is not None else none for j in machine.joints]
        return cls(
            # A driven joint gets areas of 1 m^2 so that formulas stay finite; nobody reads its pressures.
            head_area=np.array([1.0 if c is None else c.head_area for c in cylinders]),
            rod_area=np.array([1.0 if c is None else c.rod_area for c in cylinders]),
            c=np.array([0.0 if c is None else c.damping for c in cylinders]),
            driven=np.array([c is None for c in cylinders]),
            **{key: np.array([getattr(law, key) for law in laws]) for key in ("m", "K", "f_c", "f_v", "f_s")},
        )

    def resistance(self, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Compute ``m x'' + c x' + K x + F_d(x')`` in N of piston motions (n, J); zero for drives.

        ``F_d(v) = f_c sgn v + f_v v + f_s |v|^(1/3) sgn v``.
        """
        friction = self.f_c * direction(v) + self.f_v * v + self.f_s * np.cbrt(v)
        return self.m * a + self.c * v + self.K * x + friction


def chamber_pressures(
    force: FloatArray, v: FloatArray, head_area: npt.ArrayLike, rod_area: npt.ArrayLike, hydraulics: Hydraulics
) -> tuple[FloatArray, FloatArray]:
    """Compute chamber pressures that give ``force = p1 A1 - p2 A2``.

    The valve meters out: the chamber that empties keeps a preload above tank plus the loss of its edge, quadratic
    in flow; the chamber that fills never falls below the anti-cavitation floor. Whichever chamber carries the load
    takes the rest of the force, so both remain positive and the force is met exactly.

    Parameters
    ----------
    force : array
        Hydraulic force in N, positive when it extends the rod.
    v : array
        Piston speed in m/s, positive when extending.
    head_area, rod_area : float or arrays that broadcast
        A1 and A2 in m^2.

    Returns
    -------
    p1, p2 : arrays
        Head and rod pressure in Pa.
    """
    area1, area2 = np.asarray(head_area, dtype=float), np.asarray(rod_area, dtype=float)
    floor = hydraulics.tank + hydraulics.head_floor
    # Flow through the edge of the emptying chamber, per unit of head area: a valve is sized for its cylinder.
    outflow_rod = np.maximum(v, 0.0) * area2 / area1
    outflow_head = np.maximum(-v, 0.0)
    back_rod = hydraulics.tank + hydraulics.preload + hydraulics.loss * outflow_rod**2
    back_head = floor + 0.5 * hydraulics.loss * outflow_head**2
    p1 = (force + back_rod * area2) / area1
    # Smooth maximum of the wanted head pressure and its floor: the check valve opens over a few tenths of a bar.
    width = 0.02e6
    p1 = 0.5 * (p1 + back_head + np.sqrt((p1 - back_head) ** 2 + width**2))
    p2 = (p1 * area1 - force) / area2
    return p1, p2


def supply_pressure(flow: FloatArray, hydraulics: Hydraulics) -> FloatArray:
    """Compute the supply line's pressure in Pa at a total inflow of ``flow`` m^3/s."""
    return np.maximum(hydraulics.supply - hydraulics.droop * flow, hydraulics.tank)


def oil_temperature(time: FloatArray, hydraulics: Hydraulics) -> FloatArray:
    """Compute the oil temperature in K, ``time`` seconds after a cold start."""
    return hydraulics.ambient + hydraulics.heating * (1.0 - np.exp(-np.maximum(time, 0.0) / hydraulics.warm_up))
