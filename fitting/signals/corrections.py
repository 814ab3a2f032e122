"""Corrections of positions: applied when recordings are prepared again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.signals.preparation import Play, PositionError


@dataclass(frozen=True)
class Corrections:
    """Corrections of positions.

    Attributes
    ----------
    machine : the machine, with corrected linkages
    position_error : joint name to the error of its measured position as a function of it
    play : joints with play between piston and joint, and where it is
    """

    machine: Machine
    position_error: Mapping[str, PositionError] = field(default_factory=dict)
    play: Mapping[str, Play] = field(default_factory=dict)

    def with_play(self, joint: str, where: Play) -> Corrections:
        """Take up play of one joint, in the pin or at the piston's sensor."""
        return replace(self, play={**self.play, joint: where})

    def with_position_error(self, joint: str, error: PositionError) -> Corrections:
        """Add an error of one joint's measured position, a function of what is right so far."""
        before = self.position_error.get(joint)

        def total(q: FloatArray) -> FloatArray:
            earlier = np.zeros_like(q) if before is None else before(q)
            return earlier + error(q - earlier)

        return replace(self, position_error={**self.position_error, joint: total})
