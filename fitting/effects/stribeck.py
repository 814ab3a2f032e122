from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape, geometric


class Stribeck(Effect):
    """The bump of friction at low speed, before a lubricating film carries the seal.

    The three forms in use: exponential (Tustin), Gaussian, and with a ``tail`` that of Hess and Soom.
    """

    id = "stribeck"
    title = "extra friction at low speed (Stribeck)"
    level = "cylinder"
    variable = "piston_speed"
    uses_model = False
    equation = "f_b g(|v / v_s|) sgn v; g(x) = exp(-x^delta), 1 / (1 + x^2)"
    parity = Parity.ODD
    dependence = "odd in v, only at low speed"
    parameters = (Parameter("f_b", "N", low=0.0),)
    shape_units = {"v_s": "m/s", "delta": "1"}
    discrete_shapes = frozenset({"delta", "tail"})
    confounders = ("velocity_root_friction", "presliding_hysteresis", "quadratic_loss")
    experiment = "a staircase of constant speeds below 5 mm/s"
    look_at = "seals and lubrication of the cylinder at low speed"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994; Hess, Soom, J. Tribology 112, 1990"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        low = max(4 * view.noise[view.joint].sign, 0.02 * view.range.v)
        speeds = geometric(low, max(0.5 * view.range.v, 1.5 * low), 7)
        forms = ({"delta": 1.0, "tail": 0.0}, {"delta": 2.0, "tail": 0.0}, {"delta": 2.0, "tail": 1.0})
        return [{"v_s": speed, **form} for speed in speeds for form in forms]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        x = np.abs(view.v / shape["v_s"]) ** shape["delta"]
        return (view.s * (1.0 / (1.0 + x) if shape.get("tail") else np.exp(-x)))[:, None]
