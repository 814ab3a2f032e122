"""From stage results to the report's content and what its figures draw."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from daq.machine_file import Machine
from fitting.effects import effect, line_effect
from fitting.loop.kinematic_check import corrections_from_json
from fitting.loop.residual_loop import final_model, term_from_json
from fitting.loop.session import Prepared, Session
from fitting.pipeline.check_gate import for_report
from fitting.pipeline.cylinder_stage import MOST_CONDITION
from fitting.pipeline.verdict import verdict
from fitting.regression.drive import UNITS, direct_units, effort_unit
from fitting.regression.flags import mark
from fitting.regression.identifiability import Telling, statement, tellings
from fitting.report.drawing_data import friction_curves, law_curve, scatters, worst_seconds
from fitting.report.joint_words import in_own_units, in_words_of, own_unit
from fitting.report.model import Figures
from fitting.report.residual_diagnostics import diagnostics
from fitting.residual.laws import Law
from fitting.residual.surfaces import second_variable
from fitting.residual.terms import Model, Term

Results = Mapping[str, dict[str, Any]]

SHAPE_UNITS = {"v_s": "m/s", "x_s": "m", "tau": "s", "pitch": "m", "frequency": "Hz", "t_0": "s"}
#: Shape entries that only say which variant of an effect it is.
_CHOICES = ("other", "law", "parameter", "chamber", "odd", "side", "recording", "head", "rod")
#: Where play is (shape ``sensor``), by the efforts; None of all other effects.
_PLACES = {
    None: "",
    0.0: "; the efforts follow the piston's own speed, so the play is in a pin",
    1.0: "; the efforts follow the joint's speed, so the play is in the piston's sensor",
}
#: What the joint refit's weights make it, and its deviations.
_ESTIMATORS = {"whitened": "gls", "equal": "joint_ols"}
_COVARIANCES = {"whitened": "whitened", "equal": "hac"}
_EVIDENCE = ("score", "gain", "held_out_gain", "held_out_z", "validate_gain", "surviving", "witness", "cutoffs")
_CHANGED = {
    "1": "the zero of the effort",
    "f_c": "Coulomb friction",
    "f_v": "viscous friction",
    "K": "stiffness",
    "load": "the load",
}


@dataclass(frozen=True)
class Final:
    """The final fit with everything that was found.

    Attributes
    ----------
    steps : of the kinematic corrections, as JSON
    terms : effects and laws
    prepared, model : design and fit
    """

    steps: tuple[Mapping[str, Any], ...]
    terms: list[Term]
    prepared: Prepared
    model: Model


def final_fit(session: Session, results: Results) -> Final:
    """The final fit again, from what the stages left."""
    terms = [term_from_json(a["term"]) for a in results["attribution"]["accepted"]]
    steps = tuple(step for f in results["residual"]["kinematics"] for step in f["steps"])
    prepared, final = final_model(session, corrections_from_json(session, steps), terms)
    return Final(steps, terms, prepared, final.model)


def build_report(session: Session, results: Results, final: Final | None = None) -> tuple[dict[str, Any], Figures]:
    """Content of report.json (DESIGN 6) and the data of the page's figures; the ``final`` fit is made if not given."""
    final = final or final_fit(session, results)
    terms, prepared, model = final.terms, final.prepared, final.model
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
        "bandwidth_hz": results["check"]["bandwidth_hz"],
        "noise_floor_method": "repeat" if results["residual"]["measured"] else "estimated",
        "self_check": {"regressor_against_newton_euler": results["check"]["self_check"]},
        "reduction": {
            "standard_parameters": results["check"]["standard_parameters"],
            "base_parameters": results["check"]["base_parameters"],
        },
        "cylinders": _cylinders(session, results),
        "rigid_body": _rigid_body(session, results),
        "one_shot": _one_shot(session, results),
        "errors": _errors(session, results),
        "overall": results["refit"]["overall"],
        "loop": _loop(session, results, model, terms),
        "estimation": results["refit"]["estimation"],
        "plausibility": _plausibility(session, results),
        "parameter_shifts": _shifts(session, results),
        "identifiability": _identifiability(session),
        "checks": for_report(results["check"].get("findings", [])),
        "warnings": _warnings(session, results),
    }
    for part in ("loop", "estimation", "plausibility", "warnings"):
        content[part] = in_words_of(session.machine, content[part])
    mark(content)
    return content, _figures(session, results, prepared, model, terms)


