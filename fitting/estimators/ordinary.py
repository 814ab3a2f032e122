"""Ordinary least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.estimators.base import Estimate, Rows, check_rows
from fitting.estimators.covariance import scores_covariance
from fitting.estimators.least_squares import group_std, solve


@dataclass(frozen=True)
class OrdinaryLeastSquares:
    """Minimises ``sum w (b - A theta)^2`` by pivoted QR.

    Attributes
    ----------
    lags : None for the covariance ``sigma^2 (A'WA)^-1`` of white residuals; a number of samples for Newey-West's
    """

    lags: int | None = None

    @property
    def name(self) -> str:
        """``ols``."""
        return "ols"

    def fit(
        self,
        A: npt.ArrayLike,
        b: npt.ArrayLike,
        *,
        groups: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Fit rows; see :class:`fitting.estimators.base.Estimator`."""
        return weighted_fit(check_rows(A, b, groups, weights), self.lags)


def weighted_fit(rows: Rows, lags: int | None) -> Estimate:
    """Least squares with the weights of ``rows``; rows of weight zero count nowhere."""
    counted = rows.weights > 0
    root = np.sqrt(rows.weights)
    A, b = rows.A * root[:, None], rows.b * root
    solution = solve(A, b)
    scaled = b - A @ solution.theta
    if lags is None:
        free = int(np.count_nonzero(counted)) - solution.rank
        covariance = solution.covariance(float(scaled @ scaled) / free if free > 0 else float("nan"))
    else:
        covariance = solution.covariance(scores_covariance(solution, scaled, lags, rows.group))
    plain = rows.b - rows.A @ solution.theta
    return Estimate(
        theta=solution.theta,
        covariance=covariance,
        residual_std=group_std(plain[counted], solution.leverage[counted], rows.group[counted], len(rows.labels)),
        groups=rows.labels,
        condition_number=solution.condition_number,
        told=solution.told,
    )
