from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class PoseDependentFriction(Effect):
    """Joint friction that changes with another joint's pose."""

    id = "pose_dependent_friction"
    title = "friction that follows another joint's pose"
    level = "joint"
    variable = "other.joint_position"
    series = True
    uses_model = False
    equation = "(b_1 u + b_2 u^2 + b_3 u^3) sgn(v) / |r|, u = q_k - q_m"
    parity = Parity.ODD
    dependence = "odd in v; follows a neighbour's pose"
    parameters = (Parameter("b_1", "N m/rad"), Parameter("b_2", "N m/rad^2"), Parameter("b_3", "N m/rad^3"))
    discrete_shapes = frozenset({"other"})
    confounders = ("load_dependent_friction",)
    experiment = "a single joint at three poses of the other"
    look_at = "the joint's bearing and what bends it in that pose"
    source = "Bittencourt and Axelsson, IEEE Trans. Robotics 30, 2014"

    def references(self, view: DriveView, shape: Shape) -> Mapping[str, tuple[float, str]]:
        return {"q_m": (0.5 * sum(view.machine.joints[int(shape["other"])].limits.position), "rad")}

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        other = int(shape["other"])
        low, high = view.machine.joints[other].limits.position
        turned = view.segment.q[:, other] - 0.5 * (low + high)
        columns = np.column_stack([turned**k * view.s / np.abs(view.r) for k in range(1, len(self.parameters) + 1)])
        return columns if view.segment.loaded else np.zeros_like(columns)
