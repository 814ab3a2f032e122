from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape, has_both_positions, position_change
from fitting.signals.corrections import Corrections


class EncoderOffset(Effect):
    """A joint encoder whose zero is off."""

    id = "encoder_offset"
    title = "a joint encoder whose zero is off"
    level = "measurement"
    variable = "joint_position"
    over_time = True
    equation = "q = q_measured - q_0"
    parity = Parity.EVEN
    dependence = "independent of speed; gravity curve shifted along q"
    parameters = (Parameter("q_0", "rad", low=-0.3, high=0.3),)
    confounders = ("linkage_geometry", "base_tilt")
    experiment = "drive the joint to a mechanical zero and read the encoder"
    by_motion = False
    look_at = "the zero of the joint encoder: set it again at a mechanical mark"
    source = "first order in the offset: -r q_0 between piston and joint, -(dY/dq) pi q_0 in the efforts"
    spreads = True

    def applies(self, machine: Machine, joint: int) -> bool:
        """Return whether efforts are needed: kinematics cannot show it better."""
        return not has_both_positions(machine, joint) and joint > 0

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Compute columns (N, n, 1): all efforts of the links from this joint on."""
        if not view.segment.loaded:
            return np.zeros((len(view), len(view.machine.joints), 1))
        return view.body_change(-np.ones(len(view)))[:, :, None]

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """Return ``-r``: x(q) is taken at a position that is too large by the offset."""
        return -view.r[:, None]

    def apply_to_signals(
        self, corrections: Corrections, joint: str, shape: Shape, values: Sequence[float]
    ) -> Corrections:
        """Correct the encoder's zero."""
        return corrections.with_position_error(joint, lambda q: np.full_like(q, values[0]))

    def gap_change(self, view: DriveView, shape: Shape, values: Sequence[float]) -> FloatArray | None:
        """Compute the same for an offset of any size."""
        return position_change(view, np.full(len(view), values[0]))
