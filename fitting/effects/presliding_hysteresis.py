from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape, geometric


class PreslidingHysteresis(Effect):
    """Elastic presliding after a reversal (Dahl): friction builds up over a distance, not at once."""

    id = "presliding_hysteresis"
    title = "friction that builds up over a distance after a reversal"
    level = "cylinder"
    variable = "piston_position"
    uses_model = False
    over_time = True
    equation = "f_c (z - sgn v), dz/dx = (1 - z sgn v) / x_s"
    parity = Parity.OTHER
    dependence = "hysteresis in x, within three x_s of a reversal"
    parameters = (Parameter("f_c", "N", low=0.0),)
    shape_units = {"x_s": "m"}
    confounders = ("sensor_latency", "backlash", "structural_flexibility")
    experiment = "slow reversals at three rates: presliding depends on distance, a delay on time"
    look_at = "seals of the cylinder: their preload; it is usual and only has to be modelled"
    source = "Dahl, AIAA Journal 14, 1976"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        low = max(4 * view.noise[view.joint].position, 0.0005 * view.range.span)
        # Seals shear by less than their own width; over longer distances it is not elastic.
        return [{"x_s": distance} for distance in geometric(low, max(0.02 * view.range.span, 2 * low), 6)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        return (_dahl_state(view.x, view.s, shape["x_s"]) - view.s)[:, None]


def _dahl_state(x: FloatArray, sign: FloatArray, distance: float) -> FloatArray:
    """Solve Dahl's state ``z`` (N,): exact for ``dz/dx = (1 - z s) / distance`` over each step of ``x``."""
    decay = np.exp(-np.abs(np.diff(x)) / distance).tolist()
    target = sign.tolist()
    state = target[0]
    states = [state]
    for factor, goal in zip(decay, target[1:], strict=True):
        state = goal + (state - goal) * factor
        states.append(state)
    return np.asarray(states)
