"""A serial chain of joints as axes in space, with all joints at zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from daq.arrays import FloatArray


@dataclass(frozen=True)
class Axis:
    """One joint.

    Attributes
    ----------
    name : the joint's
    type : what it does about, or along, its axis
    point, direction : (3,) a point on the axis (m) and its unit vector, in the base frame
    position : limits in rad (m), or None where the file has none
    velocity : limit in rad/s (m/s), or None
    """

    name: str
    type: Literal["revolute", "prismatic"]
    point: FloatArray
    direction: FloatArray
    position: tuple[float, float] | None
    velocity: float | None


@dataclass(frozen=True)
class Chain:
    """A serial arm from base to tip.

    Attributes
    ----------
    name : the arm's
    base, tip : names of the first and the last link
    axes : base to tip
    end : (4, 4) pose of the tip in the base frame
    gravity : (3,) in the base frame, m/s^2
    notes : what was assumed or left out, one line each
    """

    name: str
    base: str
    tip: str
    axes: tuple[Axis, ...]
    end: FloatArray
    gravity: FloatArray
    notes: tuple[str, ...] = ()

    def pose(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the tip's pose (4, 4) at joint positions ``q`` (n,): the product of the axes' screws."""
        pose = np.eye(4)
        for axis, value in zip(self.axes, np.asarray(q, dtype=float), strict=True):
            pose = pose @ _moved(axis, float(value))
        return pose @ self.end


def _moved(axis: Axis, value: float) -> FloatArray:
    """Compute the motion (4, 4) beyond a joint that moves by ``value``."""
    motion = np.eye(4)
    if axis.type == "prismatic":
        motion[:3, 3] = value * axis.direction
        return motion
    motion[:3, :3] = turning(axis.direction, value)
    motion[:3, 3] = axis.point - motion[:3, :3] @ axis.point
    return motion


def turning(direction: FloatArray, angle: float) -> FloatArray:
    """Compute the rotation (3, 3) about a unit vector (Rodrigues)."""
    x, y, z = direction
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def about(axis: int, angle: npt.ArrayLike, way: npt.ArrayLike) -> FloatArray:
    """Compute motions (..., 4, 4) about a frame's axis (0 is x) by ``angle`` (...), rad, along it ``way`` (...), m."""
    angle, way = np.broadcast_arrays(angle, way)
    second, third = (axis + 1) % 3, (axis + 2) % 3
    made = np.zeros((*angle.shape, 4, 4))
    made[..., second, second] = made[..., third, third] = np.cos(angle)
    made[..., third, second] = np.sin(angle)
    made[..., second, third] = -made[..., third, second]
    made[..., axis, axis] = made[..., 3, 3] = 1.0
    made[..., axis, 3] = way
    return made
