from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class PressureOffset(Effect):
    """A pressure transducer whose zero is off."""

    id = "pressure_offset"
    title = "an offset of a pressure sensor"
    level = "measurement"
    variable = "cylinder_force"
    uses_model = False
    equation = "F_0"
    parity = Parity.EVEN
    dependence = "constant"
    parameters = (Parameter("F_0", "N"),)
    confounders = ("asymmetric_friction", "pressure_gain", "base_tilt")
    experiment = "vent both chambers and read the sensors"
    by_motion = False
    look_at = "the pressure sensor's zero: vent both chambers and set it"
    source = "transducer data sheets: zero error"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        return np.ones((len(view), 1))
