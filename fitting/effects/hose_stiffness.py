from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class HoseStiffness(Effect):
    """Hoses and cable harness that pull the joint towards a middle position."""

    id = "hose_stiffness"
    title = "hoses or harness that act as a spring"
    level = "joint"
    variable = "joint_position"
    series = True
    uses_model = False
    equation = "(k_1 u + k_0 + k_2 u^2 + k_3 u^3) / r, u = q - q_m"
    parity = Parity.EVEN
    dependence = "even in v, function of the own angle"
    parameters = (
        Parameter("k_1", "N m/rad", low=0.0),
        Parameter("k_0", "N m"),
        Parameter("k_2", "N m/rad^2"),
        Parameter("k_3", "N m/rad^3", low=0.0),
    )
    confounders = ("gas_spring", "linkage_geometry")
    experiment = "take the harness off and repeat"
    by_motion = False
    look_at = "hoses and cable harness across the joint: how they are led and where they are clamped"
    source = "polynomial of the joint angle, which a spring stiffens; k_0 because nobody knows where the hoses rest"

    def references(self, view: DriveView, shape: Shape) -> Mapping[str, tuple[float, str]]:
        return {"q_m": (0.5 * sum(view.machine.joints[view.joint].limits.position), "rad")}

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        low, high = view.machine.joints[view.joint].limits.position
        angle = view.q - 0.5 * (low + high)
        pull = np.column_stack([angle, np.ones_like(angle), angle**2, angle**3]) / view.r[:, None]
        return pull if view.segment.loaded else np.zeros_like(pull)
