"""From stage results to the report's content and what its figures draw."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from daq.machine.machine_file import Machine
from daq.messages import Sentence, with_messages
from fitting.arrays import FloatArray
from fitting.loop.refits import final_model
from fitting.loop.session import Session
from fitting.pipeline.check_gate import for_report
from fitting.pipeline.results.loop_content import loop_content
from fitting.pipeline.results.loop_results import Attributed
from fitting.pipeline.results.stage_results import (
    Checked,
    Cylinders,
    Errors,
    Fitted,
    Refitted,
    Residual,
    RigidBody,
    Stacked,
    StageResults,
)
from fitting.pipeline.stage_two import estimated
from fitting.regression.drive import drive_units, effort_unit
from fitting.regression.error_sizes import in_floors
from fitting.regression.flags import mark
from fitting.regression.identifiability import ParameterVerdict, parameter_verdicts, statement
from fitting.report.drawing_data import diagnostics, friction_curves, scatters, worst_seconds
from fitting.report.joint_words import in_words_of
from fitting.report.languages import NAMES
from fitting.report.model import Figures
from fitting.residual.lines import Line, is_ripple
from fitting.residual.stored_terms import corrections_from_json
from fitting.residual.terms import Model

#: What the joint refit's weights make it, and its deviations.
_ESTIMATORS = {"whitened": "gls", "equal": "joint_ols"}
_COVARIANCES = {"whitened": "whitened", "equal": "hac"}
#: Share of a parameter's information from the data below which it is reported to be from the prior.
MOSTLY_PRIOR = 0.5
#: Times the training error from which on the motion of ``validate`` is reported to go beyond what was trained on.
BEYOND = 2.0


def final_fit(session: Session, results: StageResults) -> Model:
    """Make the final fit with everything that was found again, from the stages' results."""
    corrections = corrections_from_json(session.machine, results[Residual].steps)
    return estimated(session, final_model(session, corrections, results[Attributed].terms)[1].model)[0]


def build_report(session: Session, results: StageResults, final: Model | None = None) -> tuple[dict[str, Any], Figures]:
    """Build report.json's content (DESIGN 6) and the page's figures.

    Parameters
    ----------
    session, results : the identification, and what its stages found
    final : of :func:`final_fit`, which is called if None
    """
    model = final or final_fit(session, results)
    checked, refitted = results[Checked], results[Refitted]
    content = {
        "schema": "hilfit/report/1",
        "machine": session.machine.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": {
            "hilfit": version("hilfit"),
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "scipy")},
        },
        "data": [
            {
                "role": recording.role,
                "file": recording.file,
                "sha256": recording.sha256,
                "samples": len(recording),
                "events": [asdict(event) for event in recording.events],
            }
            for recording in session.recordings
        ],
        "bandwidth_hz": checked.bandwidth_hz,
        "noise_floor_method": "repeat" if results[Residual].measured else "estimated",
        "self_check": {"regressor_against_newton_euler": checked.self_check},
        "reduction": {
            "standard_parameters": checked.standard_parameters,
            "base_parameters": checked.base_parameters,
        },
        "cylinders": _cylinders(session, results),
        "rigid_body": _rigid_body(session, results),
        "one_shot": _one_shot(session, results),
        "errors": _errors(session, results),
        "overall": refitted.overall,
        "loop": loop_content(session, results, model),
        "estimation": refitted.estimation,
        "plausibility": _plausibility(session, results),
        "parameter_shifts": _shifts(session, results),
        "identifiability": [own.to_json() for own in _parameter_verdicts(session)],
        "checks": for_report(checked.findings),
        "warnings": _warnings(session, results),
    }
    content = with_messages(content, results.messages)
    for part in ("loop", "estimation", "plausibility", "warnings"):
        content[part] = in_words_of(session.machine, content[part])
    mark(content)
    return content, _figures(session, results, model)


def _plausibility(session: Session, results: StageResults) -> dict[str, Any]:
    """List parameters that cannot be, and beside them the fit that keeps to what can."""
    found = results[Refitted].plausibility
    if found.constrained is None:
        return {"violations": []}
    constrained, names = found.constrained, session.plain.design.parameters.names
    parameters = [
        {"name": name, "value": value, "free": free}
        for name, value, free in zip(names, constrained.theta, results[Refitted].after.theta, strict=False)
    ]
    return {
        "violations": list(found.violations),
        "constrained": {
            "errors": _by_joint(session, constrained.errors),
            "price_percent": constrained.price_percent,
            "parameters": parameters,
        },
    }


