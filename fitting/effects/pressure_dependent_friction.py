from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class PressureDependentFriction(Effect):
    """Friction of seals that chamber pressure presses against the bore."""

    id = "pressure_dependent_friction"
    title = "friction that grows with the chamber pressure"
    level = "cylinder"
    needs_pressures = True
    variable = "head_pressure"
    equation = "beta p sgn v, p = p1 + p2, p1, p2, or max(p1, p2) + w p2 (piston seal and rod seal)"
    parity = Parity.ODD
    dependence = "odd in v; there even without a load"
    parameters = (Parameter("beta", "N/Pa", low=0.0, high=0.01),)
    discrete_shapes = frozenset({"head", "rod"})
    confounders = ("load_dependent_friction",)
    experiment = "change the back-pressure at constant load"
    by_motion = False
    look_at = "seals of the cylinder that chamber pressure presses: type and wear"
    source = "Nissing, seal friction of hydraulic cylinders; Zillen, TU Delft data set on seal friction"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        chambers = ({"head": 1.0, "rod": 1.0}, {"head": 1.0, "rod": 0.0}, {"head": 0.0, "rod": 1.0})
        # A piston seal is pressed on by the higher of both pressures, the rod's by its own chamber's.
        return (*chambers, *({"head": 0.0, "rod": 0.0, "rod_seal": share} for share in (0.2, 0.8)))

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        # p1 is rebuilt from the model's force, so the noise of neither chamber's own effort enters twice.
        if "rod_seal" in shape:
            pressure = np.maximum(view.p1, view.p2) + shape["rod_seal"] * view.p2
        else:
            pressure = shape["head"] * view.p1 + shape["rod"] * view.p2
        return (pressure * view.s)[:, None]
