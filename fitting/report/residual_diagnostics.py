"""What is left after the fit, joint by joint: does it depend on its own past, on the motion, on frequency?

Of the final model on the motions that are shown, at the rate of the reduced signals, as ``resid`` of MATLAB's System
Identification Toolbox does it. A model that lacks nothing leaves correlations within the bound of white noise: the
99 % interval ``2.58 / sqrt(N)`` (Ljung, System Identification, 1999, section 16.6). The identification filter itself
correlates neighbours where its bandwidth is below half the reduced rate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.regression.design import effort_residual
from fitting.report.model import JointDiagnostics
from fitting.residual.terms import Model

#: Longest lag, s, and most lags.
LONGEST_S, LAGS = 4.0, 60
_BOUND = 2.576  # 99 % of a normal distribution
_WINDOW = 256


def diagnostics(before: Model, after: Model, shown: Sequence[int]) -> tuple[JointDiagnostics, ...]:
    """Diagnose all joints; segments ``shown`` in a row, correlations never across two of them."""
    return tuple(_joint(before, after, shown, joint) for joint in range(len(after.design.machine.joints)))


def _joint(before: Model, after: Model, shown: Sequence[int], joint: int) -> JointDiagnostics:
    design = after.design
    bank = design.bank
    times, measured, first, second, speeds = [], [], [], [], []
    for index in shown:
        segment = design.segments[index]
        pick = slice(bank.half, len(segment) - bank.half, bank.decimation)
        times.append(segment.t[pick])
        measured.append(bank.reduce(segment.r[:, joint] * segment.effort[:, joint]))
        first.append(effort_residual(before.design, before.fit.theta, joint, index, before.extra))
        second.append(effort_residual(design, after.fit.theta, joint, index, after.extra))
        speeds.append(segment.v[pick, joint])
    rate = bank.reduced_rate_hz
    lags = max(2, min(LAGS, round(LONGEST_S * rate), min(len(part) for part in second) // 2))
    auto = correlation(second, second, lags)
    cross = np.concatenate([correlation(speeds, second, lags)[:0:-1], correlation(second, speeds, lags)])
    longest = max(range(len(second)), key=lambda number: len(second[number]))
    frequency, density = _density(second[longest], rate)
    own = design.machine.joints[joint]
    whole = np.concatenate(measured)
    return JointDiagnostics(
        joint=own.name,
        unit=own.effort_unit,
        fit_before=fit_percent(whole, np.concatenate(first)),
        fit_after=fit_percent(whole, np.concatenate(second)),
        time=np.concatenate(times),
        measured=whole,
        before=np.concatenate(first),
        after=np.concatenate(second),
        lag=np.arange(lags) / rate,
        auto=auto,
        cross_lag=np.arange(1 - lags, lags) / rate,
        cross=cross,
        bound=_BOUND / np.sqrt(max(1, sum(len(part) for part in second))),
        frequency=frequency,
        density_before=_density(first[longest], rate)[1],
        density_after=density,
    )


def fit_percent(measured: FloatArray, residual: FloatArray) -> float:
    """Compute 100 (1 - norm(residual) / norm(measured - mean)), %; NaN without motion."""
    size = float(np.linalg.norm(measured - measured.mean()))
    return 100.0 * (1.0 - float(np.linalg.norm(residual)) / size) if size > 0 else float("nan")


def correlation(late: Sequence[FloatArray], early: Sequence[FloatArray], lags: int) -> FloatArray:
    """Correlate ``late`` with ``early`` 0, 1, ... ``lags - 1`` samples before, (lags,), over all segments."""
    one = np.concatenate(late)
    other = np.concatenate(early)
    sizes = float(one.std() * other.std()) * len(one)
    if sizes == 0:
        return np.zeros(lags)
    total = np.zeros(lags)
    for a, b in zip(late, early, strict=True):
        x, y = a - one.mean(), b - other.mean()
        total += [float(x[lag:] @ y[: len(y) - lag]) for lag in range(lags)]
    return total / sizes


def _density(residual: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    frequency, density = scipy.signal.welch(residual, fs=rate, nperseg=min(_WINDOW, len(residual)))
    return frequency[1:], density[1:]
