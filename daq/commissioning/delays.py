"""Delays between buses, from what both of them see of one motion, by cross-correlation.

Channels of two buses are compared joint by joint. A position on one bus and a position of the same joint on the other
are functions of each other, whatever the linkage; an effort on one bus follows the motion that the other one sees
(gravity, friction, inertia). So a channel ``y`` of one bus is regressed on functions ``X`` of the other's
position (:func:`_load_columns`)::

    position    y(t) = X(t - d) b + e,  X = [1, q, q^2, q^3]
    effort      y(t) = X(t - d) b + e,  X = gravity of every link, accelerations, v, tanh(v / v0)

and the delay ``d`` is where the sum of squares is smallest, that is where the multiple correlation is largest. Both
sides are smoothed by the same symmetric polynomial filter, which shifts nothing. The standard deviation comes from
leaving out one block of the recording after the other (jackknife), so noise may be coloured; joints that disagree by
more than that make it larger. What is not in ``X`` and has a phase of its own (hoses, presliding) goes into the delay
of an effort; a delay between positions has none of that, so positions alone are taken where there are some.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from daq.arrays import FloatArray
from daq.kinematics.chain import about
from daq.machine.machine_file import Channel, Machine
from daq.machine.travel import lever_arm
from daq.recordings.recording_checks import runs

LONGEST_S = 0.3  # delays that are looked for
BLOCKS = 12
LEAST_S = 15.0  # of a motion without a gap
SMOOTH_S = 0.3  # window of the polynomial filter
STEPS = 5  # of the grid, per sample; the smallest sum of squares is on a parabola between them
LEAST_R2 = 0.8  # of what the other bus's motion has to explain
NOISE_OF_MOTION = 30.0  # a position that moved has at least so many standard deviations of its noise
POSITIONS = ("joint_position", "piston_position", "motor_position")
EFFORTS = ("cylinder_force", "joint_effort", "motor_effort")


@dataclass(frozen=True)
class PairDelay:
    """Delay between one channel (or both pressures) and the position of its joint on another bus.

    Attributes
    ----------
    joint : its name
    late, reference : channels; ``late`` has both pressures where they make one force
    kind : ``position`` or ``effort``
    seconds, std : by how much the later bus of the two is behind, and its standard deviation, s
    r2 : share of ``late`` that the reference explains
    """

    joint: str
    late: tuple[str, ...]
    reference: str
    kind: str
    seconds: float
    std: float
    r2: float


@dataclass(frozen=True)
class BusDelay:
    """By how much ``bus`` is later than ``reference`` (negative: earlier), s, and the pairs that say so."""

    bus: str
    reference: str
    seconds: float
    std: float
    pairs: tuple[PairDelay, ...]


def bus_delays(machine: Machine, values: Mapping[str, FloatArray], rate_hz: float) -> list[BusDelay]:
    """Estimate delays between the buses of a machine.

    Parameters
    ----------
    values : per channel (N,), SI, at ``rate_hz``; NaN where it was not measured in its cycle

    Returns
    -------
    list of BusDelay
        One per pair of buses that see one motion; empty where nothing moved for long enough.
    """
    order = [bus.name for bus in machine.buses]  # the first one is the reference
    found: dict[tuple[str, str], list[PairDelay]] = {}
    for number, joint in enumerate(machine.joints):
        own = [c for c in machine.channels if c.joint == joint.name and c.source is not None and c.name in values]
        for reference in (c for c in own if c.quantity in POSITIONS):
            base = _bus(reference)
            for bus in sorted({_bus(c) for c in own} - {base}, key=order.index):
                for late, y, kind in _signals(machine, [c for c in own if _bus(c) == bus], values):
                    forth = order.index(base) < order.index(bus)
                    motion = _motion(machine, number, reference, values, kind)
                    if motion is None or (kind == "position" and not forth):  # the same two, seen from the other side
                        continue
                    delay = _delay(motion, y, rate_hz)
                    if delay is not None:
                        key = (bus, base) if forth else (base, bus)
                        seconds = delay[0] if forth else -delay[0]
                        pair = PairDelay(joint.name, late, reference.name, kind, seconds, *delay[1:])
                        found.setdefault(key, []).append(pair)
    return [_together(bus, base, pairs) for (bus, base), pairs in found.items()]


@dataclass(frozen=True)
class _Motion:
    """The regressors of a signal: positions (N, n) of one bus, and its columns for them."""

    q: FloatArray
    number: int  # which of them has to move
    columns: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def _motion(
    machine: Machine, number: int, reference: Channel, values: Mapping[str, FloatArray], kind: str
) -> _Motion | None:
    """Return the motion that a signal follows; None where the reference's bus does not see all of it."""
    if kind == "position":
        return _Motion(values[reference.name][:, None], 0, lambda q, v, a: _polynomial(q[:, 0]))
    positions = [machine.channel("joint_position", joint.name) for joint in machine.joints]
    seen = [c.name for c in positions if c is not None and _bus(c) == _bus(reference) and c.name in values]
    if reference.quantity != "joint_position" or len(seen) < len(positions):
        return None
    q = np.stack([values[name] for name in seen], axis=1)
    return _Motion(q, number, lambda q, v, a: _load_columns(machine, number, q, v, a))


def _bus(channel: Channel) -> str:
    return "" if channel.source is None else channel.source.bus


