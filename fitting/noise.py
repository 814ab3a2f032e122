"""The noise floor: how much of a residual is measurement noise and disturbance.

With a `repeat` recording it is measured: the same motion twice, so the difference of the two *residuals* (not of the
raw signals, because the motion is never bit-identical) holds noise only, of twice the variance. Without one it
is estimated from what a very flexible model leaves, and said to be an estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import linalg

from fitting.regression import Design, Extra, NoiseModel, full_residual, solve, white_noise_model, whitened
from fitting.signals import lag_between
from fitting.splines import spline_basis

FloatArray = npt.NDArray[np.float64]

# Beyond four the autoregression models the roll-off of the identification filter instead of the noise.
_MAX_ORDER = 4
_MAX_LAG_SECONDS = 4.0


@dataclass(frozen=True)
class Pairing:
    """A stretch of a `repeat` segment and the stretch of a `train` segment with the same motion."""

    train: int
    repeat: int
    train_start: int
    repeat_start: int
    length: int


def pair_repeats(design: Design) -> tuple[Pairing, ...]:
    """For each `repeat` segment the training segment it repeats, aligned in time.

    A segment is paired only if, after alignment, its joint positions follow the training motion to within 2 % of
    their spread.
    """
    pairs = []
    for repeat in design.indices("repeat"):
        best: tuple[float, Pairing] | None = None
        for train in design.indices("train"):
            a, b = design.segments[train], design.segments[repeat]
            lag = lag_between(a.q, b.q, int(_MAX_LAG_SECONDS * design.bank.rate_hz))
            start_a, start_b = max(0, -lag), max(0, lag)
            length = min(len(a) - start_a, len(b) - start_b)
            spread = np.maximum(a.q.std(axis=0), 1e-9)
            apart = (a.q[start_a : start_a + length] - b.q[start_b : start_b + length]).std(axis=0) / spread
            cost = float(np.max(apart))
            if best is None or cost < best[0]:
                best = (cost, Pairing(train, repeat, start_a, start_b, length))
        if best is not None and best[0] < 0.02 and design.bank.rows(best[1].length) > 5 * _MAX_ORDER:
            pairs.append(best[1])
    return tuple(pairs)


def difference_noise(
    design: Design, theta: FloatArray, pairs: Sequence[Pairing], joint: int, extra: Extra | None = None
) -> list[FloatArray]:
    """Reduced noise of one joint, (M,) per pair: difference of the two residuals over the square root of two."""
    result = []
    for pair in pairs:
        first = full_residual(design, theta, joint, pair.train, extra)
        second = full_residual(design, theta, joint, pair.repeat, extra)
        difference = (
            first[pair.train_start : pair.train_start + pair.length]
            - second[pair.repeat_start : pair.repeat_start + pair.length]
        )
        result.append(design.bank.reduce(difference) / np.sqrt(2.0))
    return result


def effort_floor(design: Design, theta: FloatArray, pairs: Sequence[Pairing], extra: Extra | None = None) -> FloatArray:
    """Noise floor per joint in the joint's effort unit, (n,): std of (train less repeat) residual over root two."""
    floors = []
    for joint in range(len(design.machine.joints)):
        values = []
        for pair in pairs:
            a, b = design.segments[pair.train], design.segments[pair.repeat]
            left = slice(pair.train_start, pair.train_start + pair.length)
            right = slice(pair.repeat_start, pair.repeat_start + pair.length)
            first = (a.r[:, joint] * full_residual(design, theta, joint, pair.train, extra))[left]
            second = (b.r[:, joint] * full_residual(design, theta, joint, pair.repeat, extra))[right]
            values.append(design.bank.reduce(first - second))
        floors.append(float(np.std(np.concatenate(values)) / np.sqrt(2.0)))
    return np.array(floors)


