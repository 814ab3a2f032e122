"""Stage 2 (base parameters with the friction of stage 1 frozen) and the one-shot regression of everything at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fitting.arm.geometry import geometry_of
from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.estimators import Colour, Estimate, Estimator, OrdinaryLeastSquares, StageTwo, within
from fitting.estimators.least_squares import solve
from fitting.estimators.long_rows import LongRows
from fitting.pipeline.cylinder_stage import CylinderEstimate
from fitting.regression.body_prior import BodyPrior
from fitting.regression.design import Design, Extra

#: Recordings that stage 2 and the one-shot regression are made on.
ROLES = ("train", "operation")


@dataclass(frozen=True)
class StackedEstimate:
    """Parameters of the whole arm from one stacked regression of joint efforts.

    Attributes
    ----------
    theta : (p,) all parameters in the design's order
    std : (p,) standard deviations; of stage 2 the drive parameters' are those of what was frozen
    condition_number : of the column-scaled regressor
    told : (p,) False where this motion says nothing of the parameter
    estimator : id of the estimator
    details : what else the estimator had to say
    covariance : (p, p), None of the one-shot regression
    """

    theta: FloatArray
    std: FloatArray
    condition_number: float
    told: BoolArray
    estimator: str = "ols"
    details: Mapping[str, Any] = field(default_factory=dict)
    covariance: FloatArray | None = field(default=None, repr=False)


@dataclass(frozen=True)
class EffortRows:
    """Filtered rows in joint effort, all joints stacked, ``R`` rows.

    Attributes
    ----------
    columns : (R, p) drive and base parameters, then effects
    target : (R,) measured joint effort less what the machine file knows
    groups : (R,) joint of each row
    """

    columns: FloatArray
    target: FloatArray
    groups: IntArray


def effort_rows(design: Design, roles: Sequence[str] = ROLES, extra: Extra | None = None) -> EffortRows:
    """Rows of the recordings with these roles; columns of ``extra`` come last."""
    rows, targets, groups = [], [], []
    for joint in range(len(design.machine.joints)):
        for index in design.indices(*roles):
            r, block = design.segments[index].r[:, joint], design.blocks[joint][index]
            target, columns = block.effort(design.bank, r)
            if extra is not None and extra.names:
                own = extra.columns[joint][index]
                more = np.zeros((len(target), len(extra.names)))
                columns = np.hstack([columns, more if own is None else design.bank.reduce(own * r[:, None])])
            rows.append(columns[block.keep])
            targets.append(target[block.keep])
            groups.append(np.full(len(targets[-1]), joint))
    return EffortRows(np.vstack(rows), np.concatenate(targets), np.concatenate(groups))


def identify_rigid_body(
    design: Design,
    cylinders: Sequence[CylinderEstimate],
    estimator: Estimator | None = None,
    *,
    colour: Colour = "hac",
    prior: BodyPrior | None = None,
) -> StackedEstimate:
    """Stage 2: fit ``r (F - F_cylinder) = Y_b beta`` over all joints and samples, friction frozen at stage 1's.

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
    count = parameters.drive_count
    frozen, covariance = np.zeros(count), np.zeros((count, count))
    for joint, cylinder in enumerate(cylinders):
        part = parameters.drive_slice(joint)
        frozen[part], covariance[part, part] = cylinder.theta, _known(cylinder)
    if design.stored and (estimator is None or isinstance(estimator, OrdinaryLeastSquares)):
        found = _long_with_frozen(design, frozen, covariance, colour)
    else:
        found = _with_frozen(design, effort_rows(design), frozen, covariance, estimator, colour, prior)
    std = found.std.copy()
    std[:count] = np.concatenate([cylinder.std for cylinder in cylinders])
    return replace(found, std=std)


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
    """Base parameters by an estimator of one's choice, drive and effects frozen at a joint fit's values.

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
    base = design.parameters.base_slice
    frozen = np.delete(np.arange(len(theta)), np.arange(base.start, base.stop))
    return _with_frozen(
        design,
        effort_rows(design, ROLES, extra),
        theta[frozen],
        covariance[np.ix_(frozen, frozen)],
        estimator,
        colour,
        prior,
    )


def _known(cylinder: CylinderEstimate) -> FloatArray:
    """Covariance of a cylinder's parameters; zero where it tells none (a joint that never moved)."""
    covariance = np.diag(cylinder.std**2) if cylinder.covariance is None else cylinder.covariance
    return np.where(np.isfinite(covariance), covariance, 0.0)


