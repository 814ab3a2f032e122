"""An excitation as an unconstrained problem: free coefficients in, a motion inside its kinematic limits out.

The limits hold by construction: a joint's series ``u`` is divided by a p-norm of all its samples over their limits,

    q = home + A u / |u|_p,   |u|_p = (sum (|q - home| / way)^p + (|q'| / v_max)^p + (|q''| / a_max)^p)^(1/p)  >=  max

so that the coefficients are free and the motion always uses its limits (``A = 1``). Supply flow and chamber pressure
couple the joints: then every joint also has an amplitude ``A`` between 0 and 1 to trade; and under a pressure limit a
home pose of its own, because what holds the arm at mid-range may already be too much.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import BaseParameters, base_regressor
from fitting.arm.linkage import stroke_limits
from fitting.arrays import FloatArray, IntArray
from fitting.excitation.fourier import FourierBasis, fourier_basis, spread_harmonics
from fitting.excitation.limits import HydraulicLimits, joint_numbers
from fitting.excitation.objective import Criterion, condition_of_information, information

_HOME_SHARE = 0.7  # of the way from mid-range to an end: a home at the very end would leave no motion
_START_AMPLITUDE = 2.0  # sigmoid(2) = 0.88


@dataclass(frozen=True)
class ExcitationOptions:
    """Options of the search.

    Attributes
    ----------
    seconds : duration of a motion
    max_frequency : highest frequency of the series in Hz. Hydraulic arms and 50 Hz acquisition want less than 1 Hz
    harmonics : harmonics per joint, at most all up to ``max_frequency``. Fewer are no faster, and end no better
    starts : how many optimisations are begun, each from the best of twelve random series; the best sixth is finished
    iterations : iterations of the optimiser for a start that goes all the way
    samples : states of the motion that the criterion is evaluated at while searching
    use : share of every limit that the motion may use, below 1 to leave the controller room for overshoot
    criterion : ``condition`` (of the column-scaled observation matrix) or ``determinant`` (D-optimality)
    signal_share : how much the size of the signals counts beside the condition number: 0 not at all (slow motions), 1
        about as much. 0.1 costs 2 % in condition number and gains 10 to 20 % in the parameters' standard deviations
    """

    seconds: float = 30.0
    max_frequency: float = 0.6
    harmonics: int = 18
    starts: int = 6
    iterations: int = 280
    samples: int = 120
    use: float = 0.95
    criterion: Criterion = "condition"
    signal_share: float = 0.1

    def __post_init__(self) -> None:
        if not 0 < self.use <= 1:
            raise InputError("fitting.use_limits", use=self.use)
        if self.seconds * self.max_frequency < 2:
            raise InputError(
                "fitting.seconds_hold_fewer_two",
                seconds=self.seconds,
                max_frequency=self.max_frequency,
                least=2 / self.max_frequency,
            )
        if self.harmonics < 2 or self.starts < 1 or self.iterations < 1 or self.samples < 10:
            raise InputError("fitting.harmonics_must_more_starts")


@dataclass(frozen=True)
class Problem:
    """Constants of one search."""

    machine: Machine
    base: BaseParameters
    joints: IntArray  # those that move
    middle: FloatArray  # (n,)
    half: FloatArray  # (n,) way from the middle to either end, already times `use`
    top_speed: FloatArray
    top_acceleration: FloatArray
    harmonics: tuple[tuple[int, ...], ...]
    bases: tuple[FourierBasis, ...]  # sampled for the search
    columns: IntArray  # base columns that can be determined
    gathered: FloatArray  # per sample of the final motion
    hydraulic: HydraulicLimits
    options: ExcitationOptions

    @property
    def coupled(self) -> bool:
        """True where the joints share a limit, so that amplitudes are to be traded."""
        return self.hydraulic.flow is not None or self.hydraulic.pressure is not None

    @property
    def seeks_home(self) -> bool:
        """True where the home pose is searched for as well."""
        return self.hydraulic.pressure is not None

    def split(self, coefficients: FloatArray) -> tuple[list[FloatArray], FloatArray, FloatArray]:
        """Split series coefficients by moving joint, amplitudes (m,) in 0 to 1, and home pose (n,) of all."""
        ends = np.cumsum([basis.size for basis in self.bases])
        series = np.split(coefficients[: ends[-1]], ends[:-1])
        m, n, rest = len(self.joints), len(self.middle), coefficients[ends[-1] :]
        amplitude = 1 / (1 + np.exp(-rest[:m])) if self.coupled else np.ones(m)
        home = self.middle.copy()
        if self.seeks_home:
            home += _HOME_SHARE * self.half * np.tanh(rest[m : m + n])
        return series, amplitude, home


def pose_problem(
    machine: Machine,
    base: BaseParameters,
    options: ExcitationOptions,
    names: Sequence[str] | None,
    gathered: FloatArray | None,
    hydraulic: HydraulicLimits,
    rng: np.random.Generator,
) -> Problem:
    """Pose the problem of a motion; arguments as in :func:`fitting.excitation.design.design_motion`."""
    if not base.only_rigid_body:
        raise ValueError("excitation is designed for inertial base parameters (friction_by_stage_1=True)")
    moved = np.array(joint_numbers(machine, names), dtype=np.intp)
    allowed = np.array([stroke_limits(joint) for joint in machine.joints])
    half = (allowed[:, 1] - allowed[:, 0]) / 2
    if np.any(half <= 0):
        raise InputError("fitting.joints_limits_stroke_leave", joint=machine.joints[int(np.argmin(half))].name)
    seconds = options.seconds
    harmonics = tuple(
        spread_harmonics(options.harmonics, place, len(moved), seconds, options.max_frequency)
        for place in range(len(moved))
    )
    count = round(seconds * machine.rate_hz) + 1
    nb = len(base)
    problem = Problem(
        machine=machine,
        base=base,
        joints=moved,
        middle=allowed.mean(axis=1),
        half=options.use * half,
        top_speed=options.use * np.array([joint.limits.velocity for joint in machine.joints]),
        top_acceleration=options.use * np.array([joint.limits.acceleration for joint in machine.joints]),
        harmonics=harmonics,
        bases=_bases(harmonics, seconds, options.samples),
        columns=np.arange(nb),
        gathered=np.zeros((nb, nb)) if gathered is None else np.asarray(gathered, dtype=float) / count,
        hydraulic=hydraulic,
        options=options,
    )
    return replace(problem, columns=_tellable(problem, rng))


def _bases(harmonics: tuple[tuple[int, ...], ...], seconds: float, samples: int) -> tuple[FourierBasis, ...]:
    # Midpoints of equal parts: a periodic integrand is then averaged best, and the ends at rest are left out.
    time = (np.arange(samples) + 0.5) * seconds / samples
    return tuple(fourier_basis(k, seconds, time) for k in harmonics)


def resampled(problem: Problem, samples: int) -> Problem:
    """Return the same problem at another number of states."""
    return replace(problem, bases=_bases(problem.harmonics, problem.options.seconds, samples))


def _tellable(problem: Problem, rng: np.random.Generator) -> IntArray:
    """Find a largest set of base columns separable by motions of these joints and what was gathered."""
    q, qd, qdd, _ = states(problem, random_start(problem, rng), 24)
    G = information(base_regressor(problem.machine, problem.base, q, qd, qdd)) + problem.gathered
    kept: list[int] = []
    for k in range(len(problem.base)):
        if condition_of_information(G[np.ix_([*kept, k], [*kept, k])]) < 1e6:
            kept.append(k)
    if not kept:
        raise InputError("fitting.chosen_joints_tell_no")
    return np.array(kept, dtype=np.intp)


def random_start(problem: Problem, rng: np.random.Generator) -> FloatArray:
    """Draw free coefficients of a random motion."""
    parts = [rng.normal(size=basis.size) for basis in problem.bases]
    if problem.coupled:
        parts.append(np.full(len(problem.joints), _START_AMPLITUDE))
    if problem.seeks_home:
        parts.append(0.5 * rng.normal(size=len(problem.middle)))
    return np.concatenate(parts)


def states(
    problem: Problem, coefficients: FloatArray, norm_power: int
) -> tuple[FloatArray, FloatArray, FloatArray, Callable[..., FloatArray]]:
    """Compute the motion at the search's samples, and the map of its gradient to the coefficients'.

    Parameters
    ----------
    problem, coefficients : the problem and a point
    norm_power : ``p`` of the norm that keeps the limits: the larger, the nearer the motion gets to them

    Returns
    -------
    tuple
        ``q``, ``q'``, ``q''`` (samples, n), and ``pull_back(by_q, by_qd, by_qdd)``, whose arguments are the gradients
        (samples, n) of a value and whose result is its gradient with respect to the coefficients.
    """
    series, amplitude, home = problem.split(coefficients)
    n, m, samples = len(problem.middle), len(problem.joints), problem.bases[0].time.size
    q = np.tile(home, (samples, 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    aside = home - problem.middle
    parts: list[tuple[FloatArray, FloatArray, FloatArray, float]] = []
    for place, (i, basis, c) in enumerate(zip(problem.joints, problem.bases, series, strict=True)):
        stack = np.vstack([basis.position, basis.speed, basis.acceleration])
        u = stack @ c
        upwards = u[:samples] >= 0
        scale = np.concatenate(
            [
                np.where(upwards, problem.half[i] - aside[i], problem.half[i] + aside[i]),
                np.full(samples, problem.top_speed[i]),
                np.full(samples, problem.top_acceleration[i]),
            ]
        )
        share = np.abs(u) / scale
        peak = share.max()
        norm = peak * float(((share / peak) ** norm_power).sum()) ** (1 / norm_power)
        by_share = (share / norm) ** (norm_power - 1)  # d norm / d share
        slope = (by_share * np.sign(u) / scale) @ stack
        by_home = float((by_share * share / scale)[:samples] @ np.where(upwards, 1.0, -1.0))
        motion = amplitude[place] * u / norm
        q[:, i] += motion[:samples]
        qd[:, i], qdd[:, i] = motion[samples : 2 * samples], motion[2 * samples :]
        parts.append((stack * (amplitude[place] / norm), motion, slope / norm, by_home / norm))

    def pull_back(by_q: FloatArray, by_qd: FloatArray, by_qdd: FloatArray) -> FloatArray:
        pieces, by_amplitude, by_home = [], np.zeros(m), by_q.sum(axis=0)
        for place, (i, (stack, motion, slope, home_slope)) in enumerate(zip(problem.joints, parts, strict=True)):
            g = np.concatenate([by_q[:, i], by_qd[:, i], by_qdd[:, i]])
            along = float(g @ motion)
            pieces.append(g @ stack - along * slope)
            by_amplitude[place] = along * (1 - amplitude[place])
            by_home[i] -= along * home_slope
        if problem.coupled:
            pieces.append(by_amplitude)
        if problem.seeks_home:
            squashed = aside / (_HOME_SHARE * problem.half)
            pieces.append(by_home * _HOME_SHARE * problem.half * (1 - squashed**2))
        return np.concatenate(pieces)

    assert q.shape == (samples, n)
    return q, qd, qdd, pull_back
