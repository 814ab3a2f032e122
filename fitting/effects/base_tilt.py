from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import base_gravity_regressor
from fitting.arrays import FloatArray
from fitting.effects.base import BodyColumn, DriveView, Effect, Parameter, Parity, Shape


class BaseTilt(Effect):
    """A base that is not level: gravity points another way for every joint at once."""

    id = "base_tilt"
    title = "a base that is not level"
    level = "joint"
    variable = "joint_position"
    equation = "dY/dg (e_1 t_1 + e_2 t_2) pi, e_1 and e_2 across gravity"
    parity = Parity.EVEN
    dependence = "independent of speed; all joints at once"
    parameters = (Parameter("tilt_1", "rad", low=-0.3, high=0.3), Parameter("tilt_2", "rad", low=-0.3, high=0.3))
    confounders = ("encoder_offset", "pressure_offset")
    experiment = "an inclinometer on the base, or the same motion after half a slew turn"
    by_motion = False
    look_at = "the base: level it, or write its tilt into the machine file"
    source = "gravity in the base frame is linear in two small angles"
    machine_wide = True

    def applies(self, machine: Machine, joint: int) -> bool:
        """Return whether there is gravity."""
        return any(machine.gravity)

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Compute columns (N, n, 2) for all joints."""
        segment = view.segment
        if not segment.loaded:
            return np.zeros((len(segment), len(view.machine.joints), 2))
        columns = []
        for own in self.body_columns(view.machine, shape):
            change = base_gravity_regressor(view.machine, view.base, segment.q, own.gravity)
            columns.append((change @ view.base_values) / segment.r)
        return np.stack(columns, axis=2)

    def body_columns(self, machine: Machine, shape: Shape) -> Sequence[BodyColumn]:
        """Return the fitted links in fields across gravity."""
        gravity = np.asarray(machine.gravity, dtype=float)
        return [BodyColumn(axis * np.linalg.norm(gravity)) for axis in _across(gravity)]


def _across(gravity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute two unit vectors across gravity, shape (3,) each."""
    down = gravity / max(float(np.linalg.norm(gravity)), 1e-12)
    start = np.eye(3)[int(np.argmin(np.abs(down)))]
    first = np.cross(down, start)
    first /= np.linalg.norm(first)
    return first, np.cross(down, first)
