"""The search for an excitation: free coefficients in, value and gradient of the criterion out.

The limits hold by construction: a joint's series ``u`` is divided by a p-norm of all its samples over their limits,

    q = home + u / |u|_p,   |u|_p = (sum (|q - home| / range)^p + (|q'| / v_max)^p + (|q''| / a_max)^p)^(1/p)  >=  max

so that the coefficients are free and the motion always uses its limits. Supply flow and chamber pressure couple the
joints; they are penalties here, with an amplitude per joint to trade.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from daq.errors import InputError
from daq.machine_file import Machine
from fitting.base_parameters import BaseParameters, base_regressor
from fitting.excitation.fourier import FourierBasis, fourier_basis, spread_harmonics
from fitting.excitation.limits import HydraulicLimits, chamber_pressure, supply_flow
from fitting.excitation.objective import (
    Criterion,
    condition_of_information,
    information,
    regressor_gradient,
    spectral_objective,
)
from fitting.geometry import geometry_of
from fitting.linkage import stroke_limits

FloatArray = npt.NDArray[np.float64]

_NORM_POWER = 24  # of the p-norm: at most 10 % above the maximum for a handful of samples near it
_PENALTY = 100.0  # per squared relative excess of flow or pressure


@dataclass(frozen=True)
class ExcitationOptions:
    """How to search.

    Attributes
    ----------
    seconds
        Duration of a motion.
    max_frequency
        Highest frequency of the series in Hz. Hydraulic arms and 50 Hz acquisition want less than 1 Hz.
    harmonics
        Harmonics per joint.
    starts
        How many times to optimise, each from the best of twelve random series.
    iterations
        Iterations of the optimiser per start.
    samples
        States of the motion that the criterion is evaluated at while searching.
    use
        Share of every limit that the motion may use, below 1 to leave the controller room for overshoot.
    criterion
        ``condition`` (of the column-scaled observation matrix) or ``determinant`` (D-optimality).
    signal_share
        How much the size of the signals counts beside the condition number: 0 not at all (slow motions), 1
        about as much. 0.1 costs 2 % in condition number and gains 10 to 20 % in the parameters' standard
        deviations.
    """

    seconds: float = 30.0
    max_frequency: float = 0.6
    harmonics: int = 8
    starts: int = 2
    iterations: int = 60
    samples: int = 120
    use: float = 0.95
    criterion: Criterion = "condition"
    signal_share: float = 0.1

    def __post_init__(self) -> None:
        if not 0 < self.use <= 1:
            raise InputError(f"use: {self.use:g} of the limits; it must be above 0 and at most 1")
        if self.seconds * self.max_frequency < 2:
            raise InputError(
                f"seconds: {self.seconds:g} s hold fewer than two periods of {self.max_frequency:g} Hz; "
                f"take {2 / self.max_frequency:.3g} s or more"
            )
        if self.harmonics < 2 or self.starts < 1 or self.iterations < 1 or self.samples < 10:
            raise InputError("harmonics must be 2 or more, starts and iterations 1 or more, samples 10 or more")


@dataclass(frozen=True)
class Problem:
    """What stays the same while searching."""

    machine: Machine
    base: BaseParameters
    joints: npt.NDArray[np.intp]  # those that move
    home: FloatArray  # (n,)
    span: FloatArray  # (n, 2): way from home down and up, already times `use`
    top_speed: FloatArray
    top_acceleration: FloatArray
    harmonics: tuple[tuple[int, ...], ...]
    bases: tuple[FourierBasis, ...]  # sampled for the search
    columns: npt.NDArray[np.intp]  # base columns that can be told
    gathered: FloatArray  # per sample of the final motion
    hydraulic: HydraulicLimits
    options: ExcitationOptions

    @property
    def coupled(self) -> bool:
        return self.hydraulic.flow is not None or self.hydraulic.pressure is not None


def lbfgs(
    value_and_gradient: Callable[[FloatArray], tuple[float, FloatArray]],
    start: FloatArray,
    iterations: int,
    step: Callable[[], None] | None = None,
) -> FloatArray:
    """Minimise by L-BFGS; ``step`` is called after each iteration. Returns the best point found."""

    def callback(intermediate_result: object) -> None:
        if step is not None:
            step()

    found = minimize(
        value_and_gradient,
        start.reshape(-1),
        jac=True,
        method="L-BFGS-B",
        callback=callback,
        options={"maxiter": max(1, iterations), "maxcor": 20},
    )
    return np.asarray(found.x, dtype=float)


def pose_problem(
    machine: Machine,
    base: BaseParameters,
    options: ExcitationOptions,
    names: Sequence[str] | None,
    gathered: FloatArray | None,
    hydraulic: HydraulicLimits,
    rng: np.random.Generator,
) -> Problem:
    if not base.only_rigid_body:
        raise ValueError("excitation is designed for inertial base parameters (friction_by_stage_1=True)")
    known = [joint.name for joint in machine.joints]
    for name in names or ():
        if name not in known:
            raise InputError(f"joint '{name}': {machine.name} has {', '.join(known)}")
    moved = np.array([i for i, name in enumerate(known) if names is None or name in names], dtype=np.intp)
    allowed = np.array([stroke_limits(joint) for joint in machine.joints])
    home = allowed.mean(axis=1)
    half = (allowed[:, 1] - allowed[:, 0]) / 2
    if np.any(half <= 0):
        raise InputError(f"joints.{known[int(np.argmin(half))]}: limits and stroke leave no motion")
    seconds = options.seconds
    harmonics = tuple(
        spread_harmonics(options.harmonics, place, len(moved), seconds, options.max_frequency)
        for place in range(len(moved))
    )
    # Midpoints of equal parts: a periodic integrand is then averaged best, and the ends at rest are left out.
    time = (np.arange(options.samples) + 0.5) * seconds / options.samples
    count = round(seconds * machine.rate_hz) + 1
    nb = len(base)
    problem = Problem(
        machine=machine,
        base=base,
        joints=moved,
        home=home,
        span=options.use * np.column_stack([half, half]),
        top_speed=options.use * np.array([joint.limits.velocity for joint in machine.joints]),
        top_acceleration=options.use * np.array([joint.limits.acceleration for joint in machine.joints]),
        harmonics=harmonics,
        bases=tuple(fourier_basis(k, seconds, time) for k in harmonics),
        columns=np.arange(nb),
        gathered=np.zeros((nb, nb)) if gathered is None else np.asarray(gathered, dtype=float) / count,
        hydraulic=hydraulic,
        options=options,
    )
    return replace(problem, columns=_tellable(problem, rng))


def _tellable(problem: Problem, rng: np.random.Generator) -> npt.NDArray[np.intp]:
    """A largest set of base columns that motions of these joints, with what was gathered, tell apart."""
    q, qd, qdd, _ = _states(problem, _random_start(problem, rng))
    G = information(_regressor(problem, q, qd, qdd)) + problem.gathered
    kept: list[int] = []
    for k in range(len(problem.base)):
        if condition_of_information(G[np.ix_([*kept, k], [*kept, k])]) < 1e6:
            kept.append(k)
    if not kept:
        raise InputError("the chosen joints tell no parameter at all; choose others")
    return np.array(kept, dtype=np.intp)


def _regressor(problem: Problem, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    return base_regressor(problem.machine, problem.base, q, qd, qdd)


def _random_start(problem: Problem, rng: np.random.Generator) -> FloatArray:
    parts = [rng.normal(size=basis.size) for basis in problem.bases]
    amplitudes = np.full(len(problem.joints), 2.0) if problem.coupled else np.zeros(0)
    return np.concatenate([*parts, amplitudes])


def _states(
    problem: Problem, coefficients: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, Callable[..., FloatArray]]:
    """The motion at the samples, and the map from its gradient to that of the coefficients."""
    m, samples = len(problem.joints), problem.bases[0].time.size
    amplitude = np.ones(m)
    if problem.coupled:
        amplitude = 1 / (1 + np.exp(-coefficients[-m:]))
    q = np.tile(problem.home, (samples, 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    offset = 0
    for place, (i, basis) in enumerate(zip(problem.joints, problem.bases, strict=True)):
        c = coefficients[offset : offset + basis.size]
        offset += basis.size
        stack = np.vstack([basis.position, basis.speed, basis.acceleration])
        u = stack @ c
        scale = np.concatenate(
            [
                np.where(u[:samples] >= 0, problem.span[i, 1], problem.span[i, 0]),
                np.full(samples, problem.top_speed[i]),
                np.full(samples, problem.top_acceleration[i]),
            ]
        )
        share = u / scale
        peak = np.abs(share).max()
        powers = (np.abs(share) / peak) ** (_NORM_POWER - 1)
        norm = peak * ((powers * np.abs(share) / peak).sum()) ** (1 / _NORM_POWER)
        slope = (powers * np.sign(share) / scale) @ stack * (norm / peak) ** (1 - _NORM_POWER)
        motion = amplitude[place] * u / norm
        q[:, i] += motion[:samples]
        qd[:, i], qdd[:, i] = motion[samples : 2 * samples], motion[2 * samples :]
        parts.append((stack * (amplitude[place] / norm), motion, slope / norm))

    def pull_back(by_q: FloatArray, by_qd: FloatArray, by_qdd: FloatArray) -> FloatArray:
        """Gradient of the coefficients from gradients (samples, m) of the motion."""
        pieces, by_amplitude = [], np.zeros(m)
        for place, (stack, motion, slope) in enumerate(parts):
            g = np.concatenate([by_q[:, place], by_qd[:, place], by_qdd[:, place]])
            along = float(g @ motion)
            pieces.append(g @ stack - along * slope)
            by_amplitude[place] = along * (1 - amplitude[place])
        return np.concatenate([*pieces, by_amplitude] if problem.coupled else pieces)

    return q, qd, qdd, pull_back


def search(problem: Problem, rng: np.random.Generator, report: Callable[[float], None]) -> FloatArray:
    options = problem.options
    candidates = [_random_start(problem, rng) for _ in range(12)]
    values = [_value_and_gradient(problem, c, 2, want_gradient=False)[0] for c in candidates]
    coefficients = candidates[int(np.argmin(values))]
    stages = ((2, options.iterations // 3), (8, options.iterations - options.iterations // 3))
    done = 0
    for power, iterations in stages:

        def step() -> None:
            nonlocal done
            done += 1
            report(done / options.iterations)

        coefficients = lbfgs(partial(_value_and_gradient, problem, power=power), coefficients, iterations, step)
    return coefficients


def _value_and_gradient(
    problem: Problem, coefficients: FloatArray, power: int, want_gradient: bool = True
) -> tuple[float, FloatArray]:
    q, qd, qdd, pull_back = _states(problem, coefficients)
    Y = _regressor(problem, q, qd, qdd)
    samples = q.shape[0]
    chosen = np.ix_(problem.columns, problem.columns)
    G = information(Y) + problem.gathered
    value, M = spectral_objective(G[chosen], problem.options.criterion, power, problem.options.signal_share)
    weight = np.zeros_like(Y)
    weight[:, :, problem.columns] = 2 / samples * (Y[:, :, problem.columns] @ M)
    by_q, by_qd = np.zeros(q.shape), np.zeros(q.shape)
    if problem.coupled:
        penalty, for_q, for_qd, for_tau = _hydraulic_penalty(problem, q, qd, Y)
        value += penalty
        by_q, by_qd = by_q + for_q, by_qd + for_qd
        if problem.hydraulic.base_parameters is not None:
            weight += for_tau[:, :, None] * problem.hydraulic.base_parameters
    if not want_gradient:
        return value, coefficients
    moved = problem.joints
    columns = problem.base.independent
    slopes = regressor_gradient(geometry_of(problem.machine), columns, q, qd, qdd, moved, Y, weight)
    return value, pull_back(slopes[0] + by_q[:, moved], slopes[1] + by_qd[:, moved], slopes[2])


def _hydraulic_penalty(
    problem: Problem, q: FloatArray, qd: FloatArray, Y: FloatArray
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Mean squared relative excess of flow and pressures, and its derivatives with respect to q, q', tau."""
    limits, samples = problem.hydraulic, q.shape[0]
    by_q, by_qd, by_tau = np.zeros(q.shape), np.zeros(q.shape), np.zeros(q.shape)
    value = 0.0
    if limits.flow is not None:
        most = problem.options.use * limits.flow
        flow, flow_q, flow_qd = supply_flow(problem.machine, q, qd)
        excess = np.maximum(flow / most - 1, 0.0)
        value += _PENALTY * float(np.mean(excess**2))
        slope = (2 * _PENALTY / samples / most * excess)[:, None]
        by_q, by_qd = by_q + slope * flow_q, by_qd + slope * flow_qd
    if limits.pressure is not None:
        assert limits.base_parameters is not None
        most = problem.options.use * limits.pressure
        tau = Y @ limits.base_parameters
        for i, joint in enumerate(problem.machine.joints):
            if joint.cylinder is None:
                continue
            friction = 0.0 if limits.friction is None else float(limits.friction[i])
            pressure, for_q, for_tau = chamber_pressure(
                joint.cylinder, q[:, i], tau[:, i], friction, limits.back_pressure
            )
            excess = np.maximum(pressure / most - 1, 0.0)
            value += _PENALTY * float(np.mean(excess**2))
            slope_i = 2 * _PENALTY / samples / most * excess
            by_q[:, i] += slope_i * for_q
            by_tau[:, i] += slope_i * for_tau
    return value, by_q, by_qd, by_tau
