"""Estimators of linear regressions: the seam `hilfit.estimators`, one file each, called as the estimator.

The choice is whatever is in this folder, or in the entry-point group ``hilfit.estimators``: a package of its own adds
an estimator with one file, one line of TOML and one call of :func:`fitting.estimators.conformance.check_estimator`.
"""

from __future__ import annotations

from daq.seams import ESTIMATORS
from fitting.estimators.base import Estimate, Estimator
from fitting.estimators.context import StageTwo, within
from fitting.estimators.covariance import Colour
from fitting.estimators.ols import OrdinaryLeastSquares

__all__ = [
    "Colour",
    "Estimate",
    "Estimator",
    "OrdinaryLeastSquares",
    "StageTwo",
    "estimator",
    "estimator_ids",
    "within",
]


def estimator_ids() -> tuple[str, ...]:
    """List the ids of all installed estimators, sorted."""
    return ESTIMATORS.names()


def estimator(name: str) -> Estimator:
    """Return the estimator with this id (``InputError``, one line, if there is none or it is none)."""
    made: Estimator = ESTIMATORS.make(name, Estimator)
    return made
