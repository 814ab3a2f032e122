"""Huber's M-estimator by iteratively reweighted least squares: outliers pull, but not with their full length."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from daq.errors import HilfitError
from fitting.estimators.base import Estimate, FloatArray, Rows, check_rows
from fitting.estimators.context import StageTwo
from fitting.estimators.covariance import Colour, scores_covariance
from fitting.estimators.least_squares import group_std, solve
from fitting.estimators.weighted import usable_spread

# Median of |N(0, 1)|: makes the median absolute deviation a standard deviation for normal noise.
_MAD = 0.6744897501960817


@dataclass(frozen=True)
class HuberRegression:
    """Minimises ``sum rho(u)``, ``u = e / s_g``: ``rho = u^2 / 2`` up to ``bend``, a straight line beyond.

    ``s_g`` is each group's median absolute residual over 0.6745, taken anew in every iteration.

    Attributes
    ----------
    bend : residuals above so many standard deviations count as outliers; 1.345 keeps 95 % efficiency for normal noise
    iterations : most iterations allowed
    colour : as in :class:`fitting.estimators.ordinary.OrdinaryLeastSquares`, for the bent residual

    Source
    ------
    Huber, Robust Statistics (1981), 7.6 (covariance), 7.8 (algorithm).
    """

    bend: float = 1.345
    iterations: int = 500
    colour: Colour = "white"

    @property
    def name(self) -> str:
        """``huber``."""
        return "huber"

    def within(self, stage: StageTwo) -> HuberRegression:
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
        """Fit rows; see :class:`fitting.estimators.base.Estimator`.

        Raises
        ------
        HilfitError
            If the iteration does not settle.
        """
        rows = check_rows(A, b, groups, weights)
        counted = rows.weights > 0
        # A row's own weight is a factor on its squared residual, so it scales the residual by its root.
        own = np.sqrt(rows.weights)
        theta = solve(rows.A * own[:, None], rows.b * own).theta
        for _ in range(self.iterations):
            scale = self._scale(rows, (rows.b - rows.A @ theta) * own, counted) / np.where(counted, own, 1.0)
            u = np.where(counted, (rows.b - rows.A @ theta) / scale, 0.0)
            pull = counted * np.sqrt(np.minimum(1.0, self.bend / np.maximum(np.abs(u), self.bend))) / scale
            solution = solve(rows.A * pull[:, None], rows.b * pull)
            step = (rows.A @ (solution.theta - theta)) / scale * counted
            theta = solution.theta
            if np.abs(step).max() < 1e-8:
                return self._finish(rows, theta, scale, counted)
        raise HilfitError(
            f"the robust fit did not settle in {self.iterations} iterations: look for a parameter that only "
            "outliers tell, or use the estimator 'wls'"
        )

    def _scale(self, rows: Rows, residual: FloatArray, counted: npt.NDArray[np.bool_]) -> FloatArray:
        """Robust standard deviation of each row's group, (R,)."""
        spread = np.full(len(rows.labels), np.nan)
        for g in range(len(rows.labels)):
            chosen = (rows.group == g) & counted
            if chosen.any():
                spread[g] = np.median(np.abs(residual[chosen])) / _MAD
        return usable_spread(spread, replace(rows, b=rows.b * np.sqrt(rows.weights)))[rows.group]

    def _finish(self, rows: Rows, theta: FloatArray, scale: FloatArray, counted: npt.NDArray[np.bool_]) -> Estimate:
        """Covariance ``k^2 / m^2 root S root'``, ``m`` the share of rows that are no outliers, ``S`` that of ``Q'psi``.

        ``k = 1 + (p / n) (1 - m) / m`` corrects for the parameters fitted; for a white residual ``S = sum psi^2 /
        (n - p)``.
        """
        inner = counted / scale
        solution = solve(rows.A * inner[:, None], rows.b * inner)
        u = (rows.b - rows.A @ theta) * inner
        n, p = int(np.count_nonzero(counted)), solution.rank
        psi = np.clip(u, -self.bend, self.bend)
        share = float(np.mean(np.abs(u[counted]) <= self.bend))
        factor = (1.0 + p / n * (1.0 - share) / share) / share if share > 0 else float("nan")
        middle = scores_covariance(solution, psi, self.colour, rows.group, counted)
        plain = rows.b - rows.A @ theta
        return Estimate(
            theta=theta,
            covariance=solution.covariance(factor**2 * middle),
            residual_std=group_std(plain[counted], solution.leverage[counted], rows.group[counted], len(rows.labels)),
            groups=rows.labels,
            condition_number=solution.condition_number,
            told=solution.told,
            details={"outliers_percent": 100.0 * (1.0 - share)},
        )
