"""Planned valve motions: what shows edges, curve, delay and leaks of each axis, within the limits of the machine.

Each axis has its own motion: at two poses, between which the load on it differs most, a rest with the valve closed and
a staircase of both signs, each level held for three delays and 0.4 s and undone by its opposite; at the first a ladder
of 1 % steps around each expected edge, up and down, and three slow sines. A last motion has levels of all axes
together, which shows the pump. What is expected comes from an earlier valve report, or from the machine file: full
command then gives the joint's largest speed, or what the pump's flow gives.

Levels are as large as the limits of speed and travel allow for speeds 30 % above the expected ones, and commands change
no faster than the limit of the acceleration allows. What the plan uses of each limit is computed from the motion
that follows of it, at the expected speeds and at 30 % more in either direction or both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.machine.travel import RodTravel, travel_of
from daq.valve_motions import Does, Step, ValveAxis, ValveMotion, write_valve_motion
from fitting.arm.base_parameters import reduce_parameters
from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.excitation.limits import LimitUse, holding_efforts, joint_limits_used, joint_numbers
from fitting.model.export.functions import identifier, rendered, written
from fitting.model.export.words import require_folder
from fitting.planning.guess import default_guess
from fitting.valve.export import SAFETY
from fitting.valve.identify import SCHEMA
from fitting.valve.inverse import ValveModel

FASTER = 1.3  # what a valve may give over what is expected of it
LEVEL = 0.8  # of full: the largest command
CLEAR = 0.05  # of the travel, left at each end
CAUTION = 0.5  # of full: the largest command of a move to a pose
_LEVELS, _RUNGS, _STEP = 6, 5, 0.01
_EDGE, _DELAY = 0.08, 0.25  # of full, s: of a valve that nothing is known of; its edge within 8 % is on the ladder
_REST, _PAUSE, _STOP, _RUNG, _PATIENCE = 10.0, 0.6, 0.3, 0.4, 8.0  # s
_POSES = (0.25, 0.75)  # of the travel: where other axes change the load on one


@dataclass(frozen=True)
class Expected(RodTravel):
    """Expectation of an axis with a valve.

    Attributes
    ----------
    speeds : m/s of the rod at :attr:`grid`, one row for each of extend and retract
    edges, delay : share of full of extend and retract, s
    rungs : of the ladder, to either side of an edge
    from_report : whether a report has it
    """

    speeds: FloatArray
    edges: tuple[float, float]
    delay: float
    rungs: int
    from_report: bool

    #: Shares of full command.
    grid = np.linspace(0.0, 1.0, 201)

    def moving(self, most: float) -> float:
        """Compute the slower direction's speed, m/s, at the largest command of a move to a pose; ``most`` caps it."""
        return float(np.abs(self.speed(np.array([1.0, -1.0]) * min(CAUTION, most))).min())

    def speed(self, share: FloatArray | float, faster: Sequence[float] = (1.0, 1.0)) -> FloatArray:
        """Compute rod speeds in m/s for shares of full, positive extends."""
        ways = zip(faster, self.speeds, strict=True)
        out, back = (factor * np.interp(np.abs(share), self.grid, row) for factor, row in ways)
        return np.asarray(np.where(np.asarray(share) > 0, out, -back))

    @property
    def room(self) -> float:
        """m between the ends that are kept clear."""
        return (1.0 - 2.0 * CLEAR) * float(np.ptp(self.range_x))

    @property
    def held(self) -> float:
        """Seconds for which a level is held."""
        return 3.0 * self.delay + 0.4

    def axis(self, level: float) -> ValveAxis:
        """Make the controller's axis; its largest command keeps ``level``, speed, travel, its rate the acceleration."""
        assert self.joint.cylinder is not None and self.joint.cylinder.valve is not None
        valve, limits, r = self.joint.cylinder.valve, self.joint.limits, float(np.abs(self.lever).min())
        fastest = self.speeds.max(axis=0)
        # A level goes 1.3 times its way to one side, and if only its opposite is fast, 0.3 times to the other.
        fits = (FASTER * fastest <= limits.velocity * r) & ((2.0 * FASTER - 1.0) * fastest * self.held <= self.room)
        most = min(level, float(self.grid[fits].max()), (valve.range[1] - valve.neutral) / valve.full,
                   (valve.neutral - valve.range[0]) / valve.full)  # fmt: skip
        slope = float(np.diff(fastest).max() / (self.grid[1] - self.grid[0]))
        return ValveAxis(
            self.joint.name, valve.neutral, valve.extends * valve.full * self.sense, *limits.position,
            speed=float(fastest[-1]) / r, edge=sum(self.edges) / 2, delay=self.delay, most=most,
            rate=limits.acceleration * r / (FASTER * slope),
        )  # fmt: skip


