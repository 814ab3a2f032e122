from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape, geometric


class Stribeck(Effect):
    """The bump of friction at low speed, before a lubricating film carries the seal."""

    id = "stribeck"
    title = "extra friction at low speed (Stribeck)"
    level = "cylinder"
    variable = "piston_speed"
    uses_model = False
    equation = "f_b exp(-|v / v_s|^delta) sgn v"
    parity = Parity.ODD
    dependence = "odd in v, only at low speed"
    parameters = (Parameter("f_b", "N", low=0.0),)
    shape_units = {"v_s": "m/s", "delta": "1"}
    discrete_shapes = frozenset({"delta"})
    confounders = ("velocity_root_friction", "presliding_hysteresis", "quadratic_loss")
    experiment = "a staircase of constant speeds below 5 mm/s"
    look_at = "seals and lubrication of the cylinder at low speed"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        low = max(4 * view.noise[view.joint].sign, 0.02 * view.range.v)
        speeds = geometric(low, max(0.5 * view.range.v, 1.5 * low), 7)
        return [{"v_s": speed, "delta": delta} for speed in speeds for delta in (1.0, 2.0)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        return (view.s * np.exp(-(np.abs(view.v / shape["v_s"]) ** shape["delta"])))[:, None]
