"""Physically possible base parameters: those of bodies that can exist, and as near to the rows as such can be.

Least squares knows nothing of bodies; with noise it gives links whose inertia no distribution of mass has, and a
simulator or controller built on them can do the impossible. Here every link's pseudo-inertia is kept positive definite
(:mod:`fitting.regression.plausible_arm` with a weight of a thousandth) while the distance to the rows is minimised.
Rows have the covariance of coloured residuals in them (:mod:`fitting.estimators.covariance`), so the distance is a
chi-square: the price of what is possible. The weight means nothing against a chi-square; it keeps the links strictly
inside what is possible, and of all standard parameters that have the same base parameters it picks those nearest to
plausible links. That choice is a belief, not a measurement; a drawing given as prior takes the place of those links.

The covariance is that of the unconstrained fit: on the boundary it is too large rather than too small.

Sources: Sousa and Cortesao, Int. J. Robotics Research 33 (2014) 931 (base parameters and inequalities); Wensing, Kim
and Slotine, IEEE RA-L 3 (2018) 60 (pseudo-inertia); Lee, Wensing and Park, IEEE T-RO 36 (2020) 318 (divergence).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry
from fitting.estimators.base import Estimate, Rows
from fitting.estimators.context import RowsEstimator, StageTwo
from fitting.estimators.covariance import Information, information
from fitting.estimators.least_squares import residual_std
from fitting.estimators.wls import weighted_by_group
from fitting.regression.body_prior import BodyPrior
from fitting.regression.plausible_arm import ALONE, Optimum, plausible_arm


@dataclass(frozen=True)
class PossibleFit(RowsEstimator):
    """Weighted least squares under the inequalities of all links.

    Attributes
    ----------
    base : base parameters that the columns belong to; None for no inequalities, which is weighted least squares
    geometry : the arm; its link lengths give the inequalities their scale
    prior : a drawing to choose the standard parameters by, or None
    """

    name: ClassVar[str] = "possible"
    base: BaseParameters | None = None
    geometry: Geometry | None = None
    prior: BodyPrior | None = None

    def within(self, stage: StageTwo) -> Self:
        """Return the same for the links of the stage's arm."""
        return replace(self, base=stage.base, geometry=stage.geometry, prior=stage.prior, colour=stage.colour)

    def solved(self, rows: Rows) -> Estimate:
        """Solve for the nearest parameters that bodies can have.

        ``details`` hold the price (``chi_square_price`` and the rise of each group's error in percent), the parameters
        that a constraint moved in standard deviations, and ``standard_parameters`` by name.
        """
        rows = weighted_by_group(rows)
        data = information(rows, self.colour)
        spread = partial(residual_std, rows, data.solution.leverage)
        free = data.solution.theta
        theta, details = free, {}
        if self.base is not None and self.geometry is not None:
            if len(self.base) != len(free):
                raise ValueError(f"there are {len(self.base)} base parameters, the regressor has {len(free)} columns")
            drawing = None if self.prior is None else self.prior.bodies
            rows_of_base = np.column_stack([data.rows, data.target])
            arm = plausible_arm(self.geometry, self.base, (), [rows_of_base], drawing)
            found = arm.optimum(data.rows, data.target, weight=ALONE)
            theta = found.theta
            details = _details(data, self.base, found)
            details["error_rise_percent"] = (100.0 * (spread(theta) / spread(free) - 1.0)).tolist()
        return Estimate(
            theta=theta,
            covariance=data.covariance,
            residual_std=spread(theta),
            groups=rows.labels,
            condition_number=data.solution.condition_number,
            determined=data.solution.determined,
            details=details,
        )


def _details(data: Information, base: BaseParameters, found: Optimum) -> dict[str, Any]:
    free, std, theta = data.solution.theta, np.sqrt(np.diag(data.covariance)), found.theta
    moved = np.where(np.isfinite(std) & (std > 0), (theta - free) / np.where(std > 0, std, 1.0), 0.0)
    return {
        "chi_square_price": float(
            np.sum((data.rows @ theta - data.target) ** 2) - np.sum((data.rows @ free - data.target) ** 2)
        ),
        "moved_sigmas": {n: float(m) for n, m in zip(base.names, moved, strict=True)},
        "standard_parameters": {n: float(v) for n, v in zip(base.standard_names, found.standard, strict=True)},
        "smallest_eigenvalue": float(np.min(np.linalg.eigvalsh(found.bodies))),
    }
