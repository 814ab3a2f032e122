"""From what is there to what a transducer says: noise, steps, saturation."""

from __future__ import annotations

import numpy as np

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.truth import SensorQuality


class SensorChain:
    """Turns ideal values of all channels (SI) into measured ones."""

    def __init__(self, machine: Machine, quality: SensorQuality, rng: np.random.Generator) -> None:
        self._rng = rng
        stds, steps, lows, highs = [], [], [], []
        for channel in machine.channels:
            std, step = {
                "joint_position": (quality.encoder_std, quality.encoder_resolution),
                "piston_position": (quality.piston_std, quality.piston_resolution),
                "head_pressure": (quality.pressure_std, quality.pressure_resolution),
                "rod_pressure": (quality.pressure_std, quality.pressure_resolution),
                "supply_pressure": (quality.pressure_std, quality.pressure_resolution),
                "tank_pressure": (quality.pressure_std, quality.pressure_resolution),
                "oil_temperature": (quality.temperature_std, 0.0),
                "command": (0.0, 0.0),  # a number that was sent
                "joint_effort": (quality.effort_std, 0.0),
                "cylinder_force": (quality.effort_std, 0.0),
                "base_roll": (quality.encoder_std, 0.0),
                "base_pitch": (quality.encoder_std, 0.0),
            }[channel.quantity]
            stds.append(std)
            steps.append(step)
            low, high = (-np.inf, np.inf)
            if channel.range is not None:
                low, high = machine.conversion(channel).to_si(channel.range)
            lows.append(low)
            highs.append(high)
        self._std, self._step = np.array(stds), np.array(steps)
        self._low, self._high = np.array(lows), np.array(highs)

    def __call__(self, ideal: FloatArray) -> FloatArray:
        """Measure ideal values, both (n, channels) in the machine file's order and in SI units."""
        measured = ideal + self._std * self._rng.standard_normal(ideal.shape)
        coarse = self._step > 0
        measured[:, coarse] = np.round(measured[:, coarse] / self._step[coarse]) * self._step[coarse]
        return np.clip(measured, self._low, self._high)
