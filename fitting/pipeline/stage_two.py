"""Stage 2 as a step of the pipeline: what it, the final refit and the comparison with the one-shot give, as JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.arm.geometry import geometry_of
from fitting.loop.session import Session
from fitting.pipeline.comparison import Contender, compare, cylinder_conditions, stage_condition
from fitting.pipeline.cylinder_stage import CylinderEstimate
from fitting.pipeline.estimator_choice import Choice, chosen
from fitting.pipeline.rigid_body_stage import StackedEstimate, identify_one_shot, identify_rigid_body, refit_rigid_body
from fitting.regression.design import Design, Extra
from fitting.regression.error_sizes import errors_of
from fitting.residual.terms import Model

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[float, str], None]
Results = Mapping[str, dict[str, Any]]

#: Names of the ways to the parameters, and the keys of stage 2's results that hold them.
_WAYS = {"hierarchical": "two_stage", "one_shot": "one_shot", "one_shot_with_unloaded": "one_shot_with_unloaded"}


def choice(session: Session) -> Choice:
    """The estimator that the session's options ask for (:func:`fitting.pipeline.estimator_choice.chosen`)."""
    return chosen(session.options, session.base, geometry_of(session.machine))


def rigid_body_stage(session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """Stage 2 with friction frozen, and the one-shot regression beside it."""
    design = session.plain.design
    cylinders = [
        CylinderEstimate(
            c["joint"],
            tuple(c["names"]),
            np.array(c["theta"]),
            np.array(c["std"]),
            c["residual_std"],
            c["in_situ"],
            c["rows"],
            None if c["covariance"] is None else np.array(c["covariance"]),
        )
        for c in results["cylinder_stage"]["cylinders"]
    ]
    asked = choice(session)
    two_stage = identify_rigid_body(design, cylinders, asked.estimator, colour=asked.colour, prior=asked.prior)
    progress(0.5, "one-shot regression for comparison")
    result = {
        "two_stage": stacked(session, two_stage),
        "one_shot": stacked(session, identify_one_shot(design, colour=asked.colour)),
    }
    if two_stage.estimator != "ols":  # order of work is compared with the same least squares on both sides
        result["two_stage_ols"] = stacked(session, identify_rigid_body(design, cylinders, colour=asked.colour))
    if design.indices("unloaded"):
        result["one_shot_with_unloaded"] = stacked(
            session, identify_one_shot(design, unloaded=True, colour=asked.colour)
        )
    return result


def stacked(session: Session, estimate: StackedEstimate) -> dict[str, Any]:
    """An estimate on the uncorrected recordings (:func:`stacked_on`)."""
    return stacked_on(session.plain.design, estimate)


def stacked_on(design: Design, estimate: StackedEstimate, extra: Extra | None = None) -> dict[str, Any]:
    """An estimate as JSON, with its errors per role and joint in the joint's effort unit."""
    errors, _, relative = errors_of(design, estimate.theta, extra)
    deviations = np.where(np.isfinite(estimate.std), estimate.std, 0.0)
    return {
        "estimator": estimate.estimator,
        "details": dict(estimate.details),
        "theta": estimate.theta.tolist(),
        "std": deviations.tolist(),
        "told": estimate.told.tolist(),
        "condition_number": estimate.condition_number,
        "errors": errors,
        "relative": relative,
    }


def chosen_refit(session: Session, design: Design, model: Model) -> dict[str, Any] | None:
    """Base parameters by the estimator asked for, everything else as the joint refit has it; None if that is asked."""
    asked = choice(session)
    if asked.estimator is None:
        return None
    estimate = refit_rigid_body(
        design,
        model.fit.theta,
        model.fit.covariance,
        asked.estimator,
        extra=model.extra,
        colour=asked.colour,
        prior=asked.prior,
    )
    return stacked_on(design, estimate, model.extra)


def comparison(session: Session, results: Results, floor: FloatArray) -> dict[str, Any]:
    """Hierarchical against one-shot on the uncorrected recordings (:func:`fitting.pipeline.comparison.compare`)."""
    design, fit = session.plain.design, session.base_model.fit
    found = results["rigid_body_stage"]
    ways = _WAYS | ({"hierarchical": "two_stage_ols"} if "two_stage_ols" in found else {})
    contenders = {way: _contender(found[key]) for way, key in ways.items() if key in found}
    first = contenders["hierarchical"]
    worst = stage_condition(cylinder_conditions(design), first.condition_number)
    contenders["hierarchical"] = Contender(first.theta, first.std, first.told, worst)
    contenders["joint_refit"] = Contender(fit.theta, fit.std, fit.told, fit.condition_number)
    return compare(design, contenders, floor, np.random.default_rng(21))


def _contender(found: Mapping[str, Any]) -> Contender:
    told = np.array(found["told"], dtype=bool)
    return Contender(np.array(found["theta"]), np.array(found["std"]), told, found["condition_number"])


def std(errors: FloatArray) -> float | None:
    """Standard deviation, None of nothing."""
    return float(np.std(errors)) if len(errors) else None