def _cylinders(session: Session, results: StageResults) -> dict[str, Any]:
    refit = results[Refitted]
    cylinders = {}
    for number, (joint, first) in enumerate(zip(session.machine.joints, results[Cylinders].cylinders, strict=True)):
        part = session.plain.design.parameters.drive_slice(number)
        units = drive_units(joint)
        cylinders[joint.name] = {
            "parameters": _values(
                first.names, refit.after.theta[part], refit.after.std[part], units, refit.after.share[part]
            ),
            "residual_std": refit.drive_residual_std[number],
            "unit": effort_unit(joint),
            "stage_1": _values(first.names, first.theta, first.std, units),
            "stage_1_residual_std": first.residual_std,
            "stage_1_in_situ": first.in_situ,
        }
    return cylinders


def _values(
    names: Sequence[str], theta: FloatArray, std: FloatArray, units: Mapping[str, str], share: FloatArray | None = None
) -> dict[str, Any]:
    """Return values by name; where the data add less than the prior, a share instead of a deviation."""
    shares = [{}] * len(names) if share is None else [_data_share(own) for own in share.tolist()]
    return {
        name: {"value": value, "std": deviation, "unit": units[name], **own}
        for name, value, deviation, own in zip(names, theta.tolist(), std.tolist(), shares, strict=True)
    }


def _data_share(share: float) -> dict[str, Any]:
    """Return a parameter's content beside its value: the share of information from data."""
    return {"told_by_data": share, **({"std": None} if share < MOSTLY_PRIOR else {})}


def _rigid_body(session: Session, results: StageResults) -> dict[str, Any]:
    base, first = session.base, session.plain.design.parameters.base_slice.start
    refit, two_stage = results[Refitted], results[RigidBody].two_stage
    chosen, final, parameters = refit.chosen, refit.after, list[dict[str, Any]]()
    for number, place in enumerate(range(first, first + len(base))):
        own: dict[str, Any] = {"name": base.names[number], "expression": base.expressions[number]}
        own |= _at(final, place) if final.determined[place] else {"value": None, "std": None}
        own |= {"unit": base.units[number], "stage_2": _at(two_stage, place)}
        own |= {"joint_refit": _at(refit.joint, place)} if chosen else _data_share(float(final.share[place]))
        parameters.append(own)
    return {
        "estimator": chosen.estimator if chosen else _ESTIMATORS[refit.weights],
        "covariance": session.options.covariance if chosen else _COVARIANCES[refit.weights],
        "condition_number": (chosen or refit).condition_number,
        "parameters": parameters,
        "stage_2": {"estimator": two_stage.estimator, "condition_number": two_stage.condition_number},
        **(_price(session, results, chosen) if chosen else {}),
    }


def _at(fitted: Fitted | Stacked, place: int) -> dict[str, Any]:
    return {"value": float(fitted.theta[place]), "std": float(fitted.std[place])}


def _price(session: Session, results: StageResults, chosen: Stacked) -> dict[str, Any]:
    """Return the cost in error of the estimator asked for against the joint refit, and its remarks."""
    joint_refit, floor = results[Refitted].errors["joint"], results[Residual].noise_floor
    price = {}
    for role in ("train", "validate"):
        own, other = (in_floors(errors[role], floor) for errors in (chosen.errors, joint_refit))
        if own is not None and other is not None:
            price[role] = 100.0 * (own / other - 1.0)
    return {"errors": _by_joint(session, chosen.errors), "price_percent": price, "details": chosen.details}


def _by_joint(session: Session, errors: Errors) -> dict[str, dict[str, float | None]]:
    """Return each joint's error sizes."""
    return {
        joint.name: {key: values[number] for key, values in errors.items()}
        for number, joint in enumerate(session.machine.joints)
    }


def _one_shot(session: Session, results: StageResults) -> dict[str, Any]:
    one_shot = results[RigidBody].one_shot
    return {
        "comparison": results[Refitted].comparison,
        "condition_number": one_shot.condition_number,
        "errors": _by_joint(session, one_shot.errors),
        "relative": one_shot.relative,
    }


def _errors(session: Session, results: StageResults) -> dict[str, Any]:
    errors, residual = results[Refitted].errors, results[Residual]
    before, after = _by_joint(session, errors["before"]), _by_joint(session, errors["after"])
    two_stage = _by_joint(session, results[RigidBody].two_stage.errors)
    return {
        joint.name: {
            "unit": joint.effort_unit,
            "noise_floor": residual.noise_floor[number],
            "noise_floor_valid": residual.floor_valid[number],
            "before": before[joint.name],
            "after": after[joint.name],
            "two_stage": two_stage[joint.name],
            "validate_predicted_std": results[Refitted].predicted_std[number],
        }
        for number, joint in enumerate(session.machine.joints)
    }


