"""Covariance of parameters when the residual is coloured.

A machine's residual is: filtered noise, and what the model lacks, both hang together over many samples (a crane's
has autocorrelation 0.93 at 50 ms). The textbook ``sigma^2 (A'A)^-1`` then promises several times too much.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fitting.estimators.base import FloatArray, IntArray, check_rows
from fitting.estimators.least_squares import Solution, solve


def hac_covariance(
    A: npt.ArrayLike, residual: npt.ArrayLike, lags: int, groups: npt.ArrayLike | None = None
) -> FloatArray:
    """Newey-West covariance of a least-squares fit, (p, p).

    ``(A'A)^-1 S (A'A)^-1`` with ``S = G_0 + sum_l (1 - l / (lags + 1)) (G_l + G_l')``,
    ``G_l = sum_t u_t u_(t-l)'``, ``u_t = A_t e_t``; times ``R / (R - rank)`` for the parameters that were fitted.

    Parameters
    ----------
    A : (R, p) regressor, rows in time order within each group
    residual : (R,) ``b - A theta``
    lags : how many samples the residual hangs together; 0 gives White's covariance
    groups : (R,) series of each row (joint, or joint and recording); products never cross from one to another

    Source
    ------
    Newey and West, Econometrica 55 (1987) 703.
    """
    rows = check_rows(A, residual, groups)
    solution = solve(rows.A, rows.b)
    return solution.covariance(scores_covariance(solution, rows.b, lags, rows.group))


def scores_covariance(solution: Solution, residual: FloatArray, lags: int, group: IntArray) -> FloatArray:
    """Newey-West covariance of ``Q'e``, (rank, rank): ``S`` above, in the orthonormal basis of the columns."""
    if lags < 0:
        raise ValueError(f"lags is {lags}, it cannot be negative")
    U = solution.Q * residual[:, None]
    S = np.zeros((solution.rank, solution.rank))
    for label in np.unique(group):
        own = U[group == label]
        S += own.T @ own
        for lag in range(1, min(lags, len(own) - 1) + 1):
            G = own[lag:].T @ own[:-lag]
            S += (1.0 - lag / (lags + 1.0)) * (G + G.T)
    free = len(residual) - solution.rank
    return S * (len(residual) / free) if free > 0 else np.full_like(S, np.nan)


def automatic_lags(residual: npt.ArrayLike, groups: npt.ArrayLike | None = None) -> int:
    """How many lags a residual asks for: the plug-in rule for the Bartlett kernel and a first-order autoregression.

    ``1.1447 (alpha R)^(1/3)``, ``alpha = 4 rho^2 / (1 - rho^2)^2``, ``rho`` the correlation of neighbours.

    Source
    ------
    Andrews, Econometrica 59 (1991) 817, equations 6.2 and 6.4.
    """
    e = np.asarray(residual, dtype=float)
    group = np.zeros(len(e), dtype=np.intp) if groups is None else np.asarray(groups)
    squares, products = 0.0, 0.0
    for label in np.unique(group):
        own = e[group == label] - e[group == label].mean()
        squares += float(own @ own)
        products += float(own[1:] @ own[:-1])
    rho = min(abs(products / squares), 0.97) if squares > 0 else 0.0
    alpha = 4.0 * rho**2 / (1.0 - rho**2) ** 2
    return int(np.floor(1.1447 * (alpha * len(e)) ** (1.0 / 3.0)))
