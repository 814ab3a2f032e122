"""Stage 2 (base parameters with the friction of stage 1 frozen), the one-shot regression of everything at once, the
final refit by the estimator that was asked for, and the comparison of the two orders of work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.messages import Sentence
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry, geometry_of
from fitting.arrays import FloatArray, IntArray
from fitting.estimators import (
    Colour,
    Estimate,
    Estimator,
    OrdinaryLeastSquares,
    StageTwo,
    estimator,
    estimator_ids,
    within,
)
from fitting.estimators.effort_fit import EffortRows
from fitting.estimators.least_squares import solve
from fitting.loop.session import Options, Session
from fitting.pipeline.comparison import compare, cylinder_conditions, stage_condition
from fitting.pipeline.cylinder_stage import CylinderEstimate
from fitting.pipeline.results.stage_results import Cylinders, RigidBody, Stacked, StageResults
from fitting.progress import Progress
from fitting.regression.body_prior import BodyPrior, read_body_prior
from fitting.regression.design import Design, Extra
from fitting.regression.error_sizes import errors_of
from fitting.regression.solving import Fit
from fitting.residual.terms import Model

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
        own = np.diag(cylinder.std**2) if cylinder.covariance is None else cylinder.covariance
        frozen[part], covariance[part, part] = cylinder.theta, np.where(np.isfinite(own), own, 0.0)
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


#: The joint refit of both stages beside a plausible arm: no plug-in, because it is the loop's own fit.
JOINT = "gls"
_COLOURS: dict[str, Colour] = {"hac": "hac", "bootstrap": "bootstrap", "white": "white"}


@dataclass(frozen=True)
class Choice:
    """An estimator with what it needs.

    Attributes
    ----------
    name : id, as in the report
    estimator : None for the joint refit; stage 2 by itself then is ordinary least squares
    colour : which covariance
    prior : of the base parameters, or None
    """

    name: str
    estimator: Estimator | None
    colour: Colour
    prior: BodyPrior | None


def chosen(options: Options, base: BaseParameters, geometry: Geometry) -> Choice:
    """Load the estimator that the options ask for, fit to be used on this arm.

    Raises
    ------
    InputError
        One line: no such estimator or covariance, an extra that is not installed, a prior that is missing or wrong.
    """
    colour: Colour = _COLOURS.get(options.covariance, "white")
    if options.covariance not in _COLOURS:
        raise InputError("fitting.no_covariance", covariance=options.covariance, colours=", ".join(_COLOURS))
    prior = None if options.prior is None else read_body_prior(Path(options.prior), base)
    if options.estimator == JOINT:
        if prior is not None:
            raise InputError("fitting.prior_used_estimators_ridge", prior=options.prior)
        return Choice(JOINT, None, colour, None)
    if options.estimator not in estimator_ids():
        raise InputError(
            "fitting.no_estimator", estimator=options.estimator, joint=", ".join(sorted((JOINT, *estimator_ids())))
        )
    found = estimator(options.estimator)
    # What it cannot do without is missed now and not after the recordings are prepared; rows come later.
    within(found, StageTwo(geometry, base, colour, prior))
    return Choice(options.estimator, found, colour, prior)


def choice(session: Session) -> Choice:
    """Load the estimator of the session's options (:func:`chosen`)."""
    return chosen(session.options, session.base, geometry_of(session.machine))


def rigid_body_stage(session: Session, results: StageResults, progress: Progress) -> RigidBody:
    """Run stage 2 with friction frozen, and the one-shot regression beside it."""
    design, cylinders = session.plain.design, results[Cylinders].cylinders
    asked = choice(session)
    two_stage = identify_rigid_body(design, cylinders, asked.estimator, colour=asked.colour, prior=asked.prior)
    progress(0.5, Sentence("fitting.shot_regression_comparison"))
    result = RigidBody(
        two_stage=_stacked(design, two_stage),
        one_shot=_stacked(design, identify_one_shot(design, colour=asked.colour)),
    )
    if two_stage.estimator != "ols":  # order of work is compared with the same least squares on both sides
        by_ols = identify_rigid_body(design, cylinders, colour=asked.colour)
        result = replace(result, two_stage_ols=_stacked(design, by_ols))
    if design.indices("unloaded"):
        with_unloaded = identify_one_shot(design, unloaded=True, colour=asked.colour)
        result = replace(result, one_shot_with_unloaded=_stacked(design, with_unloaded))
    return result


def _stacked(design: Design, estimate: StackedEstimate, extra: Extra | None = None) -> Stacked:
    """Return an estimate with errors by role and joint in the joint's effort unit."""
    errors, _, relative = errors_of(design, estimate.theta, extra)
    return Stacked(
        estimator=estimate.estimator,
        details=dict(estimate.details),
        theta=estimate.theta,
        std=np.where(np.isfinite(estimate.std), estimate.std, 0.0),
        determined=estimate.determined,
        condition_number=float(estimate.condition_number),
        errors=errors,
        relative=relative,
    )


def estimated(session: Session, model: Model) -> tuple[Model, Stacked | None]:
    """Return the final model: by the estimator asked for, and its remarks (None of the joint refit).

    An estimator gives the base parameters; everything else is as the joint refit has it.
    """
    asked = choice(session)
    if asked.estimator is None:
        return model, None
    found = refit_rigid_body(
        model.design,
        model.fit.theta,
        model.fit.covariance,
        asked.estimator,
        extra=model.extra,
        colour=asked.colour,
        prior=asked.prior,
    )
    fit = replace(model.fit, theta=found.theta, covariance=found.covariance, determined=found.determined, share=None)
    return replace(model, fit=fit), _stacked(model.design, found, model.extra)


def comparison(session: Session, found: RigidBody, floor: FloatArray) -> dict[str, Any]:
    """Compare hierarchical with one-shot on uncorrected recordings (:func:`fitting.pipeline.comparison.compare`)."""
    design, fit = session.plain.design, session.base_model.fit
    first = found.two_stage_ols or found.two_stage
    worst = stage_condition(cylinder_conditions(design), first.condition_number)
    contenders: dict[str, Stacked | Fit] = {
        "hierarchical": replace(first, condition_number=worst),
        "one_shot": found.one_shot,
    }
    if found.one_shot_with_unloaded is not None:
        contenders["one_shot_with_unloaded"] = found.one_shot_with_unloaded
    return compare(design, contenders | {"joint_refit": fit}, floor, np.random.default_rng(21))
