"""Weighted least squares, one weight per joint, in two steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fitting.estimators.base import Estimate, FloatArray, Rows, check_rows
from fitting.estimators.ordinary import weighted_fit


@dataclass(frozen=True)
class WeightedLeastSquares:
    """Ordinary least squares first; then again with each group's rows divided by its residual's standard deviation.

    The base joint of an arm carries tens of times the effort of its tip, and its noise: unweighted, the tip's own
    parameters would be told by the base's noise.

    Attributes
    ----------
    lags : as in :class:`fitting.estimators.ordinary.OrdinaryLeastSquares`

    Source
    ------
    Gautier, "Dynamic identification of robots with power model", ICRA 1997.
    """

    lags: int | None = None

    @property
    def name(self) -> str:
        """``wls``."""
        return "wls"

    def fit(
        self,
        A: npt.ArrayLike,
        b: npt.ArrayLike,
        *,
        groups: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Fit rows; see :class:`fitting.estimators.base.Estimator`."""
        rows = check_rows(A, b, groups, weights)
        first = weighted_fit(rows, None)
        spread = usable_spread(first.residual_std, rows)
        return weighted_fit(replace(rows, weights=rows.weights / spread[rows.group] ** 2), self.lags)


def usable_spread(spread: FloatArray, rows: Rows) -> FloatArray:
    """Standard deviations (g,) fit to divide by.

    A group fitted exactly, or with no freedom left, has no spread of its own: it takes the smallest believable one
    (1e-9 of the target), or the common one, lest its weight become infinite.
    """
    known = spread[np.isfinite(spread)]
    common = float(np.sqrt(np.mean(known**2))) if known.size else 1.0
    size = float(np.sqrt(np.mean(rows.b**2)))
    floor = 1e-9 * size if size > 0 else 1.0
    return np.maximum(np.where(np.isfinite(spread), spread, common), floor)
