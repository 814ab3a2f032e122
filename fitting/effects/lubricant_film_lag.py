from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape
from fitting.signals.filters import recursive


class LubricantFilmLag(Effect):
    """The lubricating film follows the speed with a lag, so friction against speed is a loop."""

    id = "lubricant_film_lag"
    title = "a lubricating film that lags behind the speed"
    level = "cylinder"
    variable = "piston_speed"
    uses_model = False
    over_time = True
    equation = "b sgn v (h_ss - h), h_ss = |v|^n, tau dh/dt = h_ss - h"
    parity = Parity.ODD
    dependence = "odd in v; the loop opens with frequency"
    parameters = (Parameter("b", "N (s/m)^n", low=0.0),)
    shape_units = {"tau": "s", "n": "1"}
    discrete_shapes = frozenset({"n"})
    confounders = ("sensor_latency", "actuator_inertia")
    experiment = "one amplitude at three frequencies"
    look_at = "seals and guide of the cylinder, and the oil's viscosity"
    source = "Yanada and Sekikawa, Mechatronics 18, 2008 (dynamic friction of hydraulic actuators)"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        return [{"tau": tau, "n": n} for tau in (0.05, 0.12, 0.3, 0.7) for n in (1 / 3, 1.0)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        steady = np.abs(view.power(shape["n"]))
        blend = 1.0 - np.exp(-1.0 / (view.bank.rate_hz * shape["tau"]))
        film = recursive([blend, 0.0], [1.0, blend - 1.0], steady, [(1.0 - blend) * steady[0]])
        return np.asarray(view.s * (steady - film))[:, None]
