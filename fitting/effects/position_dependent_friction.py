from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape

#: Powers of the position: a bore that is worn where the piston works most has a flat bottom and two steep sides.
ORDER = 5


class PositionDependentFriction(Effect):
    """Friction that depends on where the piston is: a bore that is not round, a rod that is worn."""

    id = "position_dependent_friction"
    title = "friction that depends on the piston position"
    level = "cylinder"
    variable = "piston_position"
    series = True
    uses_model = False
    equation = "(f_1 u + f_2 u^2 + f_3 u^3 + f_4 u^4 + f_5 u^5) sgn v, u = x - x_m"
    parity = Parity.ODD
    dependence = "odd in v, smooth in x"
    parameters = tuple(Parameter(f"f_{k}", f"N/m^{k}" if k > 1 else "N/m") for k in range(1, ORDER + 1))
    confounders = ("load_dependent_friction", "pose_dependent_friction")
    experiment = "move other joints so that load and position decorrelate"
    look_at = "bore, rod and guide of the cylinder where friction is high: a worn rod, a bore that is not round"
    source = "Armstrong-Helouvry, Control of Machines with Friction, 1991 (position-dependent friction)"

    def references(self, view: DriveView, shape: Shape) -> Mapping[str, tuple[float, str]]:
        return {"x_m": (view.range.middle, "m")}

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        offset = view.x - view.range.middle
        return np.column_stack([offset**k * view.s for k in range(1, ORDER + 1)])
