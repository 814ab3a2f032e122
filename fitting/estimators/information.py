"""What rows say of the parameters, condensed: as many equations of unit noise as the rows have rank."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from fitting.arrays import FloatArray
from fitting.estimators.base import Rows
from fitting.estimators.covariance import Colour, scores_covariance
from fitting.estimators.least_squares import Solution, solve


@dataclass(frozen=True)
class Information:
    """``rows theta = target + n``, ``n`` of unit covariance: all that ``A theta = b + e`` tells of ``theta``.

    Attributes
    ----------
    solution : least squares of the (weighted) rows
    covariance : (p, p) of its parameters
    rows, target : (rank, p), (rank,)
    """

    solution: Solution
    covariance: FloatArray
    rows: FloatArray
    target: FloatArray


def information(rows: Rows, colour: Colour) -> Information:
    """Condense weighted rows.

    ``Q'A theta = Q'b - Q'e`` with ``Q`` an orthonormal basis of the columns; a Cholesky factor of the covariance of
    ``Q'e`` makes the noise one. Where too few rows are left to estimate the noise, it counts as one.
    """
    root = np.sqrt(rows.weights)
    A, b = rows.A * root[:, None], rows.b * root
    solution = solve(A, b)
    residual = b - A @ solution.theta
    middle = scores_covariance(solution, residual, colour, rows.group, rows.weights > 0)
    S = np.eye(solution.rank) * middle if np.ndim(middle) == 0 else np.asarray(middle)
    # Exact rows have a noise of rounding only; below this they are as good as exact.
    least = (1e-9 * float(np.linalg.norm(b)) / np.sqrt(max(len(b), 1))) ** 2
    S = S + least * np.eye(solution.rank) if np.isfinite(S).all() else np.eye(solution.rank)
    reduced, target = solution.Q.T @ A, solution.Q.T @ b
    if solution.rank and S.any():
        L = linalg.cholesky(S, lower=True)
        reduced = linalg.solve_triangular(L, reduced, lower=True)
        target = linalg.solve_triangular(L, target, lower=True)
    return Information(solution, solution.covariance(middle), reduced, target)