def noise_model(
    design: Design,
    fitted: Sequence[int],
    pairs: Sequence[Pairing],
    extra: Extra | None = None,
    passes: int = 2,
) -> NoiseModel:
    """Autoregression of each joint's noise, alternating between fit and noise (feasible generalised least squares)."""
    joints = len(design.machine.joints)
    model = white_noise_model(joints)
    names = () if extra is None else extra.names
    for _ in range(passes):
        theta = solve(whitened(design, model, fitted, extra), names).theta
        filters, innovation, std = [], np.zeros(joints), np.zeros(joints)
        for joint in range(joints):
            if pairs:
                series = difference_noise(design, theta, pairs, joint, extra)
                freedom = 1.0
            else:
                series, freedom = _flexible_residual(design, theta, fitted, joint, extra)
            if not sum(len(s) for s in series):  # a joint that stood still all the time has no rows to weigh
                filters.append(np.array([1.0]))
                innovation[joint] = std[joint] = 1.0
                continue
            taps, innovation[joint] = autoregression(series)
            innovation[joint] = max(innovation[joint] * freedom, 1e-12)
            std[joint] = float(np.std(np.concatenate(series)) * freedom)
            filters.append(taps)
        model = NoiseModel(tuple(filters), innovation, std, bool(pairs))
    return model


def autoregression(series: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """Whitening filter ``[1, -phi_1, ..., -phi_p]`` and innovation std of one or more stretches of a noise.

    Yule-Walker equations on the pooled autocovariance; the order, at most 4, is the one with the smallest BIC.
    """
    total = sum(len(s) for s in series)
    covariance = np.zeros(_MAX_ORDER + 1)
    for s in series:
        centred = s - s.mean()
        for lag in range(min(_MAX_ORDER + 1, len(s))):
            covariance[lag] += centred[lag:] @ centred[: len(s) - lag]
    covariance /= max(total, 1)
    if covariance[0] <= 0:
        return np.array([1.0]), 1e-12
    covariance[0] *= 1 + 1e-6
    best = (np.inf, np.array([1.0]), float(np.sqrt(covariance[0])))
    for order in range(_MAX_ORDER + 1):
        phi = linalg.solve_toeplitz(covariance[:order], covariance[1 : order + 1]) if order else np.zeros(0)
        variance = float(covariance[0] - phi @ covariance[1 : order + 1])
        if variance <= 0:
            break
        criterion = total * np.log(variance) + order * np.log(total)
        if criterion < best[0]:
            best = (criterion, np.concatenate([[1.0], -phi]), np.sqrt(variance))
    return best[1], float(best[2])


def _flexible_residual(
    design: Design, theta: FloatArray, fitted: Sequence[int], joint: int, extra: Extra | None
) -> tuple[list[FloatArray], float]:
    """Residual of a joint after splines in its own position and speed, with and without the sign of speed."""
    segments = [design.segments[i] for i in fitted]
    rows, targets = [], []
    for variable in ("x", "v"):
        values = np.concatenate([getattr(s, variable)[:, joint] for s in segments])
        basis = spline_basis(values, 8)
        sign = np.sign(np.concatenate([s.v[:, joint] for s in segments]))
        rows.append(np.hstack([basis, basis * sign[:, None]]))
    columns = np.hstack(rows)
    ends = np.cumsum([len(s) for s in segments])
    reduced = []
    for index, part in zip(fitted, np.split(columns, ends[:-1]), strict=True):
        keep = design.blocks[joint][index].keep
        reduced.append(design.bank.reduce(part)[keep])
        targets.append(design.bank.reduce(full_residual(design, theta, joint, index, extra))[keep])
    A, b = np.vstack(reduced), np.concatenate(targets)
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    coefficients = np.linalg.lstsq(A / scale, b, rcond=1e-8)[0]
    left = b - (A / scale) @ coefficients
    freedom = float(np.sqrt(len(b) / max(len(b) - A.shape[1], 1)))
    parts = np.split(left, np.cumsum([len(t) for t in targets])[:-1])
    return [p for p in parts if len(p) > 2 * _MAX_ORDER] or [left], freedom
