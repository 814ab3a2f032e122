"""Fourier motions of all joints with a home pose and an amplitude each: points of a random search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.machine.machine_file import Machine
from daq.motion_files import Motion
from fitting.arm.linkage import stroke_limits
from fitting.arrays import FloatArray
from fitting.excitation.fourier import fourier_basis, spread_harmonics

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
            share = max(
                u[0].max() / up,
                -u[0].min() / down,
                np.abs(u[1]).max() / (use * joint.limits.velocity),
                np.abs(u[2]).max() / (use * joint.limits.acceleration),
            )
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
