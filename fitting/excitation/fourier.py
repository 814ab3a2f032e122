"""Truncated Fourier series that start and end at rest, and random motions of all joints that are made of them.

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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.machine.machine_file import Machine
from daq.motion_files import Motion
from fitting.arm.linkage import stroke_limits
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


def limit_share(u: FloatArray, up: float, down: float, speed: float, acceleration: float) -> float:
    """Compute the largest share of its limits that a motion uses; ``u`` (3, N) way from home, speed, acceleration."""
    ways = u[0].max() / up, -u[0].min() / down
    return float(max(*ways, np.abs(u[1]).max() / speed, np.abs(u[2]).max() / acceleration))


_HARMONICS = 5
_HIGHEST = (0.2, 0.35, 0.6)  # Hz


@dataclass(frozen=True)
class Series:
    """A motion as numbers that may be anything; the limits hold whatever they are.

    Attributes
    ----------
    seconds : duration
    harmonics : per joint, multiples of ``1 / seconds``
    coefficients : per joint, of the series; only their proportions count
    amplitude : shape (n,), share of what the limits allow about the home, 0 to 1; 0 holds still
    home : shape (n,), -1 to 1: from one end of the joint's range to the other
    """

    seconds: float
    harmonics: tuple[tuple[int, ...], ...]
    coefficients: tuple[FloatArray, ...]
    amplitude: FloatArray
    home: FloatArray

    def states(self, machine: Machine, use: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute positions, speeds, accelerations (N, n) at the machine's rate, within ``use`` of the limits."""
        count = round(self.seconds * machine.rate_hz)
        time = np.arange(count + 1) / machine.rate_hz
        moving = np.zeros((3, count + 1, len(machine.joints)))
        for j, joint in enumerate(machine.joints):
            low, high = stroke_limits(joint)
            half = use * (high - low) / 2
            # A home at the very end would leave no way: three quarters of the way there at most.
            home = (low + high) / 2 + 0.75 * float(np.clip(self.home[j], -1, 1)) * half
            moving[0, :, j] = home
            if self.amplitude[j] <= 0:
                continue
            basis = fourier_basis(self.harmonics[j], self.seconds, time)
            u = np.stack([part @ self.coefficients[j] for part in (basis.position, basis.speed, basis.acceleration)])
            up, down = (low + high) / 2 + half - home, home - (low + high) / 2 + half
            share = limit_share(u, up, down, use * joint.limits.velocity, use * joint.limits.acceleration)
            moving[:, :, j] += min(1.0, self.amplitude[j]) * u / (1.002 * share)  # the peaks between the samples
        return moving[0], moving[1], moving[2]

    def motion(self, machine: Machine, use: float) -> Motion:
        """Return the motion program."""
        q, _, _ = self.states(machine, use)
        time = np.arange(len(q)) / machine.rate_hz
        columns = {joint.name: q[:, j].copy() for j, joint in enumerate(machine.joints)}
        return Motion(machine.name, "pinned", time, columns)


def random_series(machine: Machine, seconds: float, rng: np.random.Generator, suspects: Sequence[int]) -> Series:
    """Draw a random motion; suspects always move, others by chance, at random homes."""
    n = len(machine.joints)
    highest = max(_HIGHEST[int(rng.integers(len(_HIGHEST)))], 2.0 / seconds)
    harmonics = tuple(spread_harmonics(_HARMONICS, j, n, seconds, highest) for j in range(n))
    amplitude = np.where(rng.uniform(size=n) < 0.7, rng.uniform(0.3, 1.0, n), 0.0)
    amplitude[list(suspects)] = rng.uniform(0.5, 1.0, len(suspects))
    return Series(
        seconds,
        harmonics,
        tuple(rng.normal(size=2 * len(k) - 2) for k in harmonics),
        amplitude,
        rng.uniform(-1, 1, n) * (rng.uniform(size=n) < 0.7),
    )


def varied(series: Series, rng: np.random.Generator, size: float) -> Series:
    """Vary a series: everything moved a little, ``size`` over its usual spread."""
    n = len(series.home)
    moves = series.amplitude > 0
    return replace(
        series,
        coefficients=tuple(c + size * rng.normal(size=c.size) for c in series.coefficients),
        amplitude=np.where(moves, np.clip(series.amplitude + 0.4 * size * rng.normal(size=n), 0.05, 1.0), 0.0),
        home=np.clip(series.home + size * rng.normal(size=n), -1.0, 1.0),
    )