def _with_frozen(
    design: Design,
    rows: EffortRows,
    frozen: FloatArray,
    covariance: FloatArray,
    estimator: Estimator | None,
    colour: Colour,
    prior: BodyPrior | None,
) -> StackedEstimate:
    base = design.parameters.base_slice
    others = np.delete(np.arange(rows.columns.shape[1]), np.arange(base.start, base.stop))
    A, D = rows.columns[:, base], rows.columns[:, others]
    chosen = OrdinaryLeastSquares() if estimator is None else estimator
    stage = StageTwo(
        geometry=geometry_of(design.machine),
        base=design.parameters.base,
        colour=colour,
        prior=prior,
    )
    estimate = within(chosen, stage).fit(A, rows.target - D @ frozen, groups=rows.groups)
    theta = np.zeros(rows.columns.shape[1])
    theta[base], theta[others] = estimate.theta, frozen
    places = np.arange(base.start, base.stop), others
    whole = _covariance(A, D, covariance, estimate, rows.groups, places)
    told = np.ones(len(theta), dtype=bool)
    told[base] = estimate.told
    std, condition = np.sqrt(np.diag(whole)), float(estimate.condition_number)
    return StackedEstimate(theta, std, condition, told, chosen.name, estimate.details, whole)


def _long_with_frozen(design: Design, frozen: FloatArray, covariance: FloatArray, colour: Colour) -> StackedEstimate:
    """As :func:`_with_frozen` by ordinary least squares, over more rows than fit in memory."""
    rows = LongRows(design, ROLES)
    base = design.parameters.base_slice
    count, wanted = design.parameters.drive_count, np.arange(base.start, base.stop)
    theta = np.concatenate([frozen, np.zeros(len(wanted))])
    estimate = rows.fit(wanted, theta, colour)
    theta[wanted] = estimate.theta
    A, D = rows.columns[:, wanted], rows.columns[:, :count]
    whole = _covariance(A, D, covariance, estimate, rows.groups, (wanted, np.arange(count)))
    told = np.concatenate([np.ones(count, dtype=bool), estimate.told])
    return StackedEstimate(theta, np.sqrt(np.diag(whole)), estimate.condition_number, told, covariance=whole)


def _covariance(
    A: FloatArray,
    D: FloatArray,
    frozen: FloatArray,
    estimate: Estimate,
    groups: IntArray,
    places: tuple[IntArray, IntArray],
) -> FloatArray:
    """Covariance (p, p) of all parameters: base ones have their own and what they inherit of those that were frozen.

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
    """Drive and base parameters at once, by ordinary least squares of joint efforts.

    ``unloaded`` takes the recordings with the rods unpinned too, which stage 1 has: what then still differs from the
    two stages is the order of work and not the data.
    """
    roles = (*ROLES, "unloaded") if unloaded else ROLES
    if design.stored:
        everything = np.arange(len(design.parameters))
        estimate = LongRows(design, roles).fit(everything, np.zeros(len(everything)), colour)
        return StackedEstimate(estimate.theta, estimate.std, estimate.condition_number, estimate.told)
    rows = effort_rows(design, roles)
    estimate = OrdinaryLeastSquares(colour=colour).fit(rows.columns, rows.target, groups=rows.groups)
    return StackedEstimate(estimate.theta, estimate.std, float(estimate.condition_number), estimate.told)
