"""Motion of joints and pistons from the sensor that is chosen for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arm.linkage import joint_motion, lever_arm, piston_motion
from fitting.arrays import BoolArray, FloatArray
from fitting.checks.mistakes.samples import Samples, Signal, moving


@dataclass(frozen=True)
class Motion:
    """Motion of joints (T, n) and of what drives them; ``r`` the lever arm, 1 without a cylinder."""

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    r: FloatArray
    speed_noise: FloatArray
    active: BoolArray


def positions_of(machine: Machine, samples: Samples) -> tuple[str, ...]:
    """Which position sensor is used of each joint: the joint's own, else the piston's."""
    return tuple(
        "joint_position" if samples.get("joint_position", number) is not None else "piston_position"
        for number in range(len(machine.joints))
    )


def motion_of(machine: Machine, samples: Samples, positions: Sequence[str]) -> Motion:
    """Motion of all joints from the sensor chosen for each; in `unloaded` recordings the piston's own."""
    count = len(samples)
    columns: dict[str, list[FloatArray]] = {key: [] for key in ("q", "qd", "qdd", "x", "v", "a", "r")}
    noises, active = [], []
    for number, joint in enumerate(machine.joints):
        signal = samples.get(positions[number], number)
        if signal is None:
            signal = Signal(np.full(count, np.mean(joint.limits.position)), np.zeros(count), np.zeros(count))
        own = (signal.value, signal.first, signal.second)
        noise = signal.speed_noise
        if joint.cylinder is None:
            q, x, r = own, own, np.ones(count)
        else:
            linkage = joint.cylinder.linkage
            piston = samples.get("piston_position", number)
            if positions[number] == "piston_position":
                x = own
                q = joint_motion(joint, *own)
                r = lever_arm(linkage, q[0])
            else:
                q = own
                x = piston_motion(linkage, *own)
                r = lever_arm(linkage, q[0])
                noise *= float(np.sqrt(np.mean(r**2)))
            if piston is not None and not samples.loaded.all():
                free = ~samples.loaded
                x = (
                    np.where(free, piston.value, x[0]),
                    np.where(free, piston.first, x[1]),
                    np.where(free, piston.second, x[2]),
                )
                middle = float(np.median(q[0][free]))
                q = (np.where(free, middle, q[0]), np.where(free, 0.0, q[1]), np.where(free, 0.0, q[2]))
        for key, value in zip(("q", "qd", "qdd", "x", "v", "a"), (*q, *x), strict=True):
            columns[key].append(value)
        columns["r"].append(np.where(np.abs(r) < 1e-6, 1e-6, r))
        noises.append(noise)
        active.append(moving(x[1], noise))
    stacked = {key: np.nan_to_num(np.stack(value, axis=1)) for key, value in columns.items()}
    return Motion(**stacked, speed_noise=np.array(noises), active=np.stack(active, axis=1))
