"""Truncated Fourier series that start and end at rest.

Position of one joint over ``0 <= t <= T``, with ``w = 2 pi / T`` and chosen whole harmonics ``k``::

    q(t) = home + sum_k  a_k sin(k w t) + b_k (cos(k w t) - 1)

Then ``q(0) = q(T) = home``; two linear conditions on the coefficients make speed and acceleration vanish there too::

    q'(0)  =  w  sum k a_k    = 0
    q''(0) = -w^2 sum k^2 b_k = 0

They are met by construction: the free coefficients are coordinates in the null space of the conditions.

Source: Swevers et al., "Optimal robot excitation and identification", IEEE T-RA 13, 1997 (finite Fourier
series).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.arrays import FloatArray


@dataclass(frozen=True)
class FourierBasis:
    """Basis functions of one joint, sampled.

    Attributes
    ----------
    time : shape (N,), s
    position, speed, acceleration : shape (N, c): the basis functions and their derivatives; a motion is ``home +
        position @ coefficients``
    harmonics : whole multiples of ``1 / T`` in the series
    """

    time: FloatArray
    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    harmonics: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number ``c`` of free coefficients."""
        return int(self.position.shape[1])


def fourier_basis(harmonics: tuple[int, ...], seconds: float, time: FloatArray) -> FourierBasis:
    """Sample the basis for the given harmonics of ``1 / seconds`` at ``time``.

    Two harmonics or more; there are ``2 len(harmonics) - 2`` basis functions. They are scaled to speeds of
    like size, so that equal coefficients mean equal shares of the speed.
    """
    k = np.array(harmonics, dtype=float)
    if len(k) < 2:
        raise ValueError("a motion that starts and ends at rest needs at least two harmonics")
    w = 2 * np.pi / seconds * k
    phase = np.outer(time, w)
    sine, cosine = np.sin(phase), np.cos(phase)
    # Scaled by 1/w each: coefficients are then amplitudes of speed.
    position = np.hstack([sine / w, (cosine - 1) / w])
    speed = np.hstack([cosine, -sine])
    acceleration = np.hstack([-sine * w, -cosine * w])
    free = np.zeros((2 * len(k), 2 * len(k) - 2))
    free[: len(k), : len(k) - 1] = _null_space(np.ones(len(k)))  # speed at the ends: sum of sine coefficients
    free[len(k) :, len(k) - 1 :] = _null_space(w)
    return FourierBasis(time, position @ free, speed @ free, acceleration @ free, harmonics)


def _null_space(row: FloatArray) -> FloatArray:
    """Compute orthonormal vectors, (k, k - 1), on which ``row`` vanishes."""
    return np.linalg.qr(np.column_stack([row, np.eye(len(row))[:, : len(row) - 1]]))[0][:, 1:]


def spread_harmonics(count: int, joint: int, joints: int, seconds: float, max_frequency: float) -> tuple[int, ...]:
    """Choose ``count`` harmonics of ``1 / seconds`` up to ``max_frequency`` (Hz), spread evenly, another set for each
    joint.

    Joints with different harmonics are uncorrelated in the first place; where the duration leaves no choice,
    they share. At least two harmonics are returned.
    """
    highest = max(2, int(np.floor(max_frequency * seconds + 1e-9)))
    count = min(max(2, count), highest)
    spacing = highest / count
    places = (np.arange(count) + joint / joints) * spacing + 1
    chosen = np.unique(np.minimum(places.astype(int), highest))
    return tuple(int(k) for k in chosen)
