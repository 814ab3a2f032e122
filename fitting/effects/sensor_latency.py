from __future__ import annotations

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class SensorLatency(Effect):
    """Pressures that arrive late, so that effort and motion do not belong together."""

    id = "sensor_latency"
    title = "delayed effort signals"
    level = "measurement"
    variable = "force_rate"
    over_time = True
    delays_effort = True
    equation = "-tau dF^/dt"
    parity = Parity.OTHER
    dependence = "follows the rate of the force"
    parameters = (Parameter("tau", "s", low=0.0, high=0.25),)
    confounders = ("presliding_hysteresis", "structural_flexibility")
    experiment = "move at two frequencies: the phase of a delay grows with frequency"
    look_at = "filters and update rates of sensors and nodes: who sends the pressures later than the positions"
    source = "first-order expansion of F(t - tau)"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        return -view.bank.rate(view.force)[:, None]
