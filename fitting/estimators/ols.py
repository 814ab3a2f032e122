"""Ordinary least squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fitting.estimators.base import Estimate, Rows
from fitting.estimators.context import RowsEstimator
from fitting.estimators.covariance import Colour, scores_covariance
from fitting.estimators.least_squares import residual_std, solve


@dataclass(frozen=True)
class OrdinaryLeastSquares(RowsEstimator):
    """Minimises ``sum w (b - A theta)^2`` by pivoted QR."""

    name: ClassVar[str] = "ols"

    def solved(self, rows: Rows) -> Estimate:
        """Solve least squares with the given weights."""
        return weighted_fit(rows, self.colour)


def weighted_fit(rows: Rows, colour: Colour) -> Estimate:
    """Solve least squares with the weights of ``rows``; rows of weight zero count nowhere."""
    counted = rows.weights > 0
    root = np.sqrt(rows.weights)
    A, b = rows.A * root[:, None], rows.b * root
    solution = solve(A, b)
    scaled = b - A @ solution.theta
    return Estimate(
        theta=solution.theta,
        covariance=solution.covariance(scores_covariance(solution, scaled, colour, rows.group, counted)),
        residual_std=residual_std(rows, solution.leverage, solution.theta),
        groups=rows.labels,
        condition_number=solution.condition_number,
        determined=solution.determined,
    )
