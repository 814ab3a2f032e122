from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class CrossCylinderCoupling(Effect):
    """Another cylinder's flow moves this cylinder's pressures: a shared return line."""

    id = "cross_cylinder_coupling"
    title = "another cylinder's flow acting on this one's pressures"
    level = "cylinder"
    needs_cylinder = True
    variable = "other.piston_speed"
    series = True
    uses_model = False
    equation = "b_1 |v_k| + b_2 v_k^2 + b_3 v_k + b_4 v_k |v_k|"
    parity = Parity.OTHER
    dependence = "follows a neighbour's speed"
    parameters = (
        Parameter("b_1", "N s/m"),
        Parameter("b_2", "N s^2/m^2"),
        Parameter("b_3", "N s/m"),
        Parameter("b_4", "N s^2/m^2"),
    )
    discrete_shapes = frozenset({"other"})
    experiment = "move the neighbour alone"
    look_at = "the return line that both cylinders share: hose bore, filter, back-pressure"
    source = "Merritt, Hydraulic Control Systems, 1967 (line losses)"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        speed = view.segment.v[:, int(shape["other"])]
        return np.column_stack([np.abs(speed), speed**2, speed, speed * np.abs(speed)])

    def possible(self, values: Sequence[float], stds: Sequence[float]) -> float:
        """Compute the share of values with which a line's loss grows at least like the flow.

        Then the linear and the quadratic part push the same way, in the even and in the odd part each.
        """
        over, under = (scipy.special.ndtr(sign * np.asarray(values) / np.maximum(stds, 1e-300)) for sign in (1.0, -1.0))
        return float(np.prod([over[n] * over[n + 1] + under[n] * under[n + 1] for n in (0, 2)]))
