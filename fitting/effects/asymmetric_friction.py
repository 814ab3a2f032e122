from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class AsymmetricFriction(Effect):
    """Another friction law extending than retracting: seals are not symmetric."""

    id = "asymmetric_friction"
    title = "friction that differs between extending and retracting"
    level = "cylinder"
    variable = "piston_speed"
    uses_model = False
    equation = "(f_c+ + f_v+ v) [v > 0]"
    parity = Parity.NEITHER
    dependence = "neither even nor odd in v"
    parameters = (Parameter("f_c_extending", "N"), Parameter("f_v_extending", "N s/m"))
    confounders = ("pressure_offset", "pressure_gain", "base_tilt")
    experiment = "an offset is also there at rest: hold the arm still at both ends of a stroke"
    look_at = "rod and piston seals of the cylinder, and the zero of its two pressure sensors"
    source = "Janot, Gautier, Brunot, EMPS benchmark, 2019"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        extending = 0.5 * (1.0 + view.s)
        return np.column_stack([extending, np.maximum(view.v, 0.0)])
