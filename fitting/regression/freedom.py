"""Student's t for parameters: a noise spectrum that was estimated from a minute is not known exactly.

The error of a parameter is a weighted sum of whitened noise, ``c' e`` with ``c = A (A'A)^-1 e_j``. Where the estimated
spectrum is wrong by a factor ``exp(d(f))``, its variance is wrong by the average of that factor over the power of
``c`` at each frequency. With the covariance of ``d`` that the spectrum's estimate gives, the variance of a parameter
has a relative variance ``rho``, and its error follows Student's t with ``2 / rho`` degrees of freedom (Satterthwaite).
Slow parameters (a stiffness on a slow motion) live on a few lines of the spectrum and get wider intervals. Where
intervals are a jackknife's over blocks, few blocks that determine nearly all are few degrees of freedom as well.

Sources: H. Kuensch, Ann. Stat. 17, 1989 (jackknife over blocks); F. Satterthwaite, "An approximate distribution of
estimates of variance components", Biometrics Bulletin 2, 1946; JCGM 100:2008 (GUM), annex G.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from fitting.arrays import FloatArray, IntArray
from fitting.regression.design import Design, NoiseModel
from fitting.regression.solving import WhiteRows

_MOST_FREEDOM = 1e6
_LEAST_FREEDOM = 3.0
#: Two-sided level at which a multiple of the standard deviation is to be an interval, and that multiple.
LEVEL, SIGMAS = 0.95, 1.959964


def degrees_of_freedom(
    rows: Sequence[WhiteRows], covariance: FloatArray, noise: NoiseModel, design: Design
) -> FloatArray:
    """Compute degrees of freedom of parameters' variances, (p,), at most a million.

    Parameters
    ----------
    rows : whitened rows of every joint, with (R, p) columns
    covariance : (p, p) of the parameters
    noise : the noise that they were whitened by
    design : whose rows they are
    """
    p = len(covariance)
    relative = np.zeros(p)
    variance = np.diag(covariance)
    determined = variance > 0
    for joint, own in enumerate(rows):
        weights = own.A @ covariance
        for loaded in (True, False):
            left_open = noise.of(joint, loaded).open
            start, powers, frequencies = 0, [np.zeros((p, 0))], [np.zeros(0)]
            for index, kept in own.sections:
                count = int(np.count_nonzero(kept))
                if count and design.segments[index].loaded == loaded:
                    stretch = np.zeros((len(kept), p))
                    stretch[kept] = weights[start : start + count]
                    power = np.abs(np.fft.rfft(stretch, axis=0)) ** 2 / len(kept)
                    power[1 : (len(kept) + 1) // 2] *= 2.0
                    powers.append(np.asarray(power.T, dtype=np.float64))
                    frequencies.append(np.asarray(np.fft.rfftfreq(len(kept), 1.0 / design.bank.reduced_rate_hz)))
                start += count
            if left_open is not None:
                own_variance = left_open.variance(np.concatenate(frequencies), np.hstack(powers))
                relative += np.where(determined, own_variance / np.where(determined, variance, 1.0) ** 2, 0.0)
    return np.clip(2.0 / np.maximum(relative, 2.0 / _MOST_FREEDOM), _LEAST_FREEDOM, _MOST_FREEDOM)


def coverage_factors(freedom: FloatArray) -> FloatArray:
    """Compute factors that make :data:`SIGMAS` standard deviations an interval of :data:`LEVEL`, (p,), at least 1."""
    return np.asarray(scipy.stats.t.ppf(0.5 + LEVEL / 2, freedom) / SIGMAS)


def moved_without(J: FloatArray, r: FloatArray, blocks: Sequence[IntArray], noise: float) -> FloatArray:
    """Compute moves of parameters (blocks, p) when a block of rows is left out.

    ``J`` (M, p) is in units that each is known to before any data, ``noise`` the variance of a row. Exact where the
    model is linear and ``r`` (M,) the residual of its least squares.
    """
    gram = J.T @ J + noise * np.eye(J.shape[1])
    return np.array([np.linalg.solve(gram - J[b].T @ J[b], -J[b].T @ r[b]) for b in blocks])


def freedom_of(moves: FloatArray) -> FloatArray:
    """Compute degrees of freedom (k,) of sums of squared moves (blocks, k): all blocks if alike, 3 if one dominates."""
    squares = moves**2
    return np.asarray(3.0 * np.maximum(squares.sum(axis=0) ** 2 / np.maximum((squares**2).sum(axis=0), 1e-300), 1.0))
