"""Stage 2 (base parameters with the friction of stage 1 frozen) and the one-shot regression of everything at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray, IntArray
from fitting.estimators import Colour, Estimate, Estimator, OrdinaryLeastSquares, StageTwo, within
from fitting.estimators.effort_fit import EffortRows
from fitting.estimators.least_squares import solve
from fitting.pipeline.cylinder_stage import CylinderEstimate
from fitting.regression.body_prior import BodyPrior
from fitting.regression.design import Design, Extra

#: Recordings that stage 2 and the one-shot regression are made on.
ROLES = ("train", "operation")


@dataclass(frozen=True)
class StackedEstimate(Estimate):
    """Parameters of the whole arm from one stacked regression of joint efforts, in the design's order.

    Of stage 2 the drive parameters' deviations are those of what was frozen: 0 where stage 1 has none.
    """

    estimator: str = "ols"


def identify_rigid_body(
    design: Design,
    cylinders: Sequence[CylinderEstimate],
    estimator: Estimator | None = None,
    *,
    colour: Colour = "hac",
    prior: BodyPrior | None = None,
) -> StackedEstimate:
    """Fit stage 2, ``r (F - F_cylinder) = Y_b beta``, over all joints and samples, stage 1's friction frozen.

    Parameters
    ----------
    design : design of the recordings
    cylinders : stage 1's results, joint by joint
    estimator : ordinary least squares if None
    colour : what the covariance makes of coloured residuals
    prior : of the base parameters, for estimators that take one

    Raises
    ------
    InputError
        If the estimator lacks something that it cannot do without.
    """
    parameters = design.parameters
    frozen, covariance = np.zeros(len(parameters)), np.zeros((len(parameters),) * 2)
    for joint, cylinder in enumerate(cylinders):
        part = parameters.drive_slice(joint)
        frozen[part], covariance[part, part] = cylinder.theta, _known(cylinder)
    by = estimator or OrdinaryLeastSquares()
    return refit_rigid_body(design, frozen, covariance, by, colour=colour, prior=prior)


def refit_rigid_body(
    design: Design,
    theta: FloatArray,
    covariance: FloatArray,
    estimator: Estimator,
    *,
    extra: Extra | None = None,
    colour: Colour = "hac",
    prior: BodyPrior | None = None,
) -> StackedEstimate:
    """Refit base parameters by a chosen estimator, drive and effects frozen at a joint fit's values.

    Parameters
    ----------
    design : design of the corrected recordings
    theta, covariance : (p,), (p, p) of the joint fit: drive, base, effects
    estimator, colour, prior : as in :func:`identify_rigid_body`
    extra : the effects' columns

    Returns
    -------
    StackedEstimate
        With all ``p`` parameters; those that were frozen keep the joint fit's deviations.
    """
    base = np.arange(len(theta))[design.parameters.base_slice]
    others = np.delete(np.arange(len(theta)), base)
    rows = EffortRows(design, design.indices(*ROLES), extra, posed=True)
    folded = design.stored and isinstance(estimator, OrdinaryLeastSquares)
    columns, target, groups = rows.stacked(folded)
    A, D = columns[:, base], columns[:, others]
    if folded:
        estimate = rows.ordinary(base, theta, colour)
    else:
        stage = StageTwo(geometry_of(design.machine), design.parameters.base, colour, prior)
        estimate = within(estimator, stage).fit(A, target - D @ theta[others], groups=groups)
    found, determined = theta.copy(), np.ones(len(theta), dtype=bool)
    found[base], determined[base] = estimate.theta, estimate.determined
    whole = _covariance(A, D, covariance[np.ix_(others, others)], estimate, groups, (base, others))
    made = replace(estimate, theta=found, covariance=whole, determined=determined)
    return StackedEstimate(**vars(made), estimator=estimator.name)


def _known(cylinder: CylinderEstimate) -> FloatArray:
    """Return a cylinder parameters' covariance; zero where none (a joint that never moved)."""
    covariance = np.diag(cylinder.std**2) if cylinder.covariance is None else cylinder.covariance
    return np.where(np.isfinite(covariance), covariance, 0.0)


def _covariance(
    A: FloatArray,
    D: FloatArray,
    frozen: FloatArray,
    estimate: Estimate,
    groups: IntArray,
    places: tuple[IntArray, IntArray],
) -> FloatArray:
    """Compute all parameters' covariance (p, p): base ones have their own and that inherited of the frozen ones.

    ``theta_b = (A'WA)^-1 A'W (b - D theta_f)``: with ``G = (A'WA)^-1 A'WD`` the base has ``G C G'`` more, and ``-G C``
    in common with the frozen ones. Weights are those of the joints' residuals, whatever the estimator.

    Parameters
    ----------
    A, D : (R, nb), (R, k) columns of base and frozen parameters
    frozen : (k, k) covariance of the latter
    places : where base and frozen parameters are among all
    """
    spread = np.where(np.isfinite(estimate.residual_std) & (estimate.residual_std > 0), estimate.residual_std, 1.0)
    w = 1.0 / spread[np.searchsorted(estimate.groups, groups)][:, None]
    solution = solve(A * w, np.zeros(len(A)))
    G = solution.root @ (solution.Q.T @ (D * w))
    base, others = places
    whole = np.zeros((len(base) + len(others),) * 2)
    whole[np.ix_(base, base)] = estimate.covariance + G @ frozen @ G.T
    whole[np.ix_(others, others)] = frozen
    whole[np.ix_(base, others)] = -G @ frozen
    whole[np.ix_(others, base)] = whole[np.ix_(base, others)].T
    return whole


def identify_one_shot(design: Design, *, unloaded: bool = False, colour: Colour = "hac") -> StackedEstimate:
    """Fit drive and base parameters at once, by ordinary least squares of joint efforts.

    ``unloaded`` takes the recordings with the rods unpinned too, which stage 1 has: what then still differs from the
    two stages is the order of work and not the data.
    """
    rows = EffortRows(design, design.indices(*ROLES, *(("unloaded",) if unloaded else ())), posed=True)
    everything = np.arange(len(design.parameters))
    return StackedEstimate(**vars(rows.ordinary(everything, np.zeros(len(everything)), colour)))
