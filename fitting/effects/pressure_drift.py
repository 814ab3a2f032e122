"""A pressure transducer that drifts in the course of a recording."""

from __future__ import annotations

from fitting.effects.base import DriveView, Effect, FloatArray, Parameter, Shape


class PressureDrift(Effect):
    """A pressure transducer that drifts in the course of a recording."""

    id = "pressure_drift"
    title = "a drifting pressure sensor"
    level = "measurement"
    variable = "time"
    uses_model = False
    equation = "d t"
    parity = "slow in time, independent of motion"
    parameters = (Parameter("d", "N/s"),)
    confounders = ("thermal_viscosity_drift", "payload")
    experiment = "take the first pose again at the end"
    source = "transducer data sheets: thermal zero shift"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Columns (N, k); see :class:`Effect`."""
        middle = 0.5 * (view.range.time[0] + view.range.time[1])
        return (view.clock - middle)[:, None]
