"""The estimators' contract: the seam `hilfit.estimators`.

An estimator takes the rows of a linear regression ``b = A theta + e`` and gives parameters with a covariance. Rows
come in groups (one per joint: joints have different units and noise) and are in time order within a group. An
estimator never guesses: a parameter that the rows do not determine is marked in :attr:`Estimate.determined`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from fitting.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Estimate:
    """Parameters of a linear regression, and how well the rows determine them.

    Attributes
    ----------
    theta : (p,) parameters. ``A @ theta`` is the prediction also where some are undetermined: of columns that stand in
        for one another some are then left at zero
    covariance : (p, p); infinite variance and no covariance for an undetermined parameter
    residual_std : (g,) standard deviation of ``b - A theta`` in each group, in the unit of ``b``, with the degrees
        of freedom that the fit took from that group counted
    groups : (g,) labels of the groups, ascending
    condition_number : of the columns used, scaled to unit norm
    determined : (p,) False for every parameter with a part in the null space of ``A``
    details : what else the estimator reports of this fit (plain JSON), for the report
    """

    theta: FloatArray
    covariance: FloatArray
    residual_std: FloatArray
    groups: IntArray
    condition_number: float
    determined: BoolArray
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def std(self) -> FloatArray:
        """Standard deviations of the parameters, (p,); infinite where undetermined."""
        return np.sqrt(np.diag(self.covariance))


@runtime_checkable
class Estimator(Protocol):
    """Fits ``b = A theta``; see :func:`fitting.estimators.conformance.check_estimator` for what it must hold to."""

    @property
    def name(self) -> str:
        """Short name, as in the report (``ols``)."""
        ...

    def fit(
        self,
        A: npt.ArrayLike,
        b: npt.ArrayLike,
        *,
        groups: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Fit rows.

        Parameters
        ----------
        A : (R, p) regressor
        b : (R,) target
        groups : (R,) whole numbers, the joint of each row; one group if None. Rows of a group are in time order
        weights : (R,) not negative: what each squared residual counts (1 / variance up to a factor); 1 if None

        Raises
        ------
        ValueError
            If shapes do not match, a number is not finite, or a weight is negative.
        """
        ...


@dataclass(frozen=True)
class Rows:
    """Checked input of a fit: ``A`` (R, p), ``b`` (R,), ``group`` (R,) as 0..g-1, ``labels`` (g,), ``weights`` (R,)."""

    A: FloatArray
    b: FloatArray
    group: IntArray
    labels: IntArray
    weights: FloatArray


def check_rows(
    A: npt.ArrayLike,
    b: npt.ArrayLike,
    groups: npt.ArrayLike | None = None,
    weights: npt.ArrayLike | None = None,
) -> Rows:
    """Convert the arguments of :meth:`Estimator.fit` to arrays; ``ValueError`` names what is wrong with them."""
    A = np.asarray(A, dtype=float)
    b = np.asarray(b, dtype=float)
    if A.ndim != 2 or b.shape != A.shape[:1]:
        raise ValueError(f"regressor {A.shape} and target {b.shape} do not match: (R, p) and (R,) are needed")
    if not len(b) or not A.shape[1]:
        raise ValueError(f"a fit needs at least one row and one column, the regressor is {A.shape}")
    bad = np.flatnonzero(~(np.isfinite(A).all(axis=1) & np.isfinite(b)))
    if bad.size:
        raise ValueError(f"{bad.size} rows are not finite, the first is row {bad[0]}: drop gaps before fitting")
    w = np.ones(len(b)) if weights is None else np.asarray(weights, dtype=float)
    if w.shape != b.shape or not np.isfinite(w).all() or (w < 0).any():
        raise ValueError(f"weights must be {b.shape} finite numbers that are not negative")
    if groups is None:
        labels, group = np.zeros(1, dtype=np.intp), np.zeros(len(b), dtype=np.intp)
    else:
        given = np.asarray(groups)
        if given.shape != b.shape or not np.issubdtype(given.dtype, np.integer):
            raise ValueError(f"groups must be {b.shape} whole numbers")
        labels, group = np.unique(given, return_inverse=True)
    return Rows(A, b, group.astype(np.intp), labels.astype(np.intp), w)
