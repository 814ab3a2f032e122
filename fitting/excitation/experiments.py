"""Experiments that are motions: what the catalogue of effects asks for, as motion programs within the limits.

=================== ================================================================================
``staircase``       constant speeds of one cylinder, slow to fast, out and back; the others hold
``slow_reversals``  one short way there and back at three rates
``frequencies``     one amplitude at several frequencies
``two_poses``       the same strokes with the arm beyond the joint folded, and stretched
``neighbour``       a neighbour moves while the joint creeps
``free_cylinder``   the joint's rod unpinned: strokes and a staircase without any load
=================== ================================================================================

A resting joint shows nothing of its friction, so the joint under suspicion always moves, if only slowly. Every motion
starts and ends at rest; parts are joined by fifth-order steps, so acceleration is continuous.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import scipy

from daq.errors import InputError
from daq.machine.machine_file import Joint, Machine
from daq.messages import Sentence
from daq.motion_files import Motion
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.linkage import cylinder_of, joint_position, lever_arm, stroke_limits
from fitting.arrays import FloatArray
from fitting.excitation.cylinders import CylinderOptions, design_cylinder_motion
from fitting.excitation.limits import HydraulicLimits, limits_used
from fitting.excitation.staircase import staircase

#: Static drive efforts (N, n) at joint positions (N, n).
Holding = Callable[[FloatArray], FloatArray]

KINDS = ("staircase", "slow_reversals", "frequencies", "two_poses", "neighbour", "free_cylinder")

#: Largest slopes of the fifth-order step ``10 s^3 - 15 s^4 + 6 s^5``: of itself and of its first derivative.
_SPEED_OF_STEP, _ACCELERATION_OF_STEP = 1.875, 5.7735
_HIGHEST = 0.6  # Hz
_REVERSAL_SHARE = 0.06  # of the way that the joint has
_SLOWEST = 0.03  # of the top speed: some mm/s, where friction bends; slower ones reverse too slowly to be timed


@dataclass(frozen=True)
class Experiment:
    """One motion of the menu.

    Attributes
    ----------
    kind : one of :data:`KINDS`, or what a caller adds (``designed``, ``again``)
    text : what is done, in plain words
    motion : the motion program
    """

    kind: str
    text: str
    motion: Motion


@dataclass(frozen=True)
class Way:
    """Middle, half way (both in joint units), top speed and acceleration of one joint."""

    middle: float
    half: float
    speed: float
    acceleration: float


class NotPossibleError(InputError):
    """The machine or its limits do not allow an experiment."""


@dataclass(frozen=True)
class Arm:
    """The joint under suspicion, and what its experiments have to keep to.

    Attributes
    ----------
    machine : the arm
    joint : number of the joint
    seconds : length of each motion
    use : share of every limit that may be used
    holding : drive efforts that hold the arm, for the choice of two poses; without it they are the ends of the ranges
    hydraulic : supply flow and chamber pressure. A motion that asks for too much flow is run slower; one that asks for
        too much pressure is not possible
    base : the base parameters that ``hydraulic`` has values of; those of the machine if None
    """

    machine: Machine
    joint: int
    seconds: float = 60.0
    use: float = 0.92
    holding: Holding | None = None
    hydraulic: HydraulicLimits = field(default_factory=HydraulicLimits)
    base: BaseParameters | None = None

    @property
    def name(self) -> str:
        return self.machine.joints[self.joint].name

    @property
    def middle(self) -> FloatArray:
        """All joints mid-range, (n,)."""
        return np.array([sum(stroke_limits(each)) / 2 for each in self.machine.joints])

    def way(self, joint: int) -> Way:
        each = self.machine.joints[joint]
        low, high = stroke_limits(each)
        limits = each.limits
        return Way((low + high) / 2, self.use * (high - low) / 2, self.use * limits.velocity,
                    self.use * limits.acceleration)  # fmt: skip

    def time(self, seconds: float) -> FloatArray:
        return np.arange(round(seconds * self.machine.rate_hz) + 1) / self.machine.rate_hz

    def alone(self, course: FloatArray, pose: FloatArray | None = None) -> FloatArray:
        """Move the joint along a course (N,) in a pose (n,) of the others, mid-range if None: (N, n)."""
        q = np.tile(self.middle if pose is None else pose, (len(course), 1))
        q[:, self.joint] = course
        return q

    def stairs(self, seconds: float, levels: int, slowest: float) -> FloatArray:
        """Make joint positions of a staircase about mid-way: constant speeds of the drive."""
        each, way, time = self.machine.joints[self.joint], self.way(self.joint), self.time(seconds)
        try:
            if each.cylinder is None:
                return way.middle + staircase(time, seconds, levels, way.half, way.speed, way.acceleration, slowest)[0]
            middle, half, speed, acceleration = _piston_way(each, way)
            return joint_position(
                each, middle + staircase(time, seconds, levels, half, speed, acceleration, slowest)[0]
            )
        except InputError as error:
            raise NotPossibleError(str(error)) from None


def menu(arm: Arm) -> tuple[Experiment, ...]:
    """List all experiments of one joint that the limits allow."""
    found = []
    for kind in KINDS:
        with contextlib.suppress(NotPossibleError):
            found.append(experiment(arm, kind))
    return tuple(found)


def experiment(arm: Arm, kind: str) -> Experiment:
    """Make one experiment.

    Raises
    ------
    NotPossibleError
        If it needs what the machine does not have, or does not fit into its limits.
    InputError
        If there is no such experiment.
    """
    if kind not in KINDS:
        raise InputError("fitting.no_such_experiment", kind=kind, kinds=", ".join(KINDS))
    if kind == "free_cylinder":
        return _free_cylinder(arm)
    build = {
        "staircase": _staircase,
        "slow_reversals": _slow_reversals,
        "frequencies": _frequencies,
        "two_poses": _two_poses,
        "neighbour": _neighbour,
    }[kind]
    text, q = build(arm)
    return Experiment(kind, text, _kept(arm, q, kind))


def _piston_way(joint: Joint, way: Way) -> tuple[float, float, float, float]:
    """Return the middle, half way, speed and acceleration allowed to the piston anywhere."""
    linkage = cylinder_of(joint).linkage
    x = np.sort(linkage.piston_position(np.array([way.middle - way.half, way.middle + way.half])))
    r = float(np.abs(lever_arm(linkage, np.linspace(way.middle - way.half, way.middle + way.half, 51))).min())
    # Part of the joint's acceleration goes into the changing lever arm; a fifth is plenty for arms that are used.
    return float(x.mean()), float(x[1] - x[0]) / 2, r * way.speed, 0.8 * r * way.acceleration


def _seconds_of_step(arm: Arm, start: FloatArray, end: FloatArray) -> float:
    seconds = 0.5
    for joint in range(len(start)):
        way, distance = arm.way(joint), abs(end[joint] - start[joint])
        seconds = max(
            seconds,
            _SPEED_OF_STEP * distance / way.speed,
            float(np.sqrt(_ACCELERATION_OF_STEP * distance / way.acceleration)),
        )
    return 1.05 * seconds


def _largest_burst(way: Way, frequency: float) -> float:
    """Find a burst's largest amplitude within limits: half a period of fading adds to ``2 pi f`` and its square."""
    return min(way.half, way.speed / (10.1 * frequency), way.acceleration / (110.0 * frequency**2))


