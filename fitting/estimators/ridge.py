"""Ridge toward a prior: what the recordings do not determine is taken from a drawing or an earlier calibration.

Minimises ``(b - A theta)' C^-1 (b - A theta) + sum ((theta - mean) / std)^2``, with the residual's own colour in ``C``:
the rows count as often as they are independent, so the prior is not drowned by sampling faster. This is the posterior
of a normal prior (Tarantola, *Inverse Problem Theory*, 2005, 3.2); its covariance is the posterior's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from daq.errors import InputError
from fitting.estimators.base import Estimate, Rows
from fitting.estimators.context import RowsEstimator, StageTwo
from fitting.estimators.covariance import information
from fitting.estimators.least_squares import residual_std, solve
from fitting.estimators.wls import weighted_by_group
from fitting.regression.body_prior import BodyPrior


@dataclass(frozen=True)
class RidgeTowardPrior(RowsEstimator):
    """Weighted least squares drawn toward a prior.

    Attributes
    ----------
    prior : mean and standard deviation of each parameter; None for none, which is weighted least squares
    names : (p,) of the parameters, for messages about them
    """

    name: ClassVar[str] = "ridge"
    prior: BodyPrior | None = None
    names: tuple[str, ...] = ()

    def within(self, stage: StageTwo) -> Self:
        """Return the same with the stage's prior; an :class:`~daq.errors.InputError` if it has none."""
        if stage.prior is None:
            raise InputError("fitting.estimator_ridge_needs_prior")
        return replace(self, prior=stage.prior, names=stage.base.names, colour=stage.colour)

    def solved(self, rows: Rows) -> Estimate:
        """Solve weighted least squares beside the prior.

        Raises
        ------
        ValueError
            If the prior has another number of parameters than the rows have columns.
        """
        rows = weighted_by_group(rows)
        data = information(rows, self.colour)
        theta, covariance, determined = data.solution.theta, data.covariance, data.solution.determined
        details: dict[str, object] = {}
        if self.prior is not None:
            if self.prior.mean.shape != theta.shape:
                raise ValueError(f"the prior has {len(self.prior.mean)} parameters, the regressor {len(theta)}")
            more = np.diag(1.0 / self.prior.std)
            both = solve(np.vstack([data.rows, more]), np.concatenate([data.target, self.prior.mean / self.prior.std]))
            theta, covariance, determined = both.theta, both.covariance(1.0), both.determined
            share = 1.0 - np.diag(covariance) / self.prior.std**2
            details = {
                "prior": self.prior.source,
                "told_by_data": {n: float(s) for n, s in zip(self.names, share, strict=True)},
                "prior_chi_square": float(np.sum(((theta - self.prior.mean) / self.prior.std) ** 2)),
            }
        return Estimate(
            theta=theta,
            covariance=covariance,
            residual_std=residual_std(rows, data.solution.leverage, theta),
            groups=rows.labels,
            condition_number=data.solution.condition_number,
            determined=determined,
            details=details,
        )
