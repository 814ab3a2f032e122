"""From axes in space to a standard Denavit-Hartenberg table.

Frame ``i - 1`` has its z along the axis of joint ``i``; x of frame ``i`` lies along the common normal of axes ``i`` and
``i + 1``. Where that is not unique, the table with more zeros is taken: parallel axes share the height of the frame
before (``d = 0``), and the base frame is the model's own as far as the first axis allows. Frame ``n`` stands at the
tip, its z along the last axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.arrays import FloatArray
from daq.kinematics.chain import Chain, about

#: Sine below which two axes count as parallel. Files that round quarter turns to four digits are 1e-5 off, and the
#: common normal of axes that are parallel but for that may be a kilometre away.
PARALLEL = 1e-4
_ZERO = 1e-9  # m, rad: rounding of the file's own digits


@dataclass(frozen=True)
class Table:
    """Rows of a standard Denavit-Hartenberg table.

    Attributes
    ----------
    rows : (n, 4) ``a alpha d theta``, m and rad
    base : (4, 4) frame 0 in the chain's base frame
    end : (4, 4) the chain's tip in frame n
    revolute : per joint
    """

    rows: FloatArray
    base: FloatArray
    end: FloatArray
    revolute: tuple[bool, ...]

    def pose(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the pose (4, 4) of the chain's tip in its base frame at joint positions ``q`` (n,)."""
        pose = self.base
        for row, turns, value in zip(self.rows, self.revolute, np.asarray(q, dtype=float), strict=True):
            a, alpha, d, theta = row
            pose = pose @ _row(a, alpha, d + (0.0 if turns else value), theta + (value if turns else 0.0))
        return np.asarray(pose @ self.end)

    def gravity(self, gravity: FloatArray) -> FloatArray:
        """Transform a vector of the chain's base frame to frame 0."""
        return np.asarray(self.base[:3, :3].T @ gravity)


def table_of(chain: Chain) -> Table:
    """Derive the chain's table. Axes that are parallel within :data:`PARALLEL` are made so."""
    directions = _squared_up([axis.direction for axis in chain.axes])
    frame = _first_frame(chain, directions[0])
    base, rows = frame, []
    for number in range(len(chain.axes)):
        if number + 1 < len(chain.axes):
            row = _to_axis(frame, chain.axes[number + 1].point, directions[number + 1])
        else:
            row = _to_point(frame, chain.end[:3, 3])
        rows.append(row)
        frame = frame @ _row(*row)
    revolute = tuple(axis.type == "revolute" for axis in chain.axes)
    return Table(np.array(rows), base, np.linalg.inv(frame) @ chain.end, revolute)


def _row(a: float, alpha: float, d: float, theta: float) -> FloatArray:
    """Compute ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``."""
    return np.asarray(about(2, theta, d) @ about(0, alpha, a))


def _squared_up(directions: list[FloatArray]) -> list[FloatArray]:
    """Square directions up with the base's axes, or an earlier one, where nearly so."""
    known = [np.eye(3)[k] for k in range(3)]
    result = []
    for direction in directions:
        own = direction / np.linalg.norm(direction)
        for other in known:
            if np.linalg.norm(np.cross(own, other)) < PARALLEL:
                own = other * np.sign(own @ other)
                break
        else:
            known.append(own)
        result.append(own)
    return result


def _first_frame(chain: Chain, z: FloatArray) -> FloatArray:
    """Place frame 0: on the first axis at the foot of the base's origin, turned least from the base."""
    point = chain.axes[0].point
    x = np.eye(3)[0] - z[0] * z
    if np.linalg.norm(x) < 0.1:  # the first axis is the base's x: then the base's y
        x = np.eye(3)[1] - z[1] * z
    x = x / np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    frame[:3, 3] = point - (point @ z) * z
    return frame


def _to_axis(frame: FloatArray, point: FloatArray, direction: FloatArray) -> tuple[float, float, float, float]:
    """Compute the row that leads from a frame to the next axis."""
    p, z = frame[:3, :3].T @ (point - frame[:3, 3]), frame[:3, :3].T @ direction
    sine = float(np.hypot(z[0], z[1]))
    if sine > PARALLEL:
        # Common normal of the frame's z axis and the line p + s z. Of its two directions that to the next axis; where
        # both meet, that which turns least.
        x = np.array([-z[1], z[0], 0.0]) / sine
        a = float(x @ p)
        if a < -_ZERO or (abs(a) <= _ZERO and (x[0] < -_ZERO or (abs(x[0]) <= _ZERO and x[1] < 0))):
            x, a = -x, -a
        d = float(p[2] - z[2] * (z[0] * p[0] + z[1] * p[1]) / sine**2)
        across = np.cross([0.0, 0.0, 1.0], x)
        return _clean(a), _clean(np.arctan2(-(z @ across), z[2])), _clean(d), _clean(np.arctan2(x[1], x[0]))
    alpha = 0.0 if z[2] > 0 else np.pi
    a = float(np.hypot(p[0], p[1]))
    if a <= _ZERO:  # one axis in line with the other: up to its point
        return 0.0, alpha, _clean(float(p[2])), 0.0
    return _clean(a), alpha, 0.0, _clean(np.arctan2(p[1], p[0]))


def _to_point(frame: FloatArray, point: FloatArray) -> tuple[float, float, float, float]:
    """Compute the row that leads from the last axis to the tip."""
    p = frame[:3, :3].T @ (point - frame[:3, 3])
    a = float(np.hypot(p[0], p[1]))
    theta = np.arctan2(p[1], p[0]) if a > _ZERO else 0.0
    return _clean(a), 0.0, _clean(float(p[2])), _clean(float(theta))


def _clean(value: float) -> float:
    return 0.0 if abs(value) <= _ZERO else float(value)