def _signals(
    machine: Machine, channels: Sequence[Channel], values: Mapping[str, FloatArray]
) -> list[tuple[tuple[str, ...], FloatArray, str]]:
    """Return a joint's signals of motion on one bus: names, signal, kind."""
    found: list[tuple[tuple[str, ...], FloatArray, str]] = []
    by_quantity = {c.quantity: c for c in channels}
    for channel in channels:
        if channel.quantity in POSITIONS or channel.quantity in EFFORTS:
            kind = "position" if channel.quantity in POSITIONS else "effort"
            found.append(((channel.name,), values[channel.name], kind))
    head, rod = by_quantity.get("head_pressure"), by_quantity.get("rod_pressure")
    if head is not None and rod is not None and head.joint is not None:
        cylinder = machine.joint(head.joint).cylinder
        if cylinder is not None:
            force = cylinder.head_area * values[head.name] - cylinder.rod_area * values[rod.name]
            found.append(((head.name, rod.name), force, "effort"))
    return found


def _delay(motion: _Motion, y: FloatArray, rate_hz: float) -> tuple[float, float, float] | None:
    """Fit the delay of ``y`` behind the motion, s, deviation, explained share; None where it does not fit."""
    whole = runs(np.isfinite(y) & np.isfinite(motion.q).all(axis=1))
    part = max(whole, key=lambda run: run.stop - run.start, default=slice(0, 0))
    if part.stop - part.start < LEAST_S * rate_hz:
        return None
    y, q = y[part], motion.q[part]
    moving = q[:, motion.number]
    noise = float(np.std(np.diff(moving, n=2)) / np.sqrt(6.0))
    if np.ptp(moving) <= NOISE_OF_MOTION * noise or np.ptp(y) == 0.0:
        return None
    window = max(5, round(SMOOTH_S * rate_hz) | 1)
    y = scipy.signal.savgol_filter(y, window, 3)
    derivatives = [
        scipy.signal.savgol_filter(q, window, 3, deriv=order, delta=1 / rate_hz, axis=0) for order in range(3)
    ]
    edge = round(LONGEST_S * rate_hz) + window
    inner = np.arange(edge, len(y) - edge)
    delays = np.arange(window - edge, edge - window + 1 / STEPS, 1 / STEPS) / rate_hz
    splines = scipy.interpolate.CubicSpline(np.arange(len(y)) / rate_hz, motion.columns(*derivatives), axis=0)
    blocks = np.array_split(inner, BLOCKS)
    # (D, BLOCKS, p + 1, p + 1): products of columns and target, of which any blocks can be summed
    squares = np.array([[_squares(splines(block / rate_hz - d), y[block]) for block in blocks] for d in delays])
    total = squares.sum(axis=1)
    J = _residuals(total)
    r2 = 1.0 - float(J.min() / ((y[inner] - y[inner].mean()) ** 2).sum())
    best = _minimum(delays, J)
    left_out = [_minimum(delays, _residuals(total - squares[:, block])) for block in range(BLOCKS)]
    estimates = np.array([value for value in left_out if value is not None])
    if best is None or r2 < LEAST_R2 or len(estimates) < BLOCKS:
        return None
    std = float(np.sqrt((BLOCKS - 1) / BLOCKS * ((estimates - estimates.mean()) ** 2).sum()))
    return best, std, r2


def _polynomial(q: FloatArray) -> FloatArray:
    z = (q - q.mean()) / (q.std() or 1.0)
    return np.stack([np.ones_like(z), z, z**2, z**3], axis=1)


def _squares(X: FloatArray, y: FloatArray) -> FloatArray:
    rows = np.column_stack([X, y])
    return np.asarray(rows.T @ rows)


def _residuals(squares: FloatArray) -> FloatArray:
    """Compute the sums of squares of a regression from products (D, p + 1, p + 1) of columns and target."""
    XX, Xy, yy = squares[:, :-1, :-1], squares[:, :-1, -1], squares[:, -1, -1]
    ridge = 1e-10 * np.trace(XX, axis1=1, axis2=2)[:, None, None] * np.eye(XX.shape[1])
    b = np.linalg.solve(XX + ridge, Xy[:, :, None])[:, :, 0]
    return np.asarray(yy - (b * Xy).sum(axis=1))


def _minimum(delays: FloatArray, J: FloatArray) -> float | None:
    """Find the minimum on the parabola through three points; None at an end."""
    k = int(np.argmin(J))
    if k in (0, len(J) - 1):
        return None
    below, here, above = J[k - 1 : k + 2]
    curvature = below - 2 * here + above
    step = delays[1] - delays[0]
    return float(delays[k] + (0.5 * (below - above) / curvature * step if curvature > 0 else 0.0))


def _together(bus: str, base: str, pairs: Sequence[PairDelay]) -> BusDelay:
    """Average all pairs, weighted by deviations, which grow where pairs disagree (Birge)."""
    chosen = [pair for pair in pairs if pair.kind == "position"] or list(pairs)
    d = np.array([pair.seconds for pair in chosen])
    weights = np.array([1.0 / max(pair.std, 1e-6) ** 2 for pair in chosen])
    mean = float((weights * d).sum() / weights.sum())
    std = float(weights.sum() ** -0.5)
    if len(chosen) > 1:
        ratio = float((weights * (d - mean) ** 2).sum() / (len(chosen) - 1))
        std *= max(1.0, ratio**0.5)
    return BusDelay(bus, base, mean, std, tuple(chosen))


def _load_columns(machine: Machine, number: int, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    """Build columns (N, p) that span what a drive's effort may be, each of unit deviation, with one of ones.

    Gravity of links that nobody has weighed, inertia, friction, as functions of the motion; nothing is identified.

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
