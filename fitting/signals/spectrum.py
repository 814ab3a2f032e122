"""Spectrum of a measurement noise inside the identification band, and the filter that whitens it.

After the identification filter and decimation, most of what an autoregression would fit is the filter's own roll-off.
So the noise's spectrum is estimated *before* the filter, by a smooth curve of few coefficients fitted to the
periodogram (Whittle's likelihood, log-spectrum as a cosine series in warped frequency, fine at low frequencies where a
first-order disturbance bends); the filter's known response is put on afterwards, and the whitening filter follows from
the autocovariance by the Yule-Walker equations.

A minute of noise has few lines where slow motions lie, and the ends of a cosine series take every liberty there. So its
coefficients have a smoothness prior, ``c_k ~ N(0, (tau / k^2)^2)``, whose ``tau`` is estimated along (empirical Bayes).
What the data leaves open of the log-spectrum is kept: it makes intervals of parameters wider (Student's t instead of
the normal, :mod:`fitting.regression.freedom`).

Source: P. Whittle, "Estimation and information in stationary time series", 1953; P. Bloomfield, "An exponential model
for the spectrum of a scalar time series", Biometrika 60, 1973.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy import linalg

from fitting.arrays import BoolArray, FloatArray
from fitting.signals.filters import FilterBank

_COEFFICIENTS = 6
_ORDER = 10
_EDGE = 1.4  # of the bandwidth: beyond it the identification filter leaves nothing
_KNEE = 0.1  # of the bandwidth: frequencies below are separated linearly, above in ratios
# Neighbouring lines under a Hann window are correlated (4/9 and 1/36): so many state as much as one independent line.
_LINES_A_WORD = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)
# Smoothness of a log-spectrum that is expected before any data, and coefficients' worth of that expectation.
_TAU, _TAU_WEIGHT = 1.0, 4.0
# Frequencies that the filter attenuates by 30 dB and more are not blown up again.
_FLOOR = 1e-3


@dataclass(frozen=True)
class OpenSpectrum:
    """The part of a log-spectrum that the data leaves open.

    Attributes
    ----------
    covariance : (c, c) of the coefficients of :func:`_log_basis`
    bandwidth_hz : what frequency is warped by
    """

    covariance: FloatArray
    bandwidth_hz: float

    def variance(self, frequency: FloatArray, power: FloatArray) -> FloatArray:
        """Compute the variance of ``power @ S_error / S``: power (k, F) over Hz (F,); (k,)."""
        weights = power @ _log_basis(frequency, self.bandwidth_hz)
        return np.asarray(np.einsum("ki,ij,kj->k", weights, self.covariance, weights))


@dataclass(frozen=True)
class Whitening:
    """Whitening of a reduced noise.

    Attributes
    ----------
    taps : ``[1, -phi_1, ..., -phi_p]``
    head : (p, p), whitens the first ``p`` rows of a stretch, which have no full past (inverse Cholesky factor of their
        covariance), in units of the innovation
    innovation : standard deviation of the whitened noise per unit of bandwidth: dividing by it makes the spectrum 1
        inside the band
    std : standard deviation of the reduced noise
    open : what the data leaves open of the noise's spectrum; None where that was not estimated
    """

    taps: FloatArray
    head: FloatArray
    innovation: float
    std: float
    open: OpenSpectrum | None = None

    def __call__(self, rows: FloatArray) -> FloatArray:
        """Whiten and scale rows of one stretch, (M,) or (M, k); as many as went in."""
        order = min(len(self.head), len(rows))
        out = np.asarray(self.taps[0] * rows)
        for lag, tap in enumerate(self.taps[1:], start=1):
            out[lag:] += tap * rows[:-lag]
        out[:order] = self.head[:order, :order] @ rows[:order]
        out /= self.innovation
        return out

    def kept(self, keep: BoolArray) -> BoolArray:
        """Find whitened rows that use kept rows only."""
        padded = np.concatenate([np.ones(len(self.taps) - 1, dtype=bool), keep])
        return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, len(self.taps)).all(axis=1))


def unit_whitening(std: float = 1.0) -> Whitening:
    """Return the whitening of white noise of a given standard deviation: nothing is filtered."""
    return Whitening(np.array([1.0]), np.zeros((0, 0)), max(std, 1e-12), max(std, 1e-12))


def whitening(series: Sequence[FloatArray], bank: FilterBank) -> Whitening:
    """Fit a whitening filter of reduced noise to stretches of full-rate noise, before any filter.

    Without any variance in the noise, or with less data than coefficients, nothing is whitened.
    """
    edge = min(_EDGE * bank.bandwidth_hz, 0.5 * bank.rate_hz)
    frequencies, powers = [], []
    for part in series:
        if len(part) < 4 * bank.rate_hz / bank.bandwidth_hz:
            continue
        frequency, power = scipy.signal.periodogram(
            part, bank.rate_hz, window="hann", detrend="constant", return_onesided=False, scaling="density"
        )
        # The two lowest lines hold what the window made of the mean.
        inside = (frequency > 1.5 * bank.rate_hz / len(part)) & (frequency <= edge)
        frequencies.append(frequency[inside])
        powers.append(power[inside])
    total = np.concatenate(powers) if powers else np.zeros(0)
    spread = float(np.std(np.concatenate([bank.reduce(p) for p in series]))) if len(series) else 0.0
    if len(total) < 3 * _COEFFICIENTS or not total.sum() > 0:
        return unit_whitening(spread)
    coefficients, covariance_of_log = _smooth(_log_basis(np.concatenate(frequencies), bank.bandwidth_hz), total)
    grid = np.linspace(0.0, edge, 2000)
    density = np.exp(_log_basis(grid, bank.bandwidth_hz) @ coefficients)
    _, response = scipy.signal.freqz(bank.identification, worN=grid, fs=bank.rate_hz)
    filtered = density * np.abs(response) ** 2
    lags = np.arange(_ORDER + 1) / bank.reduced_rate_hz
    covariance = 2.0 * np.trapezoid(filtered[None, :] * np.cos(2 * np.pi * lags[:, None] * grid[None, :]), grid, axis=1)
    band = grid <= bank.bandwidth_hz
    floored = covariance.copy()
    floored[0] += _FLOOR * float(np.median(filtered[band])) * bank.reduced_rate_hz
    phi = linalg.solve_toeplitz(floored[:_ORDER], floored[1:])
    innovation = float(np.sqrt(max(floored[0] - phi @ floored[1:], 1e-300)))
    factor = linalg.cholesky(linalg.toeplitz(floored[:_ORDER]), lower=True)
    head = innovation * linalg.solve_triangular(factor, np.eye(_ORDER), lower=True)
    taps = np.concatenate([[1.0], -phi])
    left_open = OpenSpectrum(covariance_of_log, bank.bandwidth_hz)
    return Whitening(taps, head, innovation, float(np.sqrt(covariance[0])), left_open)


def _log_basis(frequency: FloatArray, bandwidth_hz: float) -> FloatArray:
    """Compute cosines in warped frequency, (N, coefficients): a log-spectrum's basis."""
    knee = _KNEE * bandwidth_hz
    warped = np.log1p(frequency / knee) / np.log1p(_EDGE * bandwidth_hz / knee)
    return np.asarray(np.cos(np.pi * warped[:, None] * np.arange(_COEFFICIENTS)[None, :]))


