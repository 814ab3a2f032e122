"""Ridge toward a prior: what the recordings cannot tell is taken from a drawing or an earlier calibration.

Minimises ``(b - A theta)' C^-1 (b - A theta) + sum ((theta - mean) / std)^2``, with the residual's own colour in ``C``:
the rows count as often as they are independent, so the prior is not drowned by sampling faster. This is the posterior
of a normal prior (Tarantola, *Inverse Problem Theory*, 2005, 3.2); its covariance is the posterior's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from daq.errors import InputError
from fitting.estimators.base import Estimate, check_rows
from fitting.estimators.context import StageTwo
from fitting.estimators.covariance import Colour
from fitting.estimators.information import information
from fitting.estimators.least_squares import residual_std, solve
from fitting.estimators.weighted import weighted_by_group
from fitting.regression.body_prior import BodyPrior


@dataclass(frozen=True)
class RidgeTowardPrior:
    """Weighted least squares drawn toward a prior.

    Attributes
    ----------
    prior : mean and standard deviation of each parameter; None for none, which is weighted least squares
    names : (p,) of the parameters, for what is said of them
    colour : as in :class:`fitting.estimators.ordinary.OrdinaryLeastSquares`
    """

    prior: BodyPrior | None = None
    names: tuple[str, ...] = ()
    colour: Colour = "white"

    @property
    def name(self) -> str:
        """``ridge``."""
        return "ridge"

    def within(self, stage: StageTwo) -> RidgeTowardPrior:
        """The same with the stage's prior.

        Raises
        ------
        InputError
            If the stage has none.
        """
        if stage.prior is None:
            raise InputError(
                "estimator 'ridge' needs a prior: give an earlier report.json or the links from drawings with "
                "--prior FILE"
            )
        return replace(self, prior=stage.prior, names=stage.base.names, colour=stage.colour)

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
        ValueError
            Also if the prior has another number of parameters than ``A`` has columns.
        """
        rows = weighted_by_group(check_rows(A, b, groups, weights))
        data = information(rows, self.colour)
        theta, covariance, told = data.solution.theta, data.covariance, data.solution.told
        details: dict[str, object] = {}
        if self.prior is not None:
            if self.prior.mean.shape != theta.shape:
                raise ValueError(f"the prior has {len(self.prior.mean)} parameters, the regressor {len(theta)}")
            more = np.diag(1.0 / self.prior.std)
            both = solve(np.vstack([data.rows, more]), np.concatenate([data.target, self.prior.mean / self.prior.std]))
            theta, covariance, told = both.theta, both.covariance(1.0), both.told
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
            told=told,
            details=details,
        )
