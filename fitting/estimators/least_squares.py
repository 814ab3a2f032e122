"""Least squares by pivoted QR: the numerical core of the estimators.

With unit columns ``A D^-1 Pi = Q [R11 R12]`` (``D`` the column norms, ``Pi`` the pivoting), the kept columns have

    theta = D^-1 R11^-1 Q'b,      (A'A)^-1 = D^-1 R11^-1 R11^-T D^-1,      null space = [-R11^-1 R12; I].

Normal equations are never formed: they square the condition number (Golub and Van Loan, Matrix Computations, 5.3, 5.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.estimators.base import Rows

#: Pivots of unit columns below this share of the largest are no information, only rounding.
RANK_TOLERANCE = 1e-11
# A column whose part in every null-space direction is below this is not involved in it, only rounding.
_INVOLVED = 1e-6


@dataclass(frozen=True)
class Solution:
    """Least-squares solution of ``A theta = b``.

    Attributes
    ----------
    theta : (p,) basic solution: dropped columns zero
    root : (p, rank) with ``(A'A)^-1 = root root'`` on the kept columns, zero rows for the dropped
    Q : (R, rank) orthonormal basis of the column space; ``A^+ = root Q'``
    kept : (p,) columns of the basic solution
    determined : (p,) columns with no part in the null space
    condition_number : of the kept columns at unit norm
    """

    theta: FloatArray
    root: FloatArray
    Q: FloatArray
    kept: BoolArray
    determined: BoolArray
    condition_number: float

    @property
    def rank(self) -> int:
        """Number of kept columns."""
        return int(self.root.shape[1])

    @property
    def leverage(self) -> FloatArray:
        """Diagonal of the hat matrix, (R,): how far each row pulls its own prediction."""
        return np.asarray(np.einsum("ij,ij->i", self.Q, self.Q))

    def covariance(self, middle: FloatArray | float) -> FloatArray:
        """Compute ``root middle root'``, with infinite variance where a parameter is undetermined.

        ``middle`` is a variance, or the (rank, rank) covariance of ``Q'e``.
        """
        spread = self.root * middle if np.ndim(middle) == 0 else self.root @ middle
        out = spread @ self.root.T
        out[~self.determined, :] = 0.0
        out[:, ~self.determined] = 0.0
        out[~self.determined, ~self.determined] = np.inf
        return np.asarray(out)


def solve(A: FloatArray, b: FloatArray) -> Solution:
    """Solve rank-aware least squares of ``A`` (R, p) and ``b`` (R,)."""
    p = A.shape[1]
    # Two steps to the norm, so that neither 1e-200 nor 1e+200 under- or overflows when squared.
    largest = np.abs(A).max(axis=0, initial=0.0)
    alive = np.flatnonzero(largest > 0)
    unit = A[:, alive] / largest[alive]
    norms = np.linalg.norm(unit, axis=0)
    scale = largest[alive] * norms
    Q, R, order = linalg.qr(unit / norms, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    rank = int(np.count_nonzero(pivots > RANK_TOLERANCE * pivots[0])) if len(pivots) else 0
    columns: IntArray = alive[order]
    Q, R11 = Q[:, :rank], R[:rank, :rank]
    kept, determined = np.zeros(p, dtype=bool), np.zeros(p, dtype=bool)
    kept[columns[:rank]] = True
    determined[columns[:rank]] = True
    theta, root = np.zeros(p), np.zeros((p, rank))
    if not rank:
        return Solution(theta, root, Q, kept, determined, float("inf"))
    theta[columns[:rank]] = linalg.solve_triangular(R11, Q.T @ b) / scale[order[:rank]]
    root[columns[:rank]] = linalg.solve_triangular(R11, np.eye(rank)) / scale[order[:rank], None]
    if rank < len(columns):
        null = linalg.solve_triangular(R11, R[:rank, rank:])
        determined[columns[:rank]] = np.abs(null).max(axis=1) < _INVOLVED
    values = linalg.svdvals(R11)
    return Solution(theta, root, Q, kept, determined, float(values[0] / values[-1]))


def residual_std(rows: Rows, leverage: FloatArray, theta: FloatArray) -> FloatArray:
    """Compute the standard deviation that parameters leave of each group's rows that count, (g,), in the target's unit.

    ``sqrt(sum e^2 / (n_g - sum of leverages))``: the fit takes degrees of freedom from a group in the measure of its
    rows' leverages; where it takes them all (as many parameters as rows) nothing is left to estimate noise from, and
    the result is not a number.
    """
    counted, groups = rows.weights > 0, len(rows.labels)
    residual, group = (rows.b - rows.A @ theta)[counted], rows.group[counted]
    squares = np.bincount(group, residual**2, minlength=groups)
    freedom = np.bincount(group, minlength=groups) - np.bincount(group, leverage[counted], minlength=groups)
    return np.sqrt(np.where(freedom > 1e-6, squares / np.maximum(freedom, 1e-6), np.nan))