def _bursts(arm: Arm, highest: float, ratio: float, amplitude: float) -> tuple[str, FloatArray]:
    """Move the joint alone at three rates, the slowest ``ratio**2`` times slower than the highest, equally often.

    The rates move together where the time does not hold two periods of each. Returns what is done and the motion.
    """
    most = arm.seconds * highest / 2  # n (1 + r + r^2) / highest = seconds, n = 2
    ratio = max(1.2, min(ratio, (np.sqrt(max(4 * most - 3, 0.0)) - 1) / 2))
    frequencies = tuple(float(highest / ratio**k) for k in (2, 1, 0))
    cycles = max(2, int(arm.seconds / sum(1 / f for f in frequencies)))
    parts = [amplitude * _burst(arm.time(cycles / f)[:-1], f, cycles) for f in frequencies]
    course = arm.middle[arm.joint] + np.append(np.concatenate(parts), 0.0)
    return ", ".join(f"{f:.2g}" for f in frequencies), arm.alone(course)


def _staircase(arm: Arm) -> tuple[str, FloatArray]:
    q = arm.alone(arm.stairs(arm.seconds, 8, _SLOWEST))
    return Sentence("fitting.staircase_constant_speeds_out", arm=arm.name), q


def _slow_reversals(arm: Arm) -> tuple[str, FloatArray]:
    way = arm.way(arm.joint)
    amplitude = min(_REVERSAL_SHARE * way.half, _largest_burst(way, _HIGHEST))
    rates, q = _bursts(arm, _HIGHEST, 3.0, amplitude)
    where = {"arm": arm.name, "width": 2 * amplitude, "unit": _unit(arm)}
    return Sentence("fitting.reversals_at_three_rates", rates=rates, **where), q


