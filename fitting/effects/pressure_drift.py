from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class PressureDrift(Effect):
    """A pressure transducer that drifts in the course of a recording."""

    id = "pressure_drift"
    title = "a drifting pressure sensor"
    level = "measurement"
    variable = "time"
    uses_model = False
    equation = "d t + d_0, or d tau (1 - exp(-t / tau)) + d_0 where it settles"
    parity = Parity.EVEN
    dependence = "slow in time, independent of motion"
    parameters = (Parameter("d", "N/s"), Parameter("d_0", "N"))
    shape_units = {"tau": "s"}
    confounders = ("thermal_viscosity_drift", "payload")
    experiment = "take the first pose again at the end"
    look_at = "the pressure sensor and its temperature: warm up first, replace it if it goes on"
    source = "transducer data sheets: thermal zero shift"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return a steady drift (tau 0), and ones that settle within the recording."""
        start, end = view.range.time
        return [{"tau": 0.0}, *({"tau": share * (end - start)} for share in (0.25, 0.6, 1.5))]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        tau = shape["tau"]
        drift = -tau * np.expm1(-view.clock / tau) if tau else view.clock
        return np.column_stack([drift, np.ones(len(drift))])

    def plausible(self, values: Sequence[float], stds: Sequence[float]) -> bool:
        """Return whether there is a drift: else it would be an offset by another name."""
        return abs(values[0]) > 3.0 * stds[0]
