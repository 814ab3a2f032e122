"""Weighted least squares, one weight per joint, in two steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from fitting.arrays import FloatArray
from fitting.estimators.base import Estimate, Rows
from fitting.estimators.context import RowsEstimator
from fitting.estimators.ols import weighted_fit


@dataclass(frozen=True)
class WeightedLeastSquares(RowsEstimator):
    """Ordinary least squares first; then again with each group's rows divided by its residual's standard deviation.

    The base joint of an arm carries tens of times the effort of its tip, and its noise: unweighted, the tip's own
    parameters would be set by the base's noise.

    Source
    ------
    Gautier, "Dynamic identification of robots with power model", ICRA 1997.
    """

    name: ClassVar[str] = "wls"

    def solved(self, rows: Rows) -> Estimate:
        """Solve least squares with the weights that the first step gives."""
        return weighted_fit(weighted_by_group(rows), self.colour)


def weighted_by_group(rows: Rows) -> Rows:
    """Divide each group's weights by the variance that ordinary least squares leaves in it."""
    spread = _usable_spread(weighted_fit(rows, "white").residual_std, rows)
    return replace(rows, weights=rows.weights / spread[rows.group] ** 2)


def _usable_spread(spread: FloatArray, rows: Rows) -> FloatArray:
    """Return standard deviations (g,) fit to divide by.

    A group fitted exactly, or with no freedom left, has no spread of its own: it takes the smallest believable one
    (1e-9 of the target), or the common one, lest its weight become infinite.
    """
    known = spread[np.isfinite(spread)]
    common = float(np.sqrt(np.mean(known**2))) if known.size else 1.0
    size = float(np.sqrt(np.mean(rows.b**2)))
    floor = 1e-9 * size if size > 0 else 1.0
    return np.maximum(np.where(np.isfinite(spread), spread, common), floor)
