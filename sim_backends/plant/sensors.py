"""From what is there to what a transducer reads: noise, steps, saturation."""

from __future__ import annotations

import numpy as np

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.truth import SensorQuality


class SensorChain:
    """Turns ideal values of all channels (SI) into measured ones."""

    def __init__(self, machine: Machine, quality: SensorQuality, rng: np.random.Generator) -> None:
        self._rng = rng
        pressure = (quality.pressure_std, quality.pressure_resolution)
        known = {
            "joint_position": (quality.encoder_std, quality.encoder_resolution),
            "piston_position": (quality.piston_std, quality.piston_resolution),
            **dict.fromkeys(("head_pressure", "rod_pressure", "supply_pressure", "tank_pressure"), pressure),
            "oil_temperature": (quality.temperature_std, 0.0),
            "command": (0.0, 0.0),  # a number that was sent
            **dict.fromkeys(("joint_effort", "cylinder_force"), (quality.effort_std, 0.0)),
            **dict.fromkeys(("base_roll", "base_pitch"), (quality.encoder_std, 0.0)),
        }
        self._std, self._step = np.array([known[channel.quantity] for channel in machine.channels]).T
        ends = [
            (-np.inf, np.inf) if c.range is None else machine.conversion(c).to_si(c.range) for c in machine.channels
        ]
        self._low, self._high = np.array(ends).T

    def __call__(self, ideal: FloatArray) -> FloatArray:
        """Measure ideal values, both (n, channels) in the machine file's order and in SI units."""
        measured = ideal + self._std * self._rng.standard_normal(ideal.shape)
        coarse = self._step > 0
        measured[:, coarse] = np.round(measured[:, coarse] / self._step[coarse]) * self._step[coarse]
        return np.asarray(np.clip(measured, self._low, self._high))
