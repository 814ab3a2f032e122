from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class QuadraticLoss(Effect):
    """Turbulent loss between pressure port and chamber: grows with the square of the speed."""

    id = "quadratic_loss"
    title = "a flow loss that grows with the square of the speed"
    level = "cylinder"
    variable = "piston_speed"
    uses_model = False
    equation = "f_q v |v|"
    parity = Parity.ODD
    dependence = "odd in v"
    parameters = (Parameter("f_q", "N s^2/m^2", low=0.0),)
    confounders = ("stribeck", "velocity_root_friction")
    experiment = "a pressure gauge at the cylinder port during fast strokes"
    by_motion = False
    look_at = "port, fittings and hose between pressure sensor and chamber: a throttle, or a sensor far from the port"
    source = "Merritt, Hydraulic Control Systems, 1967 (orifice flow)"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        return (view.v * np.abs(view.v))[:, None]
