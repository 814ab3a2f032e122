"""Displacement signals for free cylinders (stage 1, rods unpinned): all of them at once, each on its own
course.

First a band-limited part, a Fourier series at rest at both ends, chosen so that the columns of stage 1,

    [x'', x, sgn x', x', |x'|^(1/3) sgn x'],

are as independent as they get: slow reversals and fast strokes, small and large. Then a staircase of constant
speeds, out and back at each: where nothing accelerates, the force over the speed is the friction curve
itself.

A free piston may move as fast as the joint's limits would let it at the longest lever arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Joint, Machine
from daq.motion_files import Motion
from fitting.arm.linkage import cylinder_of, lever_arm
from fitting.arrays import FloatArray
from fitting.excitation.fourier import fourier_basis
from fitting.excitation.limits import LimitUse, interval_use, joint_numbers, size_use
from fitting.excitation.objective import condition_of_information, spectral_objective
from fitting.excitation.search import lbfgs
from fitting.excitation.staircase import LEVEL_SECONDS, staircase

_NORM_POWER = 24  # of the p-norm that keeps the limits, as for whole motions
_FLOW_TRIALS = 4  # speeds come down in proportion to the flow that is asked for: two are enough as a rule
_SOFT = 0.02  # of the top speed: the width over which sgn is smoothed, while searching only


@dataclass(frozen=True)
class CylinderOptions:
    """Shape of the signals.

    Attributes
    ----------
    seconds : duration of the whole motion
    staircase : share of it given to the staircase, 0 to 0.8
    levels : speeds of the staircase, from 3 % of the top speed up in equal ratios; fewer where there are less than 3.75
        s for each
    max_frequency : highest frequency of the band-limited part, Hz
    harmonics : its number of harmonics
    use : share of every limit that may be used
    starts : how many times the band-limited part is optimised
    """

    seconds: float = 60.0
    staircase: float = 0.4
    levels: int = 6
    max_frequency: float = 0.8
    harmonics: int = 12
    use: float = 0.92
    starts: int = 3

    def __post_init__(self) -> None:
        if not 0 < self.use <= 1 or not 0 <= self.staircase <= 0.8 or self.levels < 1 or self.starts < 1:
            raise InputError("fitting.use_must_staircase_levels")
        if self.band_seconds * self.max_frequency < 2:
            raise InputError(
                "fitting.seconds_too_short_band",
                seconds=self.seconds,
                max_frequency=self.max_frequency,
                least=2 / self.max_frequency / (1 - self.staircase),
            )

    @property
    def band_seconds(self) -> float:
        """Duration of the band-limited part."""
        return self.seconds * (1 - self.staircase)


@dataclass(frozen=True)
class CylinderExcitation:
    """A motion of free cylinders.

    Attributes
    ----------
    motion : the motion program, ``rods=unpinned``
    speed, acceleration : per joint, shape (N,), m/s and m/s^2
    condition_numbers : per joint, of the column-scaled stage-1 regressor of the whole motion
    limits : how much of stroke, speed and acceleration is used
    """

    motion: Motion
    speed: dict[str, FloatArray]
    acceleration: dict[str, FloatArray]
    condition_numbers: dict[str, float]
    limits: tuple[LimitUse, ...]


def stage_one_columns(x: FloatArray, xd: FloatArray, xdd: FloatArray) -> FloatArray:
    """Compute stage 1's regressor, (N, 5): ``[x'', x, sgn x', x', |x'|^(1/3) sgn x']``."""
    return np.column_stack([xdd, x, np.sign(xd), xd, np.cbrt(xd)])


def piston_limits(joint: Joint) -> tuple[tuple[float, float], float, float]:
    """Compute the interval (m), top speed (m/s) and acceleration (m/s^2) of a free piston.

    The interval is that which the joint's limits span, inside the stroke: the part that is used later on.
    """
    cylinder, q = cylinder_of(joint), np.linspace(*joint.limits.position, 101)
    r = float(np.abs(lever_arm(cylinder.linkage, q)).max())
    x = np.clip(cylinder.linkage.piston_position(q), 0.0, cylinder.stroke)
    return (float(x.min()), float(x.max())), r * joint.limits.velocity, r * joint.limits.acceleration


