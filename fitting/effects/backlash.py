from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects.base import (
    SITES,
    DriveView,
    Effect,
    Parameter,
    Parity,
    Shape,
    gap_lever,
    geometric,
    has_both_positions,
)

#: Widths that bushings take to be crossed, over the largest force of the joint.
WIDTHS = geometric(0.002, 0.9, 25)


class Backlash(Effect):
    """Play in a pin or gear between piston and joint."""

    id = "backlash"
    title = "play between piston and joint"
    level = "joint"
    variable = "cylinder_force"
    over_time = True
    equation = "x = x(q) + g/2 clip(F/w, -1, 1); about the joint x(q) + r g/2 clip(r F/(r0 w), -1, 1), r0 the mean of r"
    parity = Parity.OTHER
    dependence = "follows the sign of the load; where it never changes this is an offset"
    parameters = (Parameter("g", "m", low=0.0, high=0.02),)
    between_sensors = True
    slow = (0.05, 0.01)  # oil and friction let it be crossed in a tenth of a second
    discrete_shapes = frozenset({"about", "friction", "sensor"})
    shape_units = {"width": "N"}
    confounders = ("presliding_hysteresis", "structural_flexibility", "encoder_offset")
    experiment = "move slowly through zero load in both directions"
    look_at = "pins, bushings and gear between piston and joint: measure the play by hand"
    source = "play operator driven by the load"

    def applies(self, machine: Machine, joint: int) -> bool:
        """Return whether two position sensors can show it; in efforts it equals presliding."""
        return False

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Compute the piston error through the cylinder's stiffness: invisible in efforts alone."""
        raise NotImplementedError("backlash is found between two position sensors, not from efforts")

    def gap_shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return shapes along the cylinder or about the joint, with the seals' friction or not, and how soft."""
        return [{**site, "width": width * view.range.force} for site in SITES for width in WIDTHS]

    def gap_units(self, shape: Shape) -> tuple[str, ...]:
        """Return a length along the cylinder, an angle about the joint."""
        return ("rad",) if shape.get("about") else ("m",)

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """Compute half the play, on the side that the force pushes to; being crossed within the width."""
        if not has_both_positions(view.machine, view.joint):
            return None
        lever = gap_lever(view, shape)
        bending = lever * view.bending_force(bool(shape.get("friction")))
        width = max(float(shape.get("width", 0.0)), 1e-9 * view.range.force)
        if shape.get("about"):
            width *= _mean_lever(view)
        return (0.5 * lever * np.clip(bending / width, -1.0, 1.0))[:, None]


def _mean_lever(view: DriveView) -> float:
    """Compute stroke per angle of the whole travel, as magnitude, m."""
    low, high = view.machine.joints[view.joint].limits.position
    ends = view.cylinder.linkage.piston_position(np.array([low, high]))
    return abs(float(ends[1] - ends[0])) / (high - low)