def _smooth(basis: FloatArray, power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Estimate a log-spectrum's coefficients and covariance, with their smoothness (by EM)."""
    roughness = np.arange(_COEFFICIENTS, dtype=float) ** 4
    coefficients = np.zeros(_COEFFICIENTS)
    coefficients[0] = np.log(power.mean())
    information = basis.T @ basis / _LINES_A_WORD + 1e-9 * np.eye(_COEFFICIENTS)
    tau_squared, before = _TAU**2, 0.0
    while True:
        penalty = roughness / tau_squared
        coefficients = _whittle(basis, power, penalty * _LINES_A_WORD, coefficients)
        covariance = linalg.inv(information + np.diag(penalty))
        if abs(tau_squared - before) < 0.02 * tau_squared:
            return coefficients, covariance
        before = tau_squared
        own = float(roughness @ (coefficients**2 + np.diag(covariance)))
        tau_squared = (own + _TAU_WEIGHT * _TAU**2) / (_COEFFICIENTS - 1 + _TAU_WEIGHT)


def _whittle(basis: FloatArray, power: FloatArray, penalty: FloatArray, start: FloatArray) -> FloatArray:
    """Maximise Whittle's likelihood for ``log S = basis @ c`` less ``penalty @ c^2 / 2``, by Fisher scoring.

    The problem is convex.
    """
    coefficients = start
    information = basis.T @ basis + 1e-9 * np.eye(basis.shape[1]) + np.diag(penalty)

    def cost(c: FloatArray) -> float:
        logarithm = basis @ c
        return float(np.sum(logarithm + power * np.exp(-logarithm)) + 0.5 * penalty @ c**2)

    best = cost(coefficients)
    for _ in range(60):
        slope = basis.T @ (power * np.exp(-(basis @ coefficients)) - 1.0) - penalty * coefficients
        step = linalg.solve(information, slope, assume_a="pos")
        size = 1.0
        while size > 1e-4 and cost(coefficients + size * step) > best:
            size /= 2
        coefficients = coefficients + size * step
        now = cost(coefficients)
        if best - now < 1e-9 * abs(best):
            break
        best = now
    return coefficients
