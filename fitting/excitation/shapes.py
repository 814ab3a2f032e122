"""Shapes that experiments are joined from; all start and end at rest, with a continuous acceleration."""

from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray

#: Largest slopes of the fifth-order step ``10 s^3 - 15 s^4 + 6 s^5``: of itself and of its first derivative.
SPEED_OF_STEP, ACCELERATION_OF_STEP = 1.875, 5.7735


def _fifth_order(s: FloatArray) -> FloatArray:
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def step(start: FloatArray, end: FloatArray, seconds: float, rate_hz: float) -> FloatArray:
    """Fifth-order step from one pose (n,) to another, shape (N, n), end included."""
    s = np.arange(1, round(seconds * rate_hz) + 1) / round(seconds * rate_hz)
    return start + (end - start) * _fifth_order(s)[:, None]


def burst(time: FloatArray, frequency: float, cycles: int) -> FloatArray:
    """``cycles`` periods of a sine of amplitude 1, faded in and out over half a period each; 0 afterwards."""
    length = cycles / frequency
    edge = np.clip(2 * np.minimum(time, length - time) * frequency, 0.0, 1.0)
    return np.where(time <= length, _fifth_order(edge) * np.sin(2 * np.pi * frequency * time), 0.0)


def wave(time: FloatArray, seconds: float, frequency: float) -> FloatArray:
    """A sine of amplitude 1 over the whole time, faded in and out within its first and last period or 3 s."""
    edge = np.clip(np.minimum(time, seconds - time) / max(min(1 / frequency, seconds / 4), 3.0), 0.0, 1.0)
    return _fifth_order(edge) * np.sin(2 * np.pi * frequency * time)