def _plausibility(session: Session, results: Results) -> dict[str, Any]:
    """Parameters that cannot be, and beside them the fit that keeps to what can."""
    found = results["refit"]["plausibility"]
    if "constrained" not in found:
        return {"violations": []}
    constrained, names = found["constrained"], session.plain.design.parameters.names
    errors = {
        joint.name: {key: values[number] for key, values in constrained["errors"].items()}
        for number, joint in enumerate(session.machine.joints)
    }
    parameters = [
        {"name": name, "value": value, "free": free}
        for name, value, free in zip(names, constrained["theta"], results["refit"]["after"]["theta"], strict=False)
    ]
    return {
        "violations": found["violations"],
        "constrained": {"errors": errors, "price_percent": constrained["price_percent"], "parameters": parameters},
    }


def _cylinders(session: Session, results: Results) -> dict[str, Any]:
    refit = results["refit"]
    cylinders = {}
    for number, (joint, first) in enumerate(
        zip(session.machine.joints, results["cylinder_stage"]["cylinders"], strict=True)
    ):
        part = session.plain.design.parameters.drive_slice(number)
        units = UNITS if joint.cylinder is not None else direct_units(joint.effort_unit)
        cylinders[joint.name] = {
            "parameters": _values(first["names"], refit["after"]["theta"][part], refit["after"]["std"][part], units),
            "residual_std": refit["drive_residual_std"][number],
            "unit": effort_unit(joint),
            "stage_1": _values(first["names"], first["theta"], first["std"], units),
            "stage_1_residual_std": first["residual_std"],
            "stage_1_in_situ": first["in_situ"],
        }
    return cylinders


def _values(names: Any, theta: Any, std: Any, units: Mapping[str, str]) -> dict[str, Any]:
    return {
        name: {"value": value, "std": deviation, "unit": units[name]}
        for name, value, deviation in zip(names, theta, std, strict=True)
    }


def _rigid_body(session: Session, results: Results) -> dict[str, Any]:
    base = session.base
    part = session.plain.design.parameters.base_slice
    refit, two_stage = results["refit"], results["rigid_body_stage"]["two_stage"]
    chosen = refit.get("chosen")
    final = chosen or refit["after"]
    joint_refit = _values_of(refit["after"], part) if chosen else [{}] * len(base)
    return {
        "estimator": chosen["estimator"] if chosen else _ESTIMATORS[refit["weights"]],
        "covariance": session.options.covariance if chosen else _COVARIANCES[refit["weights"]],
        "condition_number": (chosen or refit)["condition_number"],
        "parameters": [
            {
                "name": name,
                "expression": expression,
                "value": value if told else None,
                "std": std if told else None,
                "unit": unit,
                "stage_2": {"value": first, "std": first_std},
                **({"joint_refit": joint} if joint else {}),
            }
            for name, expression, unit, value, std, told, first, first_std, joint in zip(
                base.names,
                base.expressions,
                base.units,
                final["theta"][part],
                final["std"][part],
                final["told"][part],
                two_stage["theta"][part],
                two_stage["std"][part],
                joint_refit,
                strict=True,
            )
        ],
        "stage_2": {"estimator": two_stage["estimator"], "condition_number": two_stage["condition_number"]},
        **(_price(session, results, chosen) if chosen else {}),
    }


def _values_of(estimate: Mapping[str, Any], part: slice) -> list[dict[str, Any]]:
    return [{"value": v, "std": s} for v, s in zip(estimate["theta"][part], estimate["std"][part], strict=True)]


