"""Another cylinder's flow moves this cylinder's pressures: a shared return line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine_file import Machine
from fitting.effects.base import DriveView, Effect, FloatArray, Parameter, Shape


class CrossCylinderCoupling(Effect):
    """Another cylinder's flow moves this cylinder's pressures: a shared return line."""

    id = "cross_cylinder_coupling"
    title = "another cylinder's flow acting on this one's pressures"
    level = "cylinder"
    variable = "other.piston_speed"
    uses_model = False
    equation = "b v_k, b |v_k| or b v_k |v_k|"
    parity = "follows a neighbour's speed"
    parameters = (Parameter("b", "SI"),)
    confounders = ()
    experiment = "move the neighbour alone"
    source = "Merritt, Hydraulic Control Systems, 1967 (line losses)"

    def variants(self, machine: Machine, joint: int) -> Sequence[tuple[int, ...]]:
        """Every other joint in turn."""
        return [(other,) for other in range(len(machine.joints)) if other != joint]

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Grid of shapes; see :class:`Effect`."""
        return ({"law": 0.0}, {"law": 1.0}, {"law": 2.0})

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Columns (N, k); see :class:`Effect`."""
        speed = view.speed_of(int(shape["other"]))
        laws = (speed, np.abs(speed), speed * np.abs(speed))
        return laws[int(shape["law"])][:, None]
