"""Motions: what the arm's own controller is asked to follow.

A motion file is a CSV table::

    # hilfit/motion/1 machine=folding-arm rods=pinned
    time,joint1,joint2,...
    0.00,-0.1,0.05,...

``time`` is in s, starts at 0 and rises. ``rods=pinned``: one column ``<joint>`` per moved joint with its position in
rad or m. ``rods=unpinned`` (the cylinders move alone, the arm is parked): one column ``<joint>.piston`` per moved
cylinder with its piston position in m. Joints without a column hold their pose. Between rows the controller
interpolates with a quintic spline, so that rows every 0.02 to 0.1 s are enough; the motion starts and ends at rest.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_interp_spline

from daq.errors import InputError
from daq.machine.machine_file import Machine

FloatArray = npt.NDArray[np.float64]
Rods = Literal["pinned", "unpinned"]

HEADER = "# hilfit/motion/1"


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
    """Write a motion file in one step: a reader sees all of it or nothing."""
    suffix = ".piston" if motion.rods == "unpinned" else ""
    text = io.StringIO()
    text.write(f"{HEADER} machine={motion.machine} rods={motion.rods}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time", *(joint + suffix for joint in motion.joints)])
    for t, row in zip(motion.time, motion.positions, strict=True):
        writer.writerow([f"{t:.6f}", *(f"{value:.9g}" for value in row)])
    path = Path(path)
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_text(text.getvalue(), encoding="utf-8")
    temporary.replace(path)


def read_motion(path: str | Path, machine: Machine) -> Motion:
    """Read and check a motion file for ``machine``.

    Raises
    ------
    InputError
        With one line naming file, column or time: wrong header, other machine, unknown joint, time that does not
        rise, positions beyond limits or stroke.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; give a motion file (CSV)") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text ({error.__class__.__name__})") from None
    if not lines or not lines[0].startswith(HEADER):
        raise InputError(f"{path}: not a motion file; its first line must be '{HEADER} machine=... rods=...'")
    keys = dict(part.split("=", 1) for part in lines[0][len(HEADER) :].split() if "=" in part)
    if keys.get("machine") != machine.name:
        raise InputError(f"{path}: is a motion of machine '{keys.get('machine')}', not of '{machine.name}'")
    if keys.get("rods") not in ("pinned", "unpinned"):
        raise InputError(f"{path}: rods={keys.get('rods')}; write rods=pinned or rods=unpinned")
    rods = cast(Rods, keys["rods"])
    rows = list(csv.reader(lines[1:]))
    if len(rows) < 7 or rows[0][:1] != ["time"] or len(rows[0]) < 2:
        raise InputError(f"{path}: needs a row 'time,<joint>,...' and at least six rows of numbers")
    try:
        table = np.array([[float(cell) for cell in row] for row in rows[1:] if row])
    except ValueError as error:
        raise InputError(f"{path}: {error}; every cell below the names must be a number") from None
    suffix = ".piston" if rods == "unpinned" else ""
    joints = tuple(name.strip().removesuffix(suffix) if suffix else name.strip() for name in rows[0][1:])
    if table.ndim != 2 or table.shape[1] != len(rows[0]) or not np.isfinite(table).all():
        raise InputError(f"{path}: rows have missing cells or numbers that are not finite")
    motion = Motion(machine.name, rods, joints, table[:, 0], table[:, 1:])
    _check(path, motion, machine)
    return motion


def _check(path: Path, motion: Motion, machine: Machine) -> None:
    names = {joint.name: joint for joint in machine.joints}
    if len(set(motion.joints)) != len(motion.joints):
        raise InputError(f"{path}: a joint has two columns; keep one")
    if motion.time[0] != 0.0 or np.any(np.diff(motion.time) <= 0):
        raise InputError(f"{path}: column time must start at 0 and rise")
    for k, name in enumerate(motion.joints):
        joint = names.get(name)
        if joint is None or (motion.rods == "unpinned" and joint.cylinder is None):
            what = "joint" if motion.rods == "pinned" else "cylinder"
            raise InputError(f"{path}: column '{name}': {machine.name} has no such {what}")
        if motion.rods == "pinned":
            low, high = joint.limits.position
        else:
            assert joint.cylinder is not None
            low, high = 0.0, joint.cylinder.stroke
        tolerance = 1e-3 * (high - low)
        column = motion.positions[:, k]
        if column.min() < low - tolerance or column.max() > high + tolerance:
            raise InputError(
                f"{path}: column '{name}' goes from {column.min():.4g} to {column.max():.4g}; "
                f"limits are {low:g} to {high:g}"
            )


class SplinePath:
    """A motion between its rows: quintic spline, at rest before and after."""

    def __init__(self, time: FloatArray, positions: FloatArray) -> None:
        self.duration = float(time[-1])
        still = np.zeros(positions.shape[1])
        rest: Any = ([(1, still), (2, still)], [(1, still), (2, still)])
        self._laws = [make_interp_spline(time, positions, k=5, bc_type=rest)]
        self._laws += [self._laws[0].derivative(order) for order in (1, 2)]

    def __call__(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration at ``time`` (n,), each (n, columns)."""
        inside = np.clip(time, 0.0, self.duration)
        position, speed, acceleration = (np.asarray(law(inside), dtype=np.float64) for law in self._laws)
        outside = (time < 0.0) | (time > self.duration)
        speed[outside] = 0.0
        acceleration[outside] = 0.0
        return position, speed, acceleration


def random_motion(
    machine: Machine,
    rng: np.random.Generator,
    seconds: float,
    *,
    rods: Rods = "pinned",
    use: float = 0.92,
    harmonics: int = 5,
    slowest: float = 0.05,
    rate: float = 50.0,
) -> Motion:
    """A smooth multi-sine for all joints (or all pistons), inside position, speed and acceleration limits.

    Each axis is a sum of ``harmonics`` sines at random frequencies from ``slowest`` (Hz) up, scaled until ``use`` of
    the tightest limit is reached, faded in and out over 2 s. Pistons stay where the joint's limits would keep them.
    """
    names, columns = [], []
    time = np.arange(round(seconds * rate) + 1) / rate
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
        frequency = slowest * (1 + np.arange(harmonics)) * rng.uniform(0.85, 1.15, harmonics)
        weight = rng.uniform(0.3, 1.0, harmonics) / (1 + np.arange(harmonics)) ** rng.uniform(0.4, 1.2)
        phase = rng.uniform(0, 2 * np.pi, harmonics)
        wave = (weight * np.sin(2 * np.pi * frequency * time[:, None] + phase)).sum(axis=1)
        centre = 0.5 * (wave.max() + wave.min())
        wave = (wave - centre) * fade
        rates = np.abs(np.gradient(wave, time)).max(), np.abs(np.gradient(np.gradient(wave, time), time)).max()
        scale = use * min(0.5 * (high - low) / np.abs(wave).max(), speed / rates[0], acceleration / rates[1])
        names.append(joint.name)
        columns.append(0.5 * (low + high) + scale * wave)
    return Motion(machine.name, rods, tuple(names), time, np.stack(columns, axis=1))
