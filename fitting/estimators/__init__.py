"""Estimators of linear regressions: the seam `hilfit.estimators`, one file each."""

from __future__ import annotations

from fitting.estimators.base import Estimate, Estimator
from fitting.estimators.covariance import automatic_lags, hac_covariance
from fitting.estimators.huber import HuberRegression
from fitting.estimators.ordinary import OrdinaryLeastSquares
from fitting.estimators.recursive import RecursiveFit, RecursiveLeastSquares
from fitting.estimators.weighted import WeightedLeastSquares

__all__ = [
    "Estimate",
    "Estimator",
    "HuberRegression",
    "OrdinaryLeastSquares",
    "RecursiveFit",
    "RecursiveLeastSquares",
    "WeightedLeastSquares",
    "automatic_lags",
    "hac_covariance",
]
