"""Motions: what the arm's own controller is asked to follow, as motion files have it (:mod:`daq.motion_files`).

Joints without a column hold their pose. Between rows the controller interpolates with a quintic spline, so that rows
every 0.02 to 0.1 s are enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from daq import motion_files
from daq.machine.machine_file import Machine
from daq.motion_files import Rods
from sim_backends.arrays import FloatArray

SLACK = 1e-3  # of a range, by which the controller follows a motion beyond it


@dataclass(frozen=True)
class Motion:
    """A motion of some or all joints (or pistons): ``positions`` is (n, len(joints)) at ``time`` (n,) in s."""

    machine: str
    rods: Rods
    joints: tuple[str, ...]
    time: FloatArray
    positions: FloatArray

    @property
    def duration(self) -> float:
        """Length in s."""
        return float(self.time[-1])


def write_motion(path: str | Path, motion: Motion) -> None:
    """Write a motion file (:mod:`daq.motion_files`); a reader sees all of it or nothing."""
    columns = dict(zip(motion.joints, motion.positions.T, strict=True))
    motion_files.write_motion(path, motion_files.Motion(motion.machine, motion.rods, motion.time, columns))


def read_motion(path: str | Path, machine: Machine) -> Motion:
    """Read and check a motion file for ``machine``.

    Raises
    ------
    InputError
        With one line naming file, column or time.
    """
    found = motion_files.read_motion(path, machine, slack=SLACK)
    positions = np.column_stack(list(found.columns.values()))
    return Motion(found.machine, found.rods, tuple(found.columns), found.time, positions)


class SplinePath:
    """A motion between its rows: quintic spline, at rest before and after."""

    def __init__(self, time: FloatArray, positions: FloatArray) -> None:
        self.duration = float(time[-1])
        still = np.zeros(positions.shape[1])
        rest: Any = ([(1, still), (2, still)], [(1, still), (2, still)])
        self._laws = [scipy.interpolate.make_interp_spline(time, positions, k=5, bc_type=rest)]
        self._laws += [self._laws[0].derivative(order) for order in (1, 2)]

    def __call__(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute position, speed and acceleration at ``time`` (n,), each (n, columns)."""
        inside = np.clip(time, 0.0, self.duration)
        position, speed, acceleration = (np.asarray(law(inside), dtype=np.float64) for law in self._laws)
        outside = (time < 0.0) | (time > self.duration)
        speed[outside] = 0.0
        acceleration[outside] = 0.0
        return position, speed, acceleration


#: Of random motions: share of the tightest limit, sines of each axis, the slowest of them, and the rate of the motion.
_USE, _HARMONICS, _SLOWEST_HZ, _RATE_HZ = 0.92, 5, 0.05, 50.0


def random_motion(machine: Machine, rng: np.random.Generator, seconds: float, *, rods: Rods = "pinned") -> Motion:
    """Draw a smooth multi-sine for all joints (or pistons), inside position, speed, acceleration limits.

    Each axis is a sum of five sines at random frequencies from some 0.05 Hz up, scaled until 92 % of the tightest limit
    is reached, faded in and out over 2 s. Pistons remain where the joint's limits would keep them.
    """
    names, columns = [], []
    time = np.arange(round(seconds * _RATE_HZ) + 1) / _RATE_HZ
    ramp = min(2.0, seconds / 4)
    s = np.clip(np.minimum(time, time[-1] - time) / ramp, 0.0, 1.0)
    fade = s**3 * (10 - 15 * s + 6 * s**2)
    for joint in machine.joints:
        low, high = joint.limits.position
        speed, acceleration = joint.limits.velocity, joint.limits.acceleration
        if rods == "unpinned":
            if joint.cylinder is None:
                continue
            q = np.linspace(low, high, 201)
            x = joint.cylinder.linkage.piston_position(q)
            lever = float(np.abs(np.gradient(x, q)).max())
            low, high = max(float(x.min()), 0.0), min(float(x.max()), joint.cylinder.stroke)
            speed, acceleration = speed * lever, acceleration * lever
        frequency = _SLOWEST_HZ * (1 + np.arange(_HARMONICS)) * rng.uniform(0.85, 1.15, _HARMONICS)
        weight = rng.uniform(0.3, 1.0, _HARMONICS) / (1 + np.arange(_HARMONICS)) ** rng.uniform(0.4, 1.2)
        phase = rng.uniform(0, 2 * np.pi, _HARMONICS)
        wave = (weight * np.sin(2 * np.pi * frequency * time[:, None] + phase)).sum(axis=1)
        centre = 0.5 * (wave.max() + wave.min())
        wave = (wave - centre) * fade
        rates = np.abs(np.gradient(wave, time)).max(), np.abs(np.gradient(np.gradient(wave, time), time)).max()
        scale = _USE * min(0.5 * (high - low) / np.abs(wave).max(), speed / rates[0], acceleration / rates[1])
        names.append(joint.name)
        columns.append(0.5 * (low + high) + scale * wave)
    return Motion(machine.name, rods, tuple(names), time, np.stack(columns, axis=1))
