"""Stage 2 as a step of the pipeline, the final refit by its estimator, and the comparison with the one-shot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.messages import Sentence
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry, geometry_of
from fitting.arrays import FloatArray
from fitting.estimators import Colour, Estimator, StageTwo, estimator, estimator_ids, within
from fitting.loop.session import Options, Session
from fitting.pipeline.comparison import compare, cylinder_conditions, stage_condition
from fitting.pipeline.results.stage_results import Cylinders, RigidBody, Stacked, StageResults
from fitting.pipeline.rigid_body_stage import StackedEstimate, identify_one_shot, identify_rigid_body, refit_rigid_body
from fitting.pipeline.stage_names import Progress
from fitting.regression.body_prior import BodyPrior, read_body_prior
from fitting.regression.design import Design, Extra
from fitting.regression.error_sizes import errors_of
from fitting.regression.solving import Fit
from fitting.residual.terms import Model

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
        two_stage=stacked(design, two_stage),
        one_shot=stacked(design, identify_one_shot(design, colour=asked.colour)),
    )
    if two_stage.estimator != "ols":  # order of work is compared with the same least squares on both sides
        by_ols = identify_rigid_body(design, cylinders, colour=asked.colour)
        result = replace(result, two_stage_ols=stacked(design, by_ols))
    if design.indices("unloaded"):
        with_unloaded = identify_one_shot(design, unloaded=True, colour=asked.colour)
        result = replace(result, one_shot_with_unloaded=stacked(design, with_unloaded))
    return result


def stacked(design: Design, estimate: StackedEstimate, extra: Extra | None = None) -> Stacked:
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
    return replace(model, fit=fit), stacked(model.design, found, model.extra)


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