def _frequencies(arm: Arm) -> tuple[str, FloatArray]:
    amplitude = _largest_burst(arm.way(arm.joint), _HIGHEST)
    rates, q = _bursts(arm, _HIGHEST, 2.0, amplitude)
    where = {"arm": arm.name, "amplitude": amplitude, "unit": _unit(arm)}
    return Sentence("fitting.bursts_at_one_amplitude", rates=rates, **where), q


def _two_poses(arm: Arm) -> tuple[str, FloatArray]:
    if len(arm.machine.joints) < 2:
        raise NotPossibleError("fitting.joint_no_other_pose", machine=arm.machine.name)
    light, heavy = _poses(arm)
    rate, there = arm.machine.rate_hz, _seconds_of_step(arm, light, heavy)
    first = _seconds_of_step(arm, arm.middle, light)
    strokes = (arm.seconds - first - there) / 2
    course = arm.stairs(max(strokes, 8.0), 4, 0.05)
    start = arm.middle
    start[arm.joint] = light[arm.joint] = heavy[arm.joint] = course[0]
    parts = [start[None, :], _step(start, light, first, rate)]
    for pose in (light, heavy):
        if pose is heavy:
            parts.append(_step(light, heavy, there, rate))
        parts.append(arm.alone(course, pose))
    text = Sentence("fitting.same_strokes_twice_other", arm=arm.name)
    return text, np.concatenate(parts)