def _shifts(session: Session, results: StageResults) -> list[dict[str, Any]]:
    parameters = session.plain.design.parameters
    before, after = results[Refitted].before, results[Refitted].after
    shifts = []
    for number, name in enumerate(parameters.names):
        if not (before.determined[number] and after.determined[number]):
            continue
        first, second, std = (float(v[number]) for v in (before.theta, after.theta, after.std))
        shifts.append(
            {"name": name, "before": first, "after": second, "sigmas": (second - first) / std if std > 0 else None}
        )
    return shifts


def _warnings(session: Session, results: StageResults) -> list[str]:
    notes = dict.fromkeys(note for recording in session.recordings for note in recording.notes)
    warnings = [*notes, *session.left_out, *results[Attributed].warnings]
    if not results[Residual].measured:
        warnings.append(Sentence("fitting.no_repeated_motion_noise"))
    if not session.plain.validate:
        warnings.append(Sentence("fitting.no_validation_motion_errors"))
    cylinders = results[Cylinders].cylinders
    if still := [c.joint for c in cylinders if c.rows == 0]:
        warnings.append(Sentence("fitting.never_moved_nothing_known", joints=still))
    if refused := [c.joint for c in cylinders if c.refused]:
        warnings.append(Sentence("fitting.stage_arm_attached_refused", joints=refused))
    warnings += _in_situ_warnings(session, [c.joint for c in cylinders if c.in_situ and c.rows > 0 and not c.refused])
    parameters = session.plain.design.parameters
    undetermined = [n for n, own in zip(parameters.names, results[Refitted].after.determined, strict=False) if not own]
    if undetermined:
        warnings.append(Sentence("fitting.motion_cannot_tell", parameters=undetermined))
    warnings += _beyond_training(session, results)
    changed = NAMES["parameters"] | NAMES["changed"]
    for change in results[Attributed].changes:
        joint, parameter = session.machine.joints[change.joint].name, changed.get(change.column, change.column)
        where: dict[str, Any] = {} if change.recording is None else {"recording": change.recording + 1}
        if change.time < 1.0:
            code = "fitting.changed_at_beginning" if where else "fitting.changed_at_every_beginning"
        else:
            code, where["seconds"] = "fitting.changed_into" if where else "fitting.changed_into_every", change.time
        warnings.append(Sentence(code, joint=joint, parameter=parameter, **where))
    lines = (line for line in results[Attributed].lines if not is_ripple(session.machine, line))
    warnings += [_line_warning(session.machine, line) for line in lines]
    if session.plain.design.indices("operation"):
        warnings.append(statement(_parameter_verdicts(session)))
    return warnings


def _beyond_training(session: Session, results: StageResults) -> list[str]:
    """List joints whose error on ``validate`` was expected to exceed that on the fitted motion by far."""
    refitted, key = results[Refitted], "fitting.validate_moves_where_training"
    joints = zip(session.machine.joints, refitted.predicted_std, refitted.errors["after"]["train"], strict=True)
    return [
        Sentence(key, joint=joint.name, std=std, unit=joint.effort_unit, trained=trained)
        for joint, std, trained in joints
        if std is not None and trained is not None and std > BEYOND * trained
    ]


def _in_situ_warnings(session: Session, joints: Sequence[str]) -> list[str]:
    """Explain why friction of these joints was estimated with the arm attached."""
    unloaded = any(recording.role == "unloaded" for recording in session.recordings)
    hidden = set(session.machine.unseen_pistons()) if unloaded else set()
    reasons = (
        ([j for j in joints if j not in hidden], Sentence("fitting.no_unloaded_recording")),
        ([j for j in joints if j in hidden], Sentence("fitting.rods_off_piston_position_channel")),
    )
    return [Sentence("fitting.friction_with_arm_attached", joints=own, why=why) for own, why in reasons if own]


def _line_warning(machine: Machine, line: Line) -> str:
    """Advise on a spectral line where no pump can have made it."""
    joint = machine.joints[line.joint]
    return Sentence(
        "fitting.effort_oscillates",
        joint=joint.name,
        frequency_hz=line.frequency_hz,
        amplitude=line.amplitude,
        unit=effort_unit(joint),
    )


def _parameter_verdicts(session: Session) -> tuple[ParameterVerdict, ...]:
    plain = session.plain
    theta = session.weighted_base.model.fit.theta
    return parameter_verdicts(plain.design, plain.noise, plain.fitted, theta, session.base_model.prior)


def _figures(session: Session, results: StageResults, model: Model) -> Figures:
    before = estimated(session, session.base_with(results[Refitted].weights))[0]
    shown = session.plain.validate or session.plain.design.indices("train", "operation")
    return Figures(
        scatter=scatters(before, model, shown),
        worst=worst_seconds(before, model, shown, results[Residual].noise_floor),
        friction=friction_curves(before, model),
        diagnostics=diagnostics(before, model, shown),
    )
