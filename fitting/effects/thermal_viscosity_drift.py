from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class ThermalViscosityDrift(Effect):
    """Oil warms up, its viscosity falls, and the viscous friction with it."""

    id = "thermal_viscosity_drift"
    title = "viscous friction that drifts as the oil warms up"
    level = "cylinder"
    variable = "time"
    uses_model = False
    equation = "d v exp(-t / tau)"
    parity = Parity.ODD
    dependence = "odd in v; slow in time, saturating"
    parameters = (Parameter("d", "N s/m", low=0.0),)
    shape_units = {"tau": "s"}
    confounders = ("payload", "pressure_drift")
    experiment = "the same cycle cold and warm"
    by_motion = False
    look_at = "the oil: warm the machine up before recordings, or add an oil temperature sensor"
    source = "Merritt, Hydraulic Control Systems, 1967 (viscosity of oil)"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        length = view.range.time[1] - view.range.time[0]
        return [{"tau": share * length} for share in (0.15, 0.4, 1.0, 4.0)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        return (view.v * (np.exp(-view.clock / shape["tau"]) - 0.5))[:, None]
