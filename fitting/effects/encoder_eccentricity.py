from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape, has_both_positions, position_change
from fitting.signals.corrections import Corrections

#: Times that the angle is put into its own error; each leaves the share ``n e`` of what was left.
_TURNS = 6


class EncoderEccentricity(Effect):
    """A joint encoder whose disc is not centred: its error is a harmonic of the angle."""

    id = "encoder_eccentricity"
    title = "a joint encoder that runs eccentrically"
    level = "measurement"
    variable = "joint_position"
    over_time = True
    equation = "q = q_measured - (e_s sin n q + e_c cos n q + e_0), e_0 from where it was zeroed"
    parity = Parity.OTHER
    dependence = "harmonic of the joint angle"
    parameters = tuple(Parameter(name, "rad", low=-0.1, high=0.1) for name in ("e_s", "e_c", "e_0"))
    discrete_shapes = frozenset({"n"})
    shape_units = {"n": "1"}
    confounders = ("encoder_offset", "linkage_geometry", "position_harmonic")
    experiment = "compare joint and piston encoder over the whole stroke; no dynamics needed"
    look_at = "how the joint encoder is mounted: its disc or shaft is not centred"
    source = "rotary encoder data sheets: eccentricity of the disc gives one period per turn, ellipticity two"
    spreads = True
    includes = ("encoder_offset",)

    def applies(self, machine: Machine, joint: int) -> bool:
        """Return whether efforts are needed: kinematics cannot show it better."""
        revolute = machine.joints[joint].type == "revolute"
        return revolute and not has_both_positions(machine, joint)

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return the periods per turn."""
        return [{"n": float(n)} for n in (1, 2, 3, 4, 6, 8)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Compute columns (N, n, 3): all efforts of the links from this joint on."""
        if not view.segment.loaded:
            return np.zeros((len(view), len(view.machine.joints), 3))
        waves = _waves(view.q, shape)
        return np.stack([view.body_change(-wave) for wave in waves.T], axis=2)

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """Return ``-r sin n q``, ``-r cos n q`` and ``-r``."""
        return -view.r[:, None] * _waves(view.q, shape)

    def apply_to_signals(
        self, corrections: Corrections, joint: str, shape: Shape, values: Sequence[float]
    ) -> Corrections:
        """Correct the encoder's error, by its own reading."""
        return corrections.with_position_error(joint, lambda q: _error(q, shape, values))

    def gap_change(self, view: DriveView, shape: Shape, values: Sequence[float]) -> FloatArray | None:
        """Compute the same for an error of any size."""
        return position_change(view, _error(view.q, shape, values))


def _waves(q: FloatArray, shape: Shape) -> FloatArray:
    angle = shape["n"] * q
    return np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])


def _error(reading: FloatArray, shape: Shape, values: Sequence[float]) -> FloatArray:
    """Compute the error (N,) of readings (N,), rad: a harmonic of the disc's angle, not of the reading."""
    angle = reading
    for _ in range(_TURNS):
        angle = reading - _waves(angle, shape) @ np.asarray(values)
    return reading - angle
