from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class LoadDependentFriction(Effect):
    """Friction that grows with the force a cylinder carries: seals and bearings pressed harder."""

    id = "load_dependent_friction"
    title = "friction that grows with the load"
    level = "cylinder"
    variable = "cylinder_force"
    equation = (
        "mu g(F) sgn v, g = (hypot(F, F_0) - F_0) F_m / (hypot(F_m, F_0) - F_0), F = F^ or the load alone, "
        "F_m the largest |F^|"
    )
    parity = Parity.ODD
    dependence = "odd in v; gone when unloaded"
    discrete_shapes = frozenset({"load"})
    parameters = (Parameter("mu", "1", low=0.0, high=0.5),)
    confounders = ("position_dependent_friction", "pressure_dependent_friction", "linkage_geometry")
    experiment = "the same stroke with two loads"
    by_motion = False
    look_at = "seals and bearings of the cylinder and its pins: lubrication and wear under load"
    source = "Bittencourt and Axelsson, IEEE Trans. Robotics 30, 2014 (load-dependent joint friction)"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        # From friction in proportion to the load to one that starts with its square: a guide has play. Pins and the
        # rod's guide bear what the arm asks of the piston; the piston's own guide bears the seals' friction as well.
        return [{"load": alone, "knee": share} for alone in (0.0, 1.0) for share in (0.0, 0.1, 0.4, 1.6)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        largest = max(view.ranges[view.joint].force, 1e-12)
        load = np.abs(view.bending_force(friction=not shape.get("load"))) / largest
        knee = shape.get("knee", 0.0)
        pressed = (np.hypot(load, knee) - knee) / (np.hypot(1.0, knee) - knee)
        return np.asarray(largest * pressed * view.s)[:, None]