def design_cylinder_motion(
    machine: Machine,
    *,
    seed: int = 0,
    options: CylinderOptions | None = None,
    joints: Sequence[str] | None = None,
    flow: float | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> CylinderExcitation:
    """Design the stage-1 motion of all cylinders (or of those of ``joints``).

    Parameters
    ----------
    machine : the arm
    seed : random seed of the starts
    options : shape of the signals
    joints : names of the joints whose cylinders move; all that have one if None
    flow : supply flow for all of them together, m^3/s: they move as much slower as it takes
    progress : called with the share done and the worst condition number so far

    Raises
    ------
    InputError
        If a named joint does not exist or has no cylinder, or no joint has one.
    """
    options = options or CylinderOptions()
    chosen = _chosen(machine, joints)
    slower = 1.0
    for _ in range(_FLOW_TRIALS):
        found = _all_cylinders(machine, chosen, options, seed, slower, progress)
        if flow is None:
            return found
        together = np.sum([_flow(joint, found.speed[joint.name]) for joint in chosen], axis=0)
        used = size_use(None, "flow", together, flow, "m^3/s")
        if used.used <= options.use:
            return replace(found, limits=(*found.limits, used))
        slower *= 0.98 * options.use / used.used
    raise InputError("fitting.supply_too_little_these", flow=flow)


def _flow(joint: Joint, speed: FloatArray) -> FloatArray:
    """Compute the flow (N,) into a free cylinder, m^3/s."""
    cylinder = cylinder_of(joint)
    return np.where(speed > 0, cylinder.head_area, -cylinder.rod_area) * speed


def _all_cylinders(
    machine: Machine,
    chosen: Sequence[Joint],
    options: CylinderOptions,
    seed: int,
    slower: float,
    progress: Callable[[float, float], None] | None,
) -> CylinderExcitation:
    """Make one course per cylinder, at ``slower`` times the top speed."""
    rng = np.random.default_rng(seed)
    count = round(options.seconds * machine.rate_hz)
    time = np.arange(count + 1) / machine.rate_hz
    columns: dict[str, FloatArray] = {}
    speed: dict[str, FloatArray] = {}
    acceleration: dict[str, FloatArray] = {}
    conditions: dict[str, float] = {}
    limits: list[LimitUse] = []
    for done, joint in enumerate(chosen):
        (low, high), fastest, hardest = piston_limits(joint)
        middle, half = (low + high) / 2, options.use * (high - low) / 2
        top_speed, top_acceleration = slower * options.use * fastest, options.use * hardest
        x, xd, xdd = np.zeros((3, time.size))
        band = time <= options.band_seconds
        band_limits = (half, top_speed, top_acceleration)
        x[band], xd[band], xdd[band] = _band_limited(options, time[band], middle, band_limits, rng)
        if options.staircase > 0:
            seconds = options.seconds - options.band_seconds
            levels = min(options.levels, max(1, int(options.seconds * options.staircase / (1.5 * LEVEL_SECONDS))))
            stairs = staircase(time[~band] - options.band_seconds, seconds, levels, *band_limits)
            x[~band], xd[~band], xdd[~band] = stairs
        x += middle
        columns[joint.name], speed[joint.name], acceleration[joint.name] = x, xd, xdd
        W = stage_one_columns(x, xd, xdd)
        conditions[joint.name] = condition_of_information(W.T @ W)
        limits += [
            interval_use(joint.name, "stroke", x, (low, high), "m"),
            size_use(joint.name, "velocity", xd, fastest, "m/s"),
            size_use(joint.name, "acceleration", xdd, hardest, "m/s^2"),
        ]
        if progress is not None:
            progress((done + 1) / len(chosen), max(conditions.values()))
    motion = Motion(machine.name, "unpinned", time, columns)
    return CylinderExcitation(motion, speed, acceleration, conditions, tuple(limits))


def _chosen(machine: Machine, names: Sequence[str] | None) -> list[Joint]:
    asked = [machine.joints[number] for number in joint_numbers(machine, names)]
    chosen = [joint for joint in asked if joint.cylinder is not None]
    if names is not None and len(chosen) < len(asked):
        bare = next(joint.name for joint in asked if joint.cylinder is None)
        raise InputError("fitting.joint_no_cylinder_nothing", bare=bare)
    if not chosen:
        raise InputError("fitting.no_joint_cylinder_nothing", machine=machine.name)
    return chosen


def _band_limited(
    options: CylinderOptions,
    time: FloatArray,
    middle: float,
    limits: tuple[float, float, float],
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find the best of several optimised series about mid-stroke: displacement from ``middle``, x', x''."""
    seconds = options.band_seconds
    highest = max(2, int(options.max_frequency * seconds))
    # Dense at low frequencies, where the long strokes are; always including the lowest and the highest.
    count = min(options.harmonics, highest)
    harmonics = tuple(int(k) for k in np.unique(np.round(np.geomspace(1, highest, count)).astype(int)))
    samples = 10 * highest
    search = fourier_basis(harmonics, seconds, (np.arange(samples) + 0.5) * seconds / samples)
    stack = np.vstack([search.position, search.speed, search.acceleration])
    scale = np.repeat(limits, samples)
    final = fourier_basis(harmonics, seconds, time)
    best: tuple[float, FloatArray] = (np.inf, np.zeros((3, time.size)))
    for _ in range(options.starts):
        start = rng.normal(size=search.size)
        coefficients = lbfgs(lambda c: _band_value(c, stack, scale, middle, limits[1]), start, 150)
        u = np.stack([basis @ coefficients for basis in (final.position, final.speed, final.acceleration)])
        u /= (np.abs(u).max(axis=1) / np.array(limits)).max() * 1.002  # the peaks between the samples
        W = stage_one_columns(middle + u[0], u[1], u[2])
        condition = condition_of_information(W.T @ W)
        if condition < best[0]:
            best = condition, u
    return best[1][0], best[1][1], best[1][2]


def _band_value(
    c: FloatArray, stack: FloatArray, scale: FloatArray, middle: float, top_speed: float
) -> tuple[float, FloatArray]:
    """Smooth criterion of one series (limits by a p-norm, sgn smoothed), and its gradient."""
    u = stack @ c
    share = np.abs(u) / scale
    peak = share.max()
    powers = (share / peak) ** (_NORM_POWER - 1)
    total = float(powers @ share) / peak
    norm = peak * total ** (1 / _NORM_POWER)
    norm_slope = (powers * np.sign(u) / scale) @ stack * total ** (1 / _NORM_POWER - 1)
    x, v, acceleration = (u / norm).reshape(3, -1)
    soft = _SOFT * top_speed
    sign = np.tanh(v / soft)
    sign_slope = (1 - sign**2) / soft
    # |v|^(1/3) sgn v, rounded off at rest: v (v^2 + soft^2)^(-1/3)
    base = v**2 + soft**2
    root, root_slope = v * base ** (-1 / 3), base ** (-1 / 3) - 2 / 3 * v**2 * base ** (-4 / 3)
    W = np.column_stack([acceleration, middle + x, sign, v, root])
    value, M = spectral_objective(W.T @ W / len(x), "condition", 4, 0.1)
    weight = 2 / len(x) * W @ M
    by_v = weight[:, 2] * sign_slope + weight[:, 3] + weight[:, 4] * root_slope
    g = np.concatenate([weight[:, 1], by_v, weight[:, 0]]) / norm
    return value, g @ stack - float(g @ u) / norm * norm_slope