@dataclass(frozen=True)
class Planned:
    """A planned motion: its ``name``, length in s as expected, and what it uses of the limits at most."""

    name: str
    motion: ValveMotion
    seconds: float
    limits: tuple[LimitUse, ...]


def expected_of(machine: Machine, report: Mapping[str, Any] | None = None) -> list[Expected]:
    """Return the expectation of every valve's axis: of ``valve.json``, or else the machine file.

    Raises
    ------
    InputError
        If the machine has no valves, or the report is none of its valves.
    """
    axes = {} if report is None else report.get("axes", {})
    if report is not None and (report.get("schema") != SCHEMA or not isinstance(axes, dict)):
        raise InputError("fitting.after_no_valve_report")
    found = []
    for joint in machine.joints:
        if joint.cylinder is None or joint.cylinder.valve is None:
            continue
        travel, grid = travel_of(joint), Expected.grid
        assert travel.x is not None and travel.r is not None
        place = joint, travel.q, travel.x, travel.r
        if joint.name in axes:
            model = ValveModel.from_json(axes[joint.name]["model"])
            speeds = np.array([[way.speed(max(u - way.edge, 0.0)) for u in grid] for way in model.directions])
            edges = model.directions[0].edge, model.directions[1].edge
            found.append(Expected(*place, speeds, edges, model.delay, _RUNGS, True))
            continue
        areas = joint.cylinder.head_area, joint.cylinder.rod_area
        flow = np.inf if machine.pump_limit is None else machine.pump_limit
        full = [min(joint.limits.velocity * float(np.abs(travel.r).min()), flow / area) for area in areas]
        line = np.maximum(grid - _EDGE, 0.0) / (1.0 - _EDGE)
        found.append(Expected(*place, np.outer(full, line), (_EDGE, _EDGE), _DELAY, round(_EDGE / _STEP), False))
    if not found:
        raise InputError("fitting.no_joint_cylinder_valve", machine=machine.name)
    return found


def plan_valve_motions(
    machine: Machine,
    joints: Sequence[str] | None = None,
    report: Mapping[str, Any] | None = None,
    level: float = LEVEL,
) -> list[Planned]:
    """Plan a motion for each axis with a valve, and of several one of all together.

    Parameters
    ----------
    machine : with the limits to keep; those of pressure and flow are the valves' and the pump's own
    joints : names of the axes that are to have a motion; None: all
    report : content of an earlier ``valve.json``
    level : largest command, share of full

    Raises
    ------
    InputError
        If an axis is not there or has no valve, or no level fits its limits.
    """
    axes = expected_of(machine, report)
    names = [own.joint.name for own in axes]
    asked = names if joints is None else [machine.joints[k].name for k in joint_numbers(machine, joints)]
    for name in asked:
        if name not in names:
            raise InputError("fitting.joint_no_cylinder_valve", name=name, names=", ".join(names))
    commanded = [own.axis(level) for own in axes]
    for known, own in zip(axes, commanded, strict=True):
        if own.most < max(known.edges) + _RUNGS * _STEP:
            raise InputError("fitting.command_full_all_level", axis=own.axis, most=own.most)
    plans = [(f"valve-{name}", _of_axis(machine, axes, commanded, names.index(name))) for name in asked]
    if joints is None and len(axes) > 1:
        plans.append(("valve-all", _together(axes, commanded)))
    found = []
    for name, steps in plans:
        motion = ValveMotion(machine.name, tuple(commanded), tuple(steps))
        runs = [_expected_motion(machine, axes, motion, way) for way in product((1.0, FASTER), repeat=2)]
        uses: dict[tuple[str | None, str], LimitUse] = {}
        for q, qd, qdd in runs:
            for use in joint_limits_used(machine, q, qd, qdd):
                key = use.joint, use.quantity
                uses[key] = max(uses.get(key, use), use, key=lambda one: one.used)
        found.append(Planned(name, motion, len(runs[0][0]) / machine.rate_hz, tuple(uses.values())))
    return found