def _poses(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Find poses of the other joints at which the joint's mean load is smallest and largest."""
    ends = np.array([(way.middle - way.half, way.middle + way.half) for way in map(arm.way, range(len(arm.middle)))])
    grid = np.array(np.meshgrid(*[(0.0, 0.5, 1.0)] * min(4, len(arm.middle)), indexing="ij"))
    shares = np.full((grid[0].size, len(arm.middle)), 0.5)
    # The joints that carry most sit next to the one in question.
    near = np.argsort(np.abs(np.arange(len(arm.middle)) - arm.joint), kind="stable")[: grid.shape[0]]
    shares[:, near] = grid.reshape(grid.shape[0], -1).T
    shares[:, arm.joint] = 0.5
    poses = np.unique(ends[:, 0] + shares * (ends[:, 1] - ends[:, 0]), axis=0)
    if arm.holding is None:
        return poses[0], poses[-1]
    size = np.zeros(len(poses))
    for share in (0.1, 0.5, 0.9):
        moved = poses.copy()
        moved[:, arm.joint] = ends[arm.joint, 0] + share * (ends[arm.joint, 1] - ends[arm.joint, 0])
        size += np.abs(arm.holding(moved)[:, arm.joint])
    return poses[int(np.argmin(size))], poses[int(np.argmax(size))]


def _neighbour(arm: Arm) -> tuple[str, FloatArray]:
    count = len(arm.machine.joints)
    others = [k for k in (arm.joint + 1, arm.joint - 1) if 0 <= k < count]
    if not others:
        raise NotPossibleError("fitting.joint_no_neighbour", machine=arm.machine.name)
    time, way = arm.time(arm.seconds), arm.way(arm.joint)
    # Creeping over the whole way and back, 1.5 times: slow, and never at rest for long.
    creep = 1.5 / arm.seconds
    amplitude = min(way.half, way.speed / (9.0 * creep), way.acceleration / (70.0 * creep**2))
    q = arm.alone(way.middle + amplitude * _wave(time, arm.seconds, creep))
    for place, other in enumerate(others):
        near = arm.way(other)
        frequency = (0.3, 0.43)[place]
        size = min(near.half, near.speed / (9.0 * frequency), near.acceleration / (70.0 * frequency**2))
        q[:, other] += size * _wave(time, arm.seconds, frequency)
    names = [arm.machine.joints[k].name for k in others]
    over = "stroke" if arm.machine.joints[arm.joint].cylinder else "range"
    return Sentence("fitting.swing_while_creeps_over", names=names, arm=arm.name, range=over), q


def _free_cylinder(arm: Arm) -> Experiment:
    name = arm.name
    if arm.machine.joints[arm.joint].cylinder is None:
        raise NotPossibleError("fitting.joint_no_cylinder_nothing_unpin", name=name)
    options = CylinderOptions(seconds=arm.seconds, starts=1, use=arm.use)
    motion = design_cylinder_motion(arm.machine, options=options, joints=[name], flow=arm.hydraulic.flow).motion
    text = Sentence("fitting.rod_unpinned_free_strokes", name=name)
    return Experiment("free_cylinder", text, motion)


def _kept(arm: Arm, q: FloatArray, kind: str) -> Motion:
    """Run the motion as much slower as its limits ask for."""
    machine, use = arm.machine, arm.use
    time = np.arange(len(q)) / machine.rate_hz
    slower = 1.0
    for _ in range(4):
        qd = np.gradient(q, time * slower, axis=0)
        qdd = np.gradient(qd, time * slower, axis=0)
        uses = limits_used(machine, arm.hydraulic, q, qd, qdd, arm.base)
        ratio = max(
            (
                each.used / use if each.quantity in ("velocity", "flow") else np.sqrt(each.used / use)
                for each in uses
                if each.quantity in ("velocity", "flow", "acceleration")
            ),
            default=1.0,
        )
        if ratio <= 1.0:
            break
        slower *= 1.02 * float(ratio)
    # The way of the joint under suspicion is `use` of its range already; where others are parked is no overshoot.
    over = [each for each in uses if each.used > (use if each.quantity == "pressure" else 1.0) + 1e-9]
    if over:
        worst = max(over, key=lambda each: each.used)
        raise NotPossibleError(
            "fitting.would_reach_limit",
            kind=kind,
            joint=worst.joint or "supply",
            quantity=worst.quantity,
            used=worst.used,
        )
    if slower > 1.0:
        count = int(np.ceil(len(q) * slower))
        q = scipy.interpolate.make_interp_spline(time, q, k=5)(np.linspace(0.0, time[-1], count))
        time = np.arange(count) / machine.rate_hz
    columns = {joint.name: q[:, i].copy() for i, joint in enumerate(machine.joints)}
    return Motion(machine.name, "pinned", time, columns)


def _unit(arm: Arm) -> str:
    return "rad" if arm.machine.joints[arm.joint].type == "revolute" else "m"


def _fifth_order(s: FloatArray) -> FloatArray:
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def _step(start: FloatArray, end: FloatArray, seconds: float, rate_hz: float) -> FloatArray:
    """Make a fifth-order step from one pose (n,) to another, (N, n), end included."""
    s = np.arange(1, round(seconds * rate_hz) + 1) / round(seconds * rate_hz)
    return start + (end - start) * _fifth_order(s)[:, None]


def _burst(time: FloatArray, frequency: float, cycles: int) -> FloatArray:
    """Make ``cycles`` periods of a unit sine, faded in and out over half a period each; 0 afterwards."""
    length = cycles / frequency
    edge = np.clip(2 * np.minimum(time, length - time) * frequency, 0.0, 1.0)
    return np.where(time <= length, _fifth_order(edge) * np.sin(2 * np.pi * frequency * time), 0.0)


def _wave(time: FloatArray, seconds: float, frequency: float) -> FloatArray:
    """Make a unit sine over the whole time, faded in and out within its first and last period or 3 s."""
    edge = np.clip(np.minimum(time, seconds - time) / max(min(1 / frequency, seconds / 4), 3.0), 0.0, 1.0)
    return _fifth_order(edge) * np.sin(2 * np.pi * frequency * time)