def _price(session: Session, results: Results, chosen: Mapping[str, Any]) -> dict[str, Any]:
    """What the estimator asked for costs in error against the joint refit, and what it had to say."""
    after = results["refit"]["errors"]["after"]
    errors = {
        joint.name: {key: values[number] for key, values in chosen["errors"].items()}
        for number, joint in enumerate(session.machine.joints)
    }
    price = {}
    for role in ("train", "validate"):
        pairs = [
            (a, b, f)
            for a, b, f in zip(chosen["errors"][role], after[role], results["residual"]["noise_floor"], strict=True)
            if a is not None and b is not None and f > 0
        ]
        if pairs:
            own, other = (np.mean([(pair[k] / pair[2]) ** 2 for pair in pairs]) for k in (0, 1))
            price[role] = float(100.0 * (np.sqrt(own / other) - 1.0))
    return {"errors": errors, "price_percent": price, "details": chosen["details"]}


def _one_shot(session: Session, results: Results) -> dict[str, Any]:
    one_shot = results["rigid_body_stage"]["one_shot"]
    comparison = results["refit"].get("comparison")
    return {
        **({"comparison": comparison} if comparison else {}),
        "condition_number": one_shot["condition_number"],
        "errors": {
            joint.name: {key: values[number] for key, values in one_shot["errors"].items()}
            for number, joint in enumerate(session.machine.joints)
        },
        "relative": one_shot["relative"],
    }


def _errors(session: Session, results: Results) -> dict[str, Any]:
    errors = results["refit"]["errors"]
    two_stage = results["rigid_body_stage"]["two_stage"]["errors"]
    floor = results["residual"]["noise_floor"]
    return {
        joint.name: {
            "unit": joint.effort_unit,
            "noise_floor": floor[number],
            "noise_floor_valid": results["residual"]["floor_valid"][number],
            "before": {key: values[number] for key, values in errors["before"].items()},
            "after": {key: values[number] for key, values in errors["after"].items()},
            "two_stage": {key: values[number] for key, values in two_stage.items()},
        }
        for number, joint in enumerate(session.machine.joints)
    }


def _loop(session: Session, results: Results, model: Model, terms: list[Term]) -> dict[str, Any]:
    machine = session.machine
    names = [joint.name for joint in machine.joints]
    found, effects, unexplained = results["attribution"], [], []
    for finding in results["residual"]["kinematics"]:
        effects.append(_kinematic_effect(machine, finding))
    for number, (term, accepted) in enumerate(zip(terms, found["accepted"], strict=True)):
        evidence = {key: accepted[key] for key in _EVIDENCE if accepted[key] not in (None, "", [])}
        if accepted["null"] is not None:
            evidence |= {"replicas": accepted["null"]["draws"], "inflation": accepted["null"]["inflation"]}
        part = model.term_slice(number)
        if isinstance(term.content, Law):
            unexplained.append(
                in_own_units(
                    machine,
                    {
                        "joint": names[term.joint or 0],
                        "variable": term.content.variable(tuple(names)),
                        "times_sign_of_speed": term.content.signed,
                        **second_variable(term.content, tuple(names)),
                        "law": law_curve(term.content, model, part),
                        "unit": term.content.unit,
                        "amplitude": _amplitude(model, number),
                        "added": True,
                        "probability": accepted.get("probability"),
                        "could_be": _rivals(accepted, names),
                        "evidence": evidence,
                    },
                )
            )
            continue
        effects.append(
            {
                "id": term.id,
                "joint": None if term.joint is None else names[term.joint],
                "title": term.content.title,
                "equation": term.content.equation,
                "look_at": term.content.look_at,
                "parameters": _term_parameters(term, model, part, machine),
                "amplitude": _amplitude(model, number),
                "indistinguishable_from": _rivals(accepted, names),
                "probability": accepted.get("probability"),
                "evidence": evidence,
            }
        )
    effects += [_line_effect(names, line) for line in found["lines"] if line["ripple"] and not line["in_band"]]
    unexplained += [
        in_own_units(machine, {**item, "joint": names[item["joint"]], "added": False}) for item in found["unconfirmed"]
    ]
    said, reasons = verdict(results, names)
    experiment = found["next_experiment"]
    if experiment is not None:
        experiment = {key: value for key, value in experiment.items() if key != "program"}
    return {
        "verdict": said,
        "reasons": reasons,
        "effects": effects,
        "unexplained": unexplained,
        "candidates": [
            {
                "id": finding["steps"][0]["effect"],
                "joint": names[finding["steps"][0]["joint"]],
                "score": finding["score"],
                "status": "accepted",
                "reason": f"the two position sensors disagree by {finding['gap_before'] * 1e3:.3g} mm, afterwards by "
                f"{finding['gap_after'] * 1e3:.3g} mm{_PLACES[finding['steps'][0]['shape'].get('sensor')]}",
            }
            for finding in results["residual"]["kinematics"]
        ]
        + [
            {**c, "title": effect(c["id"]).title, "joint": None if c["joint"] is None else names[c["joint"]]}
            for c in found["candidates"]
        ],
        "detection_limits": [
            {
                **limit,
                "title": effect(limit["id"]).title,
                "joint": None if limit["joint"] is None else names[limit["joint"]],
                "unit": own_unit(machine, limit["joint"], limit["unit"]),
            }
            for limit in found["limits"]
        ],
        "hypotheses": _hypotheses(found["hypotheses"], names),
        "changes": found["changes"],
        "looked": found.get("looked", True),
        "next_experiment": experiment or _next_experiment(effects),
        "resolution": [
            {**step, "before": _hypotheses(step["before"], names), "after": _hypotheses(step["after"], names)}
            for step in results.get("resolution", {}).get("steps", [])
        ],
    }


