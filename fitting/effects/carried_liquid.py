from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape, geometric
from fitting.signals.filters import recursive


class CarriedLiquid(Effect):
    """Liquid in a tank or bucket that sloshes with the joint's acceleration."""

    id = "carried_liquid"
    title = "sloshing of a carried liquid"
    level = "joint"
    variable = "piston_acceleration"
    uses_model = False
    over_time = True
    equation = "(J_s H(s) q'' + J_f q'') / r, H(s) = w^2 / (s^2 + 2 zeta w s + w^2)"
    parity = Parity.OTHER
    dependence = "ring-down at 0.5 to 1.5 Hz"
    # J_f is what the rigid body holds of the liquid as if it were frozen: it is taken out again at this joint.
    parameters = (Parameter("J_s", "kg m^2", low=0.0), Parameter("J_f", "kg m^2"))
    shape_units = {"frequency": "Hz"}
    #: A liquid that follows at frequencies far above the motion's is nothing but an inertia.
    confounders = ("structural_flexibility", "actuator_inertia")
    experiment = "record the ring-down after a stop"
    look_at = "what the joint carries: a tank or bucket that is partly filled"
    source = "Ibrahim, Liquid Sloshing Dynamics, 2005 (equivalent pendulum)"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        # A lightly damped resonance is narrow: steps of 5 % keep it within half its width.
        return [{"frequency": f, "zeta": z} for f in geometric(0.4, 1.8, 31) for z in (0.02, 0.08)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        w, zeta, rate = 2 * np.pi * shape["frequency"], shape["zeta"], 2 * view.bank.rate_hz
        # Bilinear transform of H(s), s = rate (1 - z^-1) / (1 + z^-1).
        numerator = w**2 * np.array([1.0, 2.0, 1.0])
        denominator = [rate**2 + 2 * zeta * w * rate + w**2, 2 * (w**2 - rate**2), rate**2 - 2 * zeta * w * rate + w**2]
        acceleration, lead = view.segment.qdd[:, view.joint], view.segment.lead
        before = acceleration[:0] if lead is None else lead[:, view.joint]  # a swing lasts longer than a filter
        response = recursive(numerator, denominator, np.concatenate([before, acceleration]))[len(before) :]
        pull = np.column_stack([response, acceleration]) / view.r[:, None]
        return pull if view.segment.loaded else np.zeros_like(pull)
