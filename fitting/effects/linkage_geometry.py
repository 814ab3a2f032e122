"""A pin that is not where the machine file says: the lever arm is wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine_file import Machine
from fitting.effects.base import DriveView, Effect, FloatArray, Parameter, Shape
from fitting.linkage import lever_arm_derivatives, parameter_derivatives, parameter_names


class LinkageGeometry(Effect):
    """A pin that is not where the machine file says: the lever arm is wrong."""

    id = "linkage_geometry"
    title = "a linkage pin that is not where the machine file says"
    level = "joint"
    variable = "joint_position"
    series = True
    equation = "-F_l d ln r / d p"
    parity = "multiplies the load by a function of q"
    parameters = (Parameter("shift", "m or rad", low=-0.1, high=0.1),)
    confounders = ("encoder_offset", "load_dependent_friction")
    experiment = "compare piston position and joint angle over the whole stroke"
    source = "derivative of F_l = tau / r with respect to a pin coordinate"

    def applies(self, machine: Machine, joint: int) -> bool:
        """The linkage has to have parameters."""
        cylinder = machine.joints[joint].cylinder
        return cylinder is not None and len(parameter_names(cylinder.linkage)) > 0

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Grid of shapes; see :class:`Effect`."""
        cylinder = view.machine.joints[view.joint].cylinder
        assert cylinder is not None
        return [{"parameter": float(k)} for k in range(lever_arm_derivatives(cylinder.linkage, view.q[:1]).shape[-1])]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Columns (N, k); see :class:`Effect`."""
        cylinder = view.machine.joints[view.joint].cylinder
        assert cylinder is not None
        slope = lever_arm_derivatives(cylinder.linkage, view.q)[:, int(shape["parameter"])] / view.r
        column = -view.load * slope
        return (column if view.segment.loaded else np.zeros_like(column))[:, None]

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """``dx/dp``: the piston is where the true linkage puts it, the model's x(q) where the file's does."""
        cylinder = view.machine.joints[view.joint].cylinder
        assert cylinder is not None
        return parameter_derivatives(cylinder.linkage, view.q)[:, [int(shape["parameter"])]]
