"""The search for an excitation: value and gradient of the criterion, and its minimisation from several starts.

Supply flow and chamber pressure are penalties, whose weight grows from stage to stage until they hold to a fraction of
a per cent. Starts compete: all run the first, smooth stages, the better half of them the third, and the best quarter is
finished. (What the second stage reaches determines where the last one ends; what the first one reaches does not.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy

from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.excitation.limits import chamber_pressures, supply_flow
from fitting.excitation.objective import information, probed_regressor, spectral_objective
from fitting.excitation.problem import ExcitationOptions, Problem, random_start, resampled, states

_RESERVE = 0.99  # of flow and pressure: what a penalty lets through, and peaks between the samples
_RANDOM = 12  # series per start, of which the best one is optimised


@dataclass(frozen=True)
class Stage:
    """One stage of the search.

    Attributes
    ----------
    power : ``p`` of the smooth condition number
    norm_power : ``p`` of the norm that keeps the kinematic limits
    penalty : weight of a mean squared relative excess of flow or pressure
    samples : share of the samples that is used: a coarse look is enough to begin with
    share : of all iterations
    survivors : share of the starts that take part
    """

    power: int
    norm_power: int
    penalty: float
    samples: float
    share: float
    survivors: float


STAGES = (
    Stage(2, 24, 1e2, 0.4, 0.16, 1.0),
    Stage(8, 24, 1e3, 0.6, 0.20, 1.0),
    Stage(16, 48, 1e4, 1.0, 0.28, 0.34),
    Stage(32, 64, 3e4, 1.0, 0.36, 0.17),
)


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

    found = scipy.optimize.minimize(
        value_and_gradient,
        start.reshape(-1),
        jac=True,
        method="L-BFGS-B",
        callback=callback,
        options={"maxiter": max(1, iterations), "maxcor": 20},
    )
    return np.asarray(found.x, dtype=float)


def search(
    problem: Problem,
    rng: np.random.Generator,
    report: Callable[[float, float], None],
    condition: Callable[[FloatArray], float],
) -> FloatArray:
    """Search the best coefficients.

    Parameters
    ----------
    problem, rng : what to solve, and where starts come from
    report : gets the share done and the best condition number so far
    condition : condition number of the finished motion at a point: what the last of the starts are judged by
    """
    options = problem.options
    coarse = resampled(problem, _samples(options, STAGES[0]))
    points = [_best_random(coarse, rng) for _ in range(options.starts)]
    counts = [max(1, round(stage.survivors * options.starts)) for stage in STAGES]
    total = sum(stage.share * count for stage, count in zip(STAGES, counts, strict=True)) * options.iterations
    done, reached = 0.0, float("inf")

    def step() -> None:
        nonlocal done
        done += 1
        report(min(0.99, done / total), reached)

    for stage, count in zip(STAGES, counts, strict=True):
        sampled = resampled(problem, _samples(options, stage))
        criterion = partial(value_and_gradient, sampled, stage=stage)
        if stage is not STAGES[-1]:  # after the third stage they are in order of what they are good for
            points.sort(key=lambda point: criterion(point, want_gradient=False)[0])
        del points[count:]
        iterations = round(stage.share * options.iterations)
        for place, point in enumerate(points):
            points[place] = lbfgs(criterion, point, iterations, step)
        if stage in STAGES[-2:]:
            points.sort(key=condition)
        reached = min(reached, condition(points[0]))
    return points[0]


def _samples(options: ExcitationOptions, stage: Stage) -> int:
    return max(20, round(stage.samples * options.samples))


def _best_random(problem: Problem, rng: np.random.Generator) -> FloatArray:
    candidates = [random_start(problem, rng) for _ in range(_RANDOM)]
    values = [value_and_gradient(problem, c, STAGES[0], want_gradient=False)[0] for c in candidates]
    return candidates[int(np.argmin(values))]


def value_and_gradient(
    problem: Problem, coefficients: FloatArray, stage: Stage, want_gradient: bool = True
) -> tuple[float, FloatArray]:
    """Compute criterion with penalties, and its gradient (the coefficients themselves where unwanted)."""
    q, qd, qdd, pull_back = states(problem, coefficients, stage.norm_power)
    # Under a pressure limit the home of joints that hold still counts as well.
    moved = np.arange(q.shape[1]) if problem.seeks_home else problem.joints
    probes = moved if want_gradient else moved[:0]
    probed = probed_regressor(geometry_of(problem.machine), problem.base.independent, q, qd, qdd, probes)
    Y = probed.Y
    samples = q.shape[0]
    chosen = np.ix_(problem.columns, problem.columns)
    G = information(Y) + problem.gathered
    value, M = spectral_objective(G[chosen], problem.options.criterion, stage.power, problem.options.signal_share)
    weight = np.zeros_like(Y)
    weight[:, :, problem.columns] = 2 / samples * (Y[:, :, problem.columns] @ M)
    by_q, by_qd, by_qdd = np.zeros(q.shape), np.zeros(q.shape), np.zeros(q.shape)
    if problem.coupled:
        penalty, by_q, by_qd, by_tau = _hydraulic_penalty(problem, q, qd, Y, stage.penalty)
        value += penalty
        if problem.hydraulic.base_parameters is not None:
            weight += by_tau[:, :, None] * problem.hydraulic.base_parameters
    if not want_gradient:
        return value, coefficients
    for total, own in zip((by_q, by_qd, by_qdd), probed.gradient(weight), strict=True):
        total[:, moved] += own
    return value, pull_back(by_q, by_qd, by_qdd)


def _hydraulic_penalty(
    problem: Problem, q: FloatArray, qd: FloatArray, Y: FloatArray, weight: float
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Compute the mean squared relative excess of flow and pressures; derivatives by q, q', tau."""
    limits, samples = problem.hydraulic, q.shape[0]
    by_q, by_qd, by_tau = np.zeros(q.shape), np.zeros(q.shape), np.zeros(q.shape)
    value = 0.0
    if limits.flow is not None:
        most = _RESERVE * problem.options.use * limits.flow
        flow, flow_q, flow_qd = supply_flow(problem.machine, q, qd)
        excess = np.maximum(flow / most - 1, 0.0)
        value += weight * float(np.mean(excess**2))
        slope = (2 * weight / samples / most * excess)[:, None]
        by_q, by_qd = by_q + slope * flow_q, by_qd + slope * flow_qd
    if limits.pressure is not None:
        assert limits.base_parameters is not None
        most = _RESERVE * problem.options.use * limits.pressure
        tau = Y @ limits.base_parameters
        for i, pressure, for_q, for_tau in chamber_pressures(problem.machine, limits, q, tau):
            excess = np.maximum(pressure / most - 1, 0.0)
            value += weight * float(np.mean(excess**2))
            slope_i = 2 * weight / samples / most * excess
            by_q[:, i] += slope_i * for_q
            by_tau[:, i] += slope_i * for_tau
    return value, by_q, by_qd, by_tau
