"""Covariances of plain rows, and the plug-in rule for lags: what tests of coloured residuals ask for."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fitting.arrays import FloatArray
from fitting.estimators.base import check_rows
from fitting.estimators.covariance import Colour, scores_covariance
from fitting.estimators.least_squares import solve

#: Of an autocorrelation: what is nearer to one is a trend.
_STRONGEST = 0.97


def hac_covariance(
    A: npt.ArrayLike, residual: npt.ArrayLike, colour: Colour = "hac", groups: npt.ArrayLike | None = None
) -> FloatArray:
    """Covariance (p, p) of a least-squares fit whose residual is coloured.

    ``(A'A)^-1 S (A'A)^-1``; with a number of lags ``S = G_0 + sum_l (1 - l / (lags + 1)) (G_l + G_l')``,
    ``G_l = sum_t u_t u_(t-l)'``, ``u_t = A_t e_t``; all times ``R / (R - rank)`` for the parameters that were fitted.

    Parameters
    ----------
    A : (R, p) regressor, rows in time order within each group
    residual : (R,) ``b - A theta``
    colour : ``hac``, ``bootstrap``, ``white``, or how many samples the residual hangs together (0: White's covariance)
    groups : (R,) series of each row (joint, or joint and recording); products never cross from one to another

    Raises
    ------
    ValueError
        If shapes do not match, or ``colour`` is none of these.
    """
    rows = check_rows(A, residual, groups)
    solution = solve(rows.A, rows.b)
    return solution.covariance(scores_covariance(solution, rows.b, colour, rows.group))


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
    rho = min(abs(products / squares), _STRONGEST) if squares > 0 else 0.0
    alpha = 4.0 * rho**2 / (1.0 - rho**2) ** 2
    return int(np.floor(1.1447 * (alpha * len(e)) ** (1.0 / 3.0)))
