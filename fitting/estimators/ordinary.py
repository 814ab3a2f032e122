"""Ordinary least squares."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fitting.estimators.base import Estimate, Rows, check_rows
from fitting.estimators.context import StageTwo
from fitting.estimators.covariance import Colour, scores_covariance
from fitting.estimators.least_squares import residual_std, solve


@dataclass(frozen=True)
class OrdinaryLeastSquares:
    """Minimises ``sum w (b - A theta)^2`` by pivoted QR.

    Attributes
    ----------
    colour : how the covariance treats coloured residuals (:mod:`fitting.estimators.covariance`)
    """

    colour: Colour = "white"

    @property
    def name(self) -> str:
        """``ols``."""
        return "ols"

    def within(self, stage: StageTwo) -> OrdinaryLeastSquares:
        """The same with the covariance that stage 2 asks for."""
        return replace(self, colour=stage.colour)

    def fit(
        self,
        A: npt.ArrayLike,
        b: npt.ArrayLike,
        *,
        groups: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Fit rows; see :class:`fitting.estimators.base.Estimator`."""
        return weighted_fit(check_rows(A, b, groups, weights), self.colour)


def weighted_fit(rows: Rows, colour: Colour) -> Estimate:
    """Least squares with the weights of ``rows``; rows of weight zero count nowhere."""
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
        told=solution.told,
    )