def _poses(machine: Machine, axes: Sequence[Expected], number: int) -> list[dict[str, float]]:
    """Choose poses, the axis in mid-travel, of most different holding efforts; the largest first."""
    base = reduce_parameters(geometry_of(machine).uncoupled())
    middle = np.array([sum(joint.limits.position) / 2 for joint in machine.joints])
    others = [k for k, own in enumerate(axes) if k != number]
    rows = []
    for shares in product(_POSES, repeat=len(others)):
        q = {own.joint.name: own.middle for own in axes}
        for k, share in zip(others, shares, strict=True):
            low, high = axes[k].joint.limits.position
            q[axes[k].joint.name] = low + share * (high - low)
        rows.append(q)
    table = np.array([[q.get(joint.name, middle[k]) for k, joint in enumerate(machine.joints)] for q in rows])
    held = holding_efforts(machine, base, default_guess(machine, base).base, table)
    load = held[:, [joint.name for joint in machine.joints].index(axes[number].joint.name)]
    return [rows[k] for k in sorted({int(np.argmax(load)), int(np.argmin(load))}, key=lambda k: -abs(load[k]))]


def _go(commanded: Sequence[ValveAxis], q: Mapping[str, float]) -> list[Step]:
    return [Step("go", _PATIENCE, tuple(q[own.axis] for own in commanded)), _closed(commanded, _PAUSE)]


def _closed(commanded: Sequence[ValveAxis], seconds: float) -> Step:
    return Step("hold", seconds, tuple(own.neutral for own in commanded))


def _of_axis(machine: Machine, axes: Sequence[Expected], commanded: Sequence[ValveAxis], number: int) -> list[Step]:
    own, axis = axes[number], commanded[number]

    def alone(share: float) -> tuple[float, ...]:
        return tuple(axis.sent(share) if other is axis else other.neutral for other in commanded)

    def at(pose: Mapping[str, float], away: float = 0.0) -> list[Step]:
        """Rest with the axis ``away`` m (positive: extended) from the pose."""
        return _go(commanded, {**pose, own.joint.name: float(own.q(own.x(pose[own.joint.name]) + away))})

    steps: list[Step] = []
    for place, pose in enumerate(_poses(machine, axes, number)):
        steps += [*at(pose), _closed(commanded, _REST if place == 0 else 4.0 * _PAUSE)]
        for level in np.linspace(max(own.edges) + _RUNGS * _STEP, axis.most, _LEVELS).tolist():
            way = float(np.abs(own.speed(np.array([level, -level]))).max()) * own.held
            steps += at(pose, -0.5 * way * own.sense)
            steps += [Step("hold", own.held, alone(share)) for share in (level, -level)]
            steps.append(_closed(commanded, _STOP))
        if place > 0:
            continue
        for sign in (1.0, -1.0):
            edge = own.edges[0 if sign == own.sense else 1]
            rungs = np.clip(edge + _STEP * np.arange(-own.rungs, own.rungs + 1), 0.0, axis.most)
            ladder = sign * np.concatenate([rungs, rungs[-2::-1]])
            ways = own.speed(ladder * own.sense)
            seconds = min(_RUNG, 0.8 * own.room / (FASTER * float(np.abs(ways).sum())))
            steps += at(pose, -0.5 * float(ways.sum()) * seconds)
            steps += [Step("hold", seconds, alone(share)) for share in ladder.tolist()]
        for share, part in ((0.45, 0.5), (0.7, 0.6), (1.0, 0.7)):
            amplitude = axis.edge + share * (axis.most - axis.edge)
            fast = float(np.abs(own.speed(np.array([amplitude, -amplitude]))).max())
            hz = min(fast * FASTER / (np.pi * part * own.room), 0.4)  # crosses a part of the travel
            steps += [*at(pose), Step("swing", 1.0 / hz, alone(amplitude), hz)]
            steps.append(_closed(commanded, _STOP))
    return steps