def _rivals(accepted: Mapping[str, Any], names: Sequence[str]) -> list[dict[str, Any]]:
    """Effects that explain the same, with their probabilities."""
    return [
        {
            "id": r["id"],
            "title": effect(r["id"]).title,
            "joint": None if r["joint"] is None else names[r["joint"]],
            "probability": r.get("probability"),
        }
        for r in accepted["rivals"]
    ]


def _hypotheses(found: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[dict[str, Any]]:
    """Explanations of the efforts, the most probable first; one without effects and laws is "nothing"."""
    result = []
    for hypothesis in found:
        terms = [term_from_json(term) for term in hypothesis["terms"]]
        places = [None if term.joint is None else names[term.joint] for term in terms]
        both = list(zip(terms, places, strict=True))
        result.append(
            {
                "effects": [{"id": t.id, "joint": place} for t, place in both if not isinstance(t.content, Law)],
                "laws": [
                    {
                        "joint": place,
                        "variable": t.content.variable(tuple(names)),
                        "times_sign_of_speed": t.content.signed,
                    }
                    for t, place in both
                    if isinstance(t.content, Law)
                ],
                "probability": hypothesis["probability"],
            }
        )
    return result


def _kinematic_effect(machine: Machine, finding: Mapping[str, Any]) -> dict[str, Any]:
    first = finding["steps"][0]
    content = effect(first["effect"])
    joint = machine.joints[first["joint"]].name
    parameters: dict[str, Any] = {
        p.name: {"value": value, "std": std, "unit": own_unit(machine, first["joint"], p.unit)}
        for p, value, std in zip(content.parameters, finding["values"], finding["stds"], strict=True)
    }
    parameters.update(_shape_values(first["shape"], machine, first["joint"]))
    return {
        "id": content.id,
        "joint": joint,
        "title": content.title,
        "equation": content.equation,
        "look_at": content.look_at,
        "parameters": parameters,
        "indistinguishable_from": [
            {"id": rival, "title": effect(rival).title, "joint": joint, "probability": share}
            for rival, share in zip(finding["rivals"], finding["rival_probabilities"], strict=True)
        ],
        "probability": finding["probability"],
        "evidence": {key: finding[key] for key in ("score", "gain", "gap_before", "gap_after")},
    }


def _line_effect(names: list[str], line: Mapping[str, Any]) -> dict[str, Any]:
    """A spectral line above the identification band: named, but there is nothing to add."""
    content = line_effect()
    (frequency, frequency_std), (amplitude, amplitude_std) = line["frequency"], line["amplitude"]
    return {
        "id": content.id,
        "joint": names[line["joint"]],
        "title": content.title,
        "equation": content.equation,
        "look_at": content.look_at,
        "parameters": {
            "amplitude": {"value": amplitude, "std": amplitude_std, "unit": "N"},
            "frequency": {"value": frequency, "std": frequency_std, "unit": "Hz"},
        },
        "indistinguishable_from": [],
        "evidence": {"p": line["p"], "outside_band": True},
    }


def _term_parameters(term: Term, model: Model, part: slice, machine: Machine) -> dict[str, Any]:
    assert not isinstance(term.content, Law)
    other = term.shape.get("other")
    slides = other is not None and machine.joints[int(other)].type == "prismatic"
    rebuilt = term.rebuilt or (0.0,) * len(term.content.parameters)
    values = {
        p.name: {
            "value": float(value) + already,
            "std": float(std),
            # Per radian of another joint, or per metre where that one slides.
            "unit": own_unit(machine, term.joint, p.unit.replace("/rad", "/m") if slides else p.unit),
        }
        for p, value, std, already, told in zip(
            term.content.parameters,
            model.fit.theta[part],
            model.fit.std[part],
            rebuilt,
            model.fit.told[part],
            strict=True,
        )
        if told  # a column that the base takes whole has no value of its own
    }
    view = model.views[model.fitted[0]][term.joint or 0]
    references = {}
    for name, (value, unit) in term.content.references(view, term.shape).items():
        if other is not None:  # a pose of the other joint
            unit = unit.replace("rad", "m") if slides else unit
        else:
            unit = own_unit(machine, term.joint, unit)
        references[name] = {"value": value, "std": None, "unit": unit}
    return {**values, **_shape_values(term.shape, machine, term.joint), **references}


def _amplitude(model: Model, number: int) -> dict[str, Any]:
    """How large a term is over the motions that were fitted: a size that does not depend on what a formula counts from.

    ``largest`` is the 99th percentile of its magnitude over the moving samples, on the joint where it is largest; of a
    delay what is left of it after the efforts were moved.
    """
    machine = model.design.machine
    best = {"largest": 0.0, "rms": 0.0, "unit": "N", "joint": None}
    for joint, own in enumerate(machine.joints):
        if model.terms[number].joint not in (joint, None) and not model.terms[number].everywhere:
            continue
        parts = [
            model.contribution(number, joint, index)[~model.design.segments[index].rest[:, joint]]
            for index in model.fitted
        ]
        force = np.abs(np.concatenate(parts))
        if len(force) and np.quantile(force, 0.99) > best["largest"]:
            best = {
                "largest": float(np.quantile(force, 0.99)),
                "rms": float(np.sqrt(np.mean(force**2))),
                "unit": effort_unit(own),
                "joint": own.name,
            }
    return best


def _shape_values(shape: Mapping[str, float], machine: Machine, joint: int | None) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in shape.items():
        unit = own_unit(machine, joint, SHAPE_UNITS.get(key, "1"))
        if key == "other":
            values[f"other joint: {machine.joints[int(value)].name}"] = {"value": value, "std": None, "unit": "index"}
        elif key == "sensor":
            values[f"place: {'in the piston sensor' if value else 'in a pin'}"] = {
                "value": value,
                "std": None,
                "unit": "choice",
            }
        else:
            values[key] = {"value": value, "std": None, "unit": "choice" if key in _CHOICES else unit}
    return values


def _next_experiment(effects: list[dict[str, Any]]) -> dict[str, Any] | None:
    for entry in effects:
        if entry["indistinguishable_from"]:
            rivals = [r["id"] for r in entry["indistinguishable_from"]]
            return {
                "motion": effect(entry["id"]).experiment,
                "why": f"{entry['id']} and {', '.join(rivals)} leave the same trace in these recordings",
                "separates": [entry["id"], *rivals],
                "joint": entry["joint"],
            }
    return None


def _shifts(session: Session, results: Results) -> list[dict[str, Any]]:
    parameters = session.plain.design.parameters
    before, after = results["refit"]["before"], results["refit"]["after"]
    shifts = []
    for number, name in enumerate(parameters.names):
        if not (before["told"][number] and after["told"][number]):
            continue
        first, second, std = before["theta"][number], after["theta"][number], after["std"][number]
        shifts.append(
            {"name": name, "before": first, "after": second, "sigmas": (second - first) / std if std > 0 else None}
        )
    return shifts


def _warnings(session: Session, results: Results) -> list[str]:
    notes = dict.fromkeys(note for recording in session.recordings for note in recording.notes)
    warnings = [*notes, *session.left_out, *results["attribution"]["warnings"]]
    if not results["residual"]["measured"]:
        warnings.append(
            "no repeated motion: the noise floor is an estimate from residuals; record the training motion twice"
        )
    if not session.plain.validate:
        warnings.append("no validation motion: errors are those of the training motion, which was fitted")
    still = [c["joint"] for c in results["cylinder_stage"]["cylinders"] if c["rows"] == 0]
    if still:
        warnings.append(f"{', '.join(still)} never moved: nothing is known of its friction and stiffness")
    refused = [c for c in results["cylinder_stage"]["cylinders"] if c["refused"]]
    if refused:
        listed = ", ".join(f"{c['joint']} ({c['condition']:.3g})" for c in refused)
        warnings.append(
            f"stage 1 with the arm attached is refused for {listed}: the load looks like the drive there "
            f"(condition number above {MOST_CONDITION:g}); the values of the joint fit stand in its place"
        )
    in_situ = [
        c["joint"]
        for c in results["cylinder_stage"]["cylinders"]
        if c["in_situ"] and c["rows"] > 0 and not c["refused"]
    ]
    warnings += _in_situ_warnings(session, in_situ)
    parameters = session.plain.design.parameters
    untold = [n for n, told in zip(parameters.names, results["refit"]["after"]["told"], strict=False) if not told]
    if untold:
        warnings.append(f"this motion cannot tell {', '.join(untold)}; they are left at zero")
    for change in results["attribution"]["changes"]:
        warnings.append(
            f"{change['joint']}: {_CHANGED.get(change['of'], change['of'])} changed "
            + ("at the beginning of" if change["time"] < 1.0 else f"{change['time']:.1f} s into")
            + (" every recording" if change["recording"] is None else f" recording {change['recording'] + 1}")
        )
    warnings += [_line_warning(session.machine, line) for line in results["attribution"]["lines"] if not line["ripple"]]
    if session.plain.design.indices("operation"):
        warnings.append(statement(_tellings(session)))
    return warnings


def _in_situ_warnings(session: Session, joints: Sequence[str]) -> list[str]:
    """Why friction of these joints was estimated with the arm attached."""
    unloaded = any(recording.role == "unloaded" for recording in session.recordings)
    hidden = set(session.machine.unseen_pistons()) if unloaded else set()
    attached = "friction was estimated with the arm attached on"
    reasons = (
        ([j for j in joints if j not in hidden], "no unloaded recording of it"),
        ([j for j in joints if j in hidden], "with the rods off only a piston_position channel shows the piston"),
    )
    return [f"{attached} {', '.join(own)}: {why}" for own, why in reasons if own]


def _line_warning(machine: Machine, line: Mapping[str, Any]) -> str:
    """What to do about a spectral line where no pump can have made it."""
    joint = machine.joints[line["joint"]]
    return (
        f"{joint.name}: the effort oscillates at {line['frequency'][0]:.4g} Hz with an amplitude of "
        f"{line['amplitude'][0]:.3g} {effort_unit(joint)}, which no motion explains; without a cylinder it is "
        "no ripple of a pump: look at the controller, the power supply and resonances"
    )


def _tellings(session: Session) -> tuple[Telling, ...]:
    plain = session.plain
    theta = session.handed_base.model.fit.theta
    return tellings(plain.design, plain.noise, plain.fitted, theta, session.prior)


def _identifiability(session: Session) -> list[dict[str, Any]]:
    """What these recordings tell of every parameter."""
    return [
        {
            "name": t.name,
            "verdict": t.verdict,
            "std": t.std if np.isfinite(t.std) else None,
            "relative": t.relative if np.isfinite(t.relative) else None,
        }
        for t in _tellings(session)
    ]


def _figures(session: Session, results: Results, prepared: Prepared, model: Model, terms: list[Term]) -> Figures:
    before = session.base_with(results["refit"]["weights"])
    shown = session.plain.validate or session.plain.design.indices("train", "operation")
    return Figures(
        scatter=scatters(before, model, shown),
        worst=worst_seconds(before, model, shown, results["residual"]["noise_floor"]),
        friction=friction_curves(before, model),
        diagnostics=diagnostics(before, model, shown),
    )
