"""Play in a pin or gear between piston and joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from fitting.effects.base import DriveView, Effect, FloatArray, Parameter, Parity, Shape, has_both_positions
from fitting.signals.corrections import Corrections


class Backlash(Effect):
    """Play in a pin or gear between piston and joint."""

    id = "backlash"
    title = "play between piston and joint"
    level = "joint"
    variable = "cylinder_force"
    over_time = True
    equation = "x = x(q) + g/2 sgn F_l"
    parity = Parity.OTHER
    dependence = "follows the sign of the load; where it never changes this is an offset"
    parameters = (Parameter("g", "m", low=0.0, high=0.02),)
    stays_in_gap = True
    confounders = ("presliding_hysteresis", "structural_flexibility", "encoder_offset")
    experiment = "move slowly through zero load in both directions"
    look_at = "pins, bushings and gear between piston and joint: measure the play by hand"
    source = "play operator driven by the load"

    def applies(self, machine: Machine, joint: int) -> bool:
        """Seen between two position sensors only; from efforts it cannot be told from presliding."""
        return False

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Piston error through the cylinder's stiffness: nothing that efforts could show by themselves."""
        raise NotImplementedError("backlash is found between two position sensors, not from efforts")

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """Half the play, on the side that the load pushes to."""
        if not has_both_positions(view.machine, view.joint):
            return None
        return 0.5 * _side(view)[:, None]

    def places(self, shape: Shape) -> Sequence[Shape]:
        """In the pin, or between piston and its sensor: friction jumps with the piston's own speed."""
        return tuple({**shape, "sensor": sensor} for sensor in (0.0, 1.0))

    def apply_to_signals(
        self, corrections: Corrections, joint: str, shape: Shape, values: Sequence[float]
    ) -> Corrections:
        """Play in the pin, or at the piston's sensor; see :meth:`places`."""
        return corrections.with_play(joint, "sensor" if shape.get("sensor") else "pin")


def _side(view: DriveView) -> FloatArray:
    """Side of the play: the sign of the load, kept while the load is within a hundredth of its range."""
    threshold = 0.01 * view.range.force
    side = 0.0
    sides = []
    for load in view.load.tolist():
        if abs(load) > threshold:
            side = 1.0 if load > 0 else -1.0
        sides.append(side)
    first = next((value for value in sides if value), 1.0)
    return np.asarray([value or first for value in sides])