def _together(axes: Sequence[Expected], commanded: Sequence[ValveAxis]) -> list[Step]:
    """Step all axes, signs changing like the digits of a number: each axis with and against each other."""
    middle = {own.joint.name: own.middle for own in axes}
    seconds = min(own.held for own in axes)
    steps: list[Step] = []
    for number in range(8):
        size = (1.0, 0.8, 0.6)[number % 3]
        signs = [1.0 if number >> (k % 3) & 1 else -1.0 for k in range(len(axes))]
        shares = [s * (own.edge + size * (own.most - own.edge)) for s, own in zip(signs, commanded, strict=True)]
        pose = dict(middle)
        for own, share in zip(axes, shares, strict=True):
            way = float(own.speed(share * own.sense)) * seconds
            pose[own.joint.name] = float(own.q(own.x(middle[own.joint.name]) - 0.5 * way))
        steps += _go(commanded, pose)
        for sign in (1.0, -1.0):
            sent = tuple(own.sent(sign * share) for own, share in zip(commanded, shares, strict=True))
            steps.append(Step("hold", seconds, sent))
        steps.append(_closed(commanded, _STOP))
    return steps


def _expected_motion(
    machine: Machine, axes: Sequence[Expected], motion: ValveMotion, faster: Sequence[float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Predict joints' positions, speeds, accelerations (N, n), valves giving ``faster`` times the expected."""
    period = 1.0 / machine.rate_hz
    now, shares, parts = [own.x(own.middle) for own in axes], [0.0] * len(axes), []
    for step in motion.steps:
        goals = [own.x(q) for own, q in zip(axes, step.values, strict=True)] if step.does == "go" else None
        seconds = step.seconds
        if goals is not None:  # as long as the slowest axis takes at half of what it is allowed
            ways = zip(axes, motion.axes, goals, now, strict=True)
            taken = (own.delay + 2.0 * abs(goal - x) / own.moving(axis.most) for own, axis, goal, x in ways)
            seconds = min(max(1.0, *taken), seconds)
        time = np.arange(1, round(seconds / period) + 1) * period
        columns = []
        for k, (own, axis) in enumerate(zip(axes, motion.axes, strict=True)):
            if goals is not None:
                s = np.minimum(time / seconds * max(faster), 1.0)
                x = now[k] + (goals[k] - now[k]) * s**3 * (10 - 15 * s + 6 * s**2)
                shares[k] = 0.0
            else:
                share = []
                for goal in (axis.share(step.values[k]) * np.cos(2 * np.pi * step.hz * time)).tolist():
                    shares[k] += min(max(goal - shares[k], -axis.rate * period), axis.rate * period)
                    share.append(shares[k])
                x = now[k] + period * np.cumsum(own.speed(np.array(share) * own.sense, faster))
            now[k] = float(x[-1])
            columns.append(own.q(x))
        parts.append(np.stack(columns, axis=1))
    moved = np.concatenate(parts)
    q = np.tile([sum(joint.limits.position) / 2 for joint in machine.joints], (len(moved), 1))
    q[:, joint_numbers(machine, [own.joint.name for own in axes])] = moved
    qd = np.gradient(q, period, axis=0)
    return q, qd, np.gradient(qd, period, axis=0)


def written_plan(planned: Planned, folder: Path) -> tuple[Path, Path]:
    """Write ``NAME.csv``, the table, and ``NAME.st``, the program that plays it on the arm's own controller.

    Raises
    ------
    InputError
        If the folder is a file.
    """
    require_folder(folder)
    table = folder / f"{planned.name}.csv"
    write_valve_motion(table, planned.motion)
    name, axes, steps = identifier(planned.name), planned.motion.axes, planned.motion.steps
    text = rendered(
        "valve_motion.st.j2",
        name=name,
        card=[f"The valve motion {table.name} of {planned.motion.machine}, {planned.seconds:.0f} s.", *SAFETY],
        axes=[own.axis for own in axes],
        known={one.name: [float(getattr(own, one.name)) for own in axes] for one in fields(ValveAxis)[1:]},
        steps={
            "does": [float(get_args(Does).index(step.does)) for step in steps],
            "seconds": [step.seconds for step in steps],
            "hz": [step.hz for step in steps],
            "wanted": [value for step in steps for value in step.values],
        },
        caution=CAUTION,
        faster=FASTER,
        clear=CLEAR,
    )
    return table, written(folder, {f"{planned.name}.st": text}, ()).files[0]
