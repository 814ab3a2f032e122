from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class CounterbalanceValve(Effect):
    """A load-holding valve that throttles while an overrunning load is lowered."""

    id = "counterbalance_valve"
    title = "a counterbalance valve that throttles while lowering"
    level = "cylinder"
    needs_cylinder = True
    variable = "cylinder_force"
    equation = "-(b_0 + b_1 |v|) [v < 0] tanh(max(F_l, 0) / F_0), or mirrored; F_0 = 0: [F_l > 0]"
    parity = Parity.OTHER
    dependence = "only while an overrunning load is lowered"
    parameters = (Parameter("b_0", "N", low=0.0), Parameter("b_1", "N s/m", low=0.0))
    discrete_shapes = frozenset({"side"})
    confounders = ("asymmetric_friction",)
    experiment = "move the sensor to the cylinder port"
    by_motion = False
    look_at = "the load-holding valve: its setting, and on which side of it the pressure is measured"
    source = "ISO 8643 (load-holding valves of earth-moving machinery)"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        # A valve opens over a band of load; were it as wide as the largest load, it would be friction under load.
        return [{"side": side, "band": band} for side in (1.0, -1.0) for band in (0.0, 0.1, 0.4)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        side, band = shape["side"], shape.get("band", 0.0) * max(view.range.force, 1e-12)
        load = np.maximum(side * view.load, 0.0)
        open_share = np.tanh(load / band) if band else (load > 0).astype(float)
        lowering = -side * 0.5 * (1.0 - side * view.s) * open_share  # it holds: against the motion
        return np.column_stack([lowering, lowering * np.abs(view.v)])
