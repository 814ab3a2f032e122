"""A load-holding valve that throttles while an overrunning load is lowered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.effects.base import DriveView, Effect, FloatArray, Parameter, Shape


class CounterbalanceValve(Effect):
    """A load-holding valve that throttles while an overrunning load is lowered."""

    id = "counterbalance_valve"
    title = "a counterbalance valve that throttles while lowering"
    level = "cylinder"
    needs_cylinder = True
    variable = "cylinder_force"
    equation = "(b_0 + b_1 |v|) [v < 0][F^ > 0], or mirrored"
    parity = "only while an overrunning load is lowered"
    parameters = (
        Parameter("b_0", "N"),
        Parameter("b_1", "N s/m"),
    )
    confounders = ("asymmetric_friction",)
    experiment = "move the sensor to the cylinder port"
    source = "ISO 8643 (load-holding valves of earth-moving machinery)"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Grid of shapes; see :class:`Effect`."""
        return ({"side": 1.0}, {"side": -1.0})

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Columns (N, k); see :class:`Effect`."""
        side = shape["side"]
        lowering = 0.5 * (1.0 - side * view.s) * (side * view.load > 0)
        return np.column_stack([lowering, lowering * np.abs(view.v)])
