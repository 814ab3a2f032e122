from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class ActuatorInertia(Effect):
    """Inertia that turns with the joint's drive and no link."""

    id = "actuator_inertia"
    title = "inertia of the drive itself"
    level = "joint"
    variable = "piston_acceleration"
    uses_model = False
    equation = "J q'' / r"
    parity = Parity.OTHER
    dependence = "own acceleration only"
    parameters = (Parameter("J", "kg m^2", low=0.0),)
    experiment = "report it lumped with the link"
    look_at = "nothing is broken: the drive's own inertia belongs into the model"
    source = "drive inertia of the standard parameters"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        column = view.segment.qdd[:, view.joint] / view.r
        return (column if view.segment.loaded else np.zeros_like(column))[:, None]
