"""Recursive least squares in square-root information form.

The state is the triangular factor of all rows so far, ``[R z; 0 rho]`` with ``R'R = A'WA``, ``R theta = z`` and
``rho^2`` the weighted sum of squared residuals. New rows are stacked below it and rotated in by an orthogonal
transformation, which cannot lose symmetry or definiteness as the covariance form does, and which leaves the condition
number as it is instead of squaring it (Bierman, Factorization Methods for Discrete Sequential Estimation, IV.2).

Rows wait in a small buffer and are rotated in together: fewer rotations, less rounding. Reading never rotates the
state, so the result does not depend on when somebody looked.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from fitting.arrays import BoolArray, FloatArray
from fitting.estimators.least_squares import Solution, solve

# Reciprocal condition above which no column can be near the rank tolerance.
_FULL_RANK = 1e-9


class RecursiveLeastSquares:
    """Least squares over rows that arrive one by one, or in blocks.

    Minimises ``sum_k forgetting^(K - k) (b_k - A_k theta)^2`` over the ``K`` rows so far.

    Parameters
    ----------
    columns : number of parameters ``p``
    forgetting : 1 for none; below 1 a row's weight fades by this factor with each row that follows it: memory of
        ``1 / (1 - forgetting)`` rows

    Raises
    ------
    ValueError
        If ``columns`` is not positive or ``forgetting`` not in (0, 1].
    """

    def __init__(self, columns: int, *, forgetting: float = 1.0) -> None:
        if columns < 1:
            raise ValueError(f"{columns} columns: at least one parameter is needed")
        if not 0.0 < forgetting <= 1.0:
            raise ValueError(f"the forgetting factor is {forgetting}, it must be above 0 and at most 1")
        self._columns = columns
        self._forgetting = forgetting
        self._factor = np.zeros((columns + 1, columns + 1))
        # Factor of the rows at squared weights, for the covariance under forgetting.
        self._squared = np.zeros((columns, columns))
        self._weight = 0.0
        self._buffer = np.zeros((max(32, 2 * columns), columns + 1))
        self._waiting = 0

    def update(self, rows: npt.ArrayLike, target: npt.ArrayLike) -> None:
        """Take in one row (p,) with its target, or a block (k, p) with (k,), oldest first.

        Raises
        ------
        ValueError
            If shapes do not match or a number is not finite; nothing is taken in then.
        """
        block = np.atleast_2d(np.asarray(rows, dtype=float))
        values = np.atleast_1d(np.asarray(target, dtype=float))
        if block.ndim != 2 or block.shape[1] != self._columns or values.shape != block.shape[:1]:
            raise ValueError(
                f"rows {np.shape(rows)} and target {np.shape(target)} do not fit {self._columns} parameters"
            )
        if not (np.isfinite(block).all() and np.isfinite(values).all()):
            raise ValueError("a row or its target is not finite: leave gaps out")
        done = 0
        while done < len(block):
            size = min(len(block) - done, len(self._buffer) - self._waiting)
            place = slice(self._waiting, self._waiting + size)
            self._buffer[place, :-1] = block[done : done + size]
            self._buffer[place, -1] = values[done : done + size]
            self._waiting += size
            done += size
            if self._waiting == len(self._buffer):
                self._factor, self._squared, self._weight = self._current()
                self._waiting = 0

    def _current(self) -> tuple[FloatArray, FloatArray, float]:
        """Return factor, factor at squared weights and sum of weights, waiting rows rotated in."""
        count = self._waiting
        if not count:
            return self._factor, self._squared, self._weight
        rows = self._buffer[:count]
        if self._forgetting == 1.0:
            return _rotated(self._factor, rows), self._squared, self._weight + count
        # Weights lambda^(count-1), ..., lambda, 1; rows take their roots.
        weights = self._forgetting ** np.arange(count - 1, -1, -1.0)
        faded = self._forgetting**count
        factor = _rotated(np.sqrt(faded) * self._factor, np.sqrt(weights)[:, None] * rows)
        squared = _rotated(faded * self._squared, weights[:, None] * rows[:, :-1])
        return factor, squared, faded * self._weight + float(weights.sum())

    def _solved(self) -> Solution:
        factor, _, _ = self._current()
        return solve(factor[:-1, :-1], factor[:-1, -1])

    @property
    def theta(self) -> FloatArray:
        """Parameters now, (p,); those that the rows do not determine yet: see :attr:`determined`."""
        factor, _, _ = self._current()
        R, z = factor[:-1, :-1], factor[:-1, -1]
        norms = np.linalg.norm(R, axis=0)
        if norms.all():
            # Live, this is read with every row: one triangular solve where the rank is full beyond rounding.
            unit = R / norms
            certainty, _ = lapack.dtrcon(unit)
            if certainty > _FULL_RANK:
                return np.asarray(lapack.dtrtrs(unit, z)[0] / norms)
        return solve(R, z).theta

    @property
    def determined(self) -> BoolArray:
        """Mask of the parameters that the rows determine, (p,)."""
        return self._solved().determined

    @property
    def condition_number(self) -> float:
        """Of the weighted rows so far, columns at unit norm; infinite before the first row."""
        return self._solved().condition_number

    @property
    def residual_std(self) -> float:
        """Standard deviation of the residual, in the target's unit; not a number while no freedom is left.

        ``sqrt(rho^2 / (sum w - tr[(A'WA)^-1 A'W^2 A]))``: without bias for white noise, at any forgetting factor.
        """
        return self._spread()[1]

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the parameters for white noise, (p, p): ``sigma^2 (A'WA)^-1 A'W^2 A (A'WA)^-1``.

        Under forgetting this is about half of the often printed ``sigma^2 (A'WA)^-1``.
        """
        return self._spread()[0]

    def _spread(self) -> tuple[FloatArray, float]:
        factor, squared, weight = self._current()
        R = factor[:-1, :-1]
        solution = solve(R, factor[:-1, -1])
        squares = float(factor[-1, -1] ** 2)
        if self._forgetting == 1.0:
            middle: FloatArray = np.eye(solution.rank)
        else:
            # Q'R^-T A'W^2 A R^-1 Q in the solution's basis, from the factor at squared weights.
            half = squared @ solution.root
            middle = half.T @ half
        # Directions of R that were dropped carry no parameter; what z has there is residual.
        lost = factor[:-1, -1] - R @ solution.theta
        squares += float(lost @ lost)
        freedom = weight - float(np.trace(middle))
        sigma = float(np.sqrt(squares / freedom)) if freedom > 1e-9 * max(weight, 1.0) else float("nan")
        return solution.covariance(sigma**2 * middle), sigma


def _rotated(factor: FloatArray, rows: FloatArray) -> FloatArray:
    """Compute the triangular factor of ``factor`` (triangular, m by m) on ``rows`` (k, m)."""
    m = factor.shape[1]
    packed, _, _, info = lapack.dgeqrf(np.vstack([factor, rows]), overwrite_a=True)
    if info:
        raise ValueError(f"LAPACK refused argument {-info} of the factorisation")
    return np.asarray(np.triu(packed[:m]))
