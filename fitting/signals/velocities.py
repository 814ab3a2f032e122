"""Measured joint velocities beside the derivative of the measured position.

Both say how fast a joint turns: the smoothed position's derivative, with the position's white noise through the first
derivative's kernel, and the smoothed velocity channel, with its own noise through the smoothing kernel. They are
averaged with the inverse of their variances; accelerations likewise, one derivative higher.

A velocity channel may also have a gain, a delay or a filter of its own, which no noise estimate sees. The derivative of
the position has neither, and the arm's geometry hangs on positions; so what the two disagree by beyond the noise of
both, and beyond what chance makes of that (two standard deviations of a mean square, with two independent samples per
period of the smoothing filter's cut-off), is counted as the velocity's variance. A channel that is late or scaled wrong
thus loses its weight instead of bending the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.arrays import FloatArray
from fitting.signals.filters import FilterBank

Motion = tuple[FloatArray, FloatArray, FloatArray]

_TINY = 1e-300


@dataclass(frozen=True)
class VelocityShare:
    """Weight of the velocity channel, 0 to 1, in a joint's speed and in its acceleration."""

    speed: float
    acceleration: float

    def fused(self, motion: Motion, velocity: FloatArray, bank: FilterBank) -> Motion:
        """Fuse the measured velocity into a joint's motion.

        Parameters
        ----------
        motion : (N,) position, speed and acceleration from the position
        velocity : (N + 2 bank.margin,) measured velocity, rad/s (m/s)
        """
        q, qd, qdd = motion
        speed, acceleration = bank.smooth(velocity)[:2]
        return q, qd + self.speed * (speed - qd), qdd + self.acceleration * (acceleration - qdd)

    def noise(self, speed: float, acceleration: float) -> tuple[float, float]:
        """Compute standard deviations of fused speed and acceleration from those of the position's derivatives.

        With weights by inverse variances the variance that is left is the other's share of the position's.
        """
        return speed * np.sqrt(1.0 - self.speed), acceleration * np.sqrt(1.0 - self.acceleration)


def velocity_share(
    position: FloatArray,
    velocity: FloatArray,
    parts: Sequence[slice],
    bank: FilterBank,
    position_std: float,
    velocity_std: float,
) -> VelocityShare:
    """Compute weights of a velocity channel over gapless ``parts`` of a recording.

    Parameters
    ----------
    position, velocity : (N,) measured, rad and rad/s (m and m/s)
    position_std, velocity_std : their white noise
    """
    smoothing = float(np.linalg.norm(bank.value))
    ours = (bank.speed_noise(position_std) ** 2, bank.acceleration_noise(position_std) ** 2)
    theirs = ((smoothing * velocity_std) ** 2, bank.speed_noise(velocity_std) ** 2)
    squares, count = np.zeros(2), 0
    for part in parts:
        if part.stop - part.start <= 2 * bank.margin:
            continue
        measured, derived = bank.smooth(velocity[part])[:2], bank.smooth(position[part])[1:]
        squares += [float(np.sum((a - b) ** 2)) for a, b in zip(measured, derived, strict=True)]
        count += len(measured[0])
    independent = max(1.0, 2.0 * min(5 / 3 * bank.bandwidth_hz / bank.rate_hz, 0.45) * count)
    chance = 1.0 + 2.0 * np.sqrt(2.0 / independent)
    shares = []
    for square, own, other in zip(squares, ours, theirs, strict=True):
        beyond = max(0.0, square / max(count, 1) - chance * (own + other))
        shares.append(own / max(own + other + beyond, _TINY))
    return VelocityShare(*shares)
