"""Instrumental variables: least squares that noise in the regressor does not bend.

Positions carry noise, and accelerations are made from positions: the columns ``A`` are not what acted on the arm.
Least squares takes ``A'e`` for zero, which it then is not, and parameters come out too small. Instruments ``Z`` are
columns made from a motion without that noise; ``Z'(b - A theta) = 0`` is free of the bias::

    theta = (Z'W A)^-1 Z'W b,      cov = (Z'W A)^-1 cov(Z'W e) (A'W Z)^-1.

Where the instruments come from: :mod:`fitting.regression.instruments`.

Source
------
Janot, Vandanjon and Gautier, "A generic instrumental variable approach for industrial robot identification", IEEE
Trans. Control Systems Technology 22 (2014) 132. There the instruments are simulated in closed loop.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from daq.errors import InputError
from fitting.estimators.base import Estimate, FloatArray, Rows, check_rows
from fitting.estimators.context import StageTwo
from fitting.estimators.covariance import Colour, scores_covariance
from fitting.estimators.least_squares import Solution, group_std, solve
from fitting.estimators.weighted import usable_spread, weighted_by_group


@dataclass(frozen=True)
class InstrumentalVariables:
    """Weighted instrumental variables, one weight per group in two steps.

    Attributes
    ----------
    instruments : (R, p) ``Z``; None for the regressor itself, which is weighted least squares
    colour : as in :class:`fitting.estimators.ordinary.OrdinaryLeastSquares`
    """

    instruments: FloatArray | None = None
    colour: Colour = "white"

    @property
    def name(self) -> str:
        """``iv``."""
        return "iv"

    def within(self, stage: StageTwo) -> InstrumentalVariables:
        """The same with the stage's instruments.

        Raises
        ------
        InputError
            If the stage has none.
        """
        if stage.instruments is None:
            raise InputError("estimator 'iv': this stage has no instruments; use 'wls'")
        return replace(self, instruments=stage.instruments(), colour=stage.colour)

    def fit(
        self,
        A: npt.ArrayLike,
        b: npt.ArrayLike,
        *,
        groups: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Fit rows; see :class:`fitting.estimators.base.Estimator`.

        Raises
        ------
        ValueError
            Also if the instruments are not as many rows and columns as ``A``.
        """
        rows = check_rows(A, b, groups, weights)
        Z = rows.A if self.instruments is None else self.instruments
        if Z.shape != rows.A.shape or not np.isfinite(Z).all():
            raise ValueError(f"instruments {Z.shape} must be finite and of the shape of the regressor, {rows.A.shape}")
        first, _ = _solved(rows, Z)
        # The spread that matters is that of the residual of this estimate, not of the bent one.
        leverage = weighted_leverage(rows)
        counted = rows.weights > 0
        plain = rows.b - rows.A @ first.theta
        spread = group_std(plain[counted], leverage[counted], rows.group[counted], len(rows.labels))
        rows = replace(rows, weights=rows.weights / usable_spread(spread, rows)[rows.group] ** 2)
        solution, weakest = _solved(rows, Z)
        plain = rows.b - rows.A @ solution.theta
        scaled = plain * np.sqrt(rows.weights)
        return Estimate(
            theta=solution.theta,
            covariance=solution.covariance(scores_covariance(solution, scaled, self.colour, rows.group, counted)),
            residual_std=group_std(plain[counted], solution.leverage[counted], rows.group[counted], len(rows.labels)),
            groups=rows.labels,
            condition_number=solution.condition_number,
            told=solution.told,
            details={"weakest_instrument": weakest},
        )


def weighted_leverage(rows: Rows) -> FloatArray:
    """Leverages of weighted least squares on these rows, (R,)."""
    weighted = weighted_by_group(rows)
    return solve(weighted.A * np.sqrt(weighted.weights)[:, None], weighted.b).leverage


def _solved(rows: Rows, Z: FloatArray) -> tuple[Solution, float]:
    """Solution of ``Q_z'A theta = Q_z'b``, and the cosine of the largest angle between both column spaces.

    As ``A^+ = root Q'`` for least squares, so here ``theta = root Q'b`` with ``Q`` an orthonormal basis of the
    instruments: all that is built on a :class:`Solution` holds for it.
    """
    w = np.sqrt(rows.weights)[:, None]
    own, other = solve(rows.A * w, rows.b * w[:, 0]), solve(Z * w, rows.b * w[:, 0])
    if not (own.rank and other.rank):
        return own, 0.0
    small = solve(other.Q.T @ (rows.A * w), other.Q.T @ (rows.b * w[:, 0]))
    weakest = float(np.linalg.svd(other.Q.T @ own.Q, compute_uv=False)[min(own.rank, other.rank) - 1])
    solution = replace(small, Q=other.Q @ small.Q, condition_number=own.condition_number)
    return solution, weakest
