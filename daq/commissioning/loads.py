"""What a drive's effort follows: gravity of links nobody has weighed, inertia, friction; as functions of the motion.

Nothing is identified here: the columns span what an effort may be, so that its delay can be told.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from daq.kinematics.chain import about
from daq.machine.machine_file import Machine
from daq.machine.travel import lever_arm

FloatArray = npt.NDArray[np.float64]


def load_columns(machine: Machine, number: int, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    """Build columns (N, p), each of unit deviation, with one of ones.

    Parameters
    ----------
    number : the joint
    q, v, a : (N, n) positions, velocities and accelerations of all joints
    """
    joint = machine.joints[number]
    torque = np.column_stack([_gravity(machine, number, q), a])
    if joint.cylinder is not None:
        torque = torque / lever_arm(joint.cylinder.linkage, q[:, number])[:, None]
    own = v[:, number] / (v[:, number].std() or 1.0)
    columns = np.column_stack([torque, own, np.tanh(own / 0.1)])
    columns = columns - columns.mean(axis=0)
    spread = columns.std(axis=0)
    moving = spread > 1e-9 * spread.max()
    return np.column_stack([np.ones(len(q)), columns[:, moving] / spread[moving]])


def _gravity(machine: Machine, number: int, q: FloatArray) -> FloatArray:
    """Compute efforts at a joint of unit masses at four points of each link beyond: (N, 4 links) or (N, links)."""
    poses = _poses(machine, q)
    first = poses[number] if machine.convention == "standard" else poses[number + 1]
    axis, point = first[:, :3, 2], first[:, :3, 3]
    gravity = np.asarray(machine.gravity)
    if machine.joints[number].type == "prismatic":
        return np.asarray((axis @ gravity)[:, None])
    columns = []
    for pose in poses[number + 1 :]:
        arms = [pose[:, :3, 3] - point, *(pose[:, :3, k] for k in range(3))]
        columns += [np.einsum("ni,ni->n", axis, np.cross(arm, gravity)) for arm in arms]
    return np.stack(columns, axis=1)


def _poses(machine: Machine, q: FloatArray) -> list[FloatArray]:
    """Compute frames 0 to n of the table, each (N, 4, 4)."""
    poses = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
    for number, joint in enumerate(machine.joints):
        row, turns = joint.dh, joint.type == "revolute"
        theta = row.theta + (q[:, number] if turns else 0.0 * q[:, number])
        d = row.d + (0.0 * q[:, number] if turns else q[:, number])
        about_z, about_x = about(2, theta, d), about(0, row.alpha, row.a)
        step = about_z @ about_x if machine.convention == "standard" else about_x @ about_z
        poses.append(poses[-1] @ step)
    return poses
