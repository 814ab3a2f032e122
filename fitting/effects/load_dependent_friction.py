"""Friction that grows with the force a cylinder carries: seals and bearings pressed harder."""

from __future__ import annotations

import numpy as np

from fitting.effects.base import DriveView, Effect, FloatArray, Parameter, Shape


class LoadDependentFriction(Effect):
    """Friction that grows with the force a cylinder carries: seals and bearings pressed harder."""

    id = "load_dependent_friction"
    title = "friction that grows with the load"
    level = "cylinder"
    variable = "cylinder_force"
    equation = "mu |F^| sgn v"
    parity = "odd in v; gone when unloaded"
    parameters = (Parameter("mu", "1", low=0.0, high=0.5),)
    confounders = ("position_dependent_friction", "pressure_dependent_friction", "linkage_geometry")
    experiment = "the same stroke with two loads"
    source = "Bittencourt and Axelsson, IEEE Trans. Robotics 30, 2014 (load-dependent joint friction)"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Columns (N, k); see :class:`Effect`."""
        return (np.abs(view.force) * view.s)[:, None]
