"""Findings of the loop, as ``loop`` of report.json.

What is reported of a finding whatever the final fit makes of its size is made when it is found, part of the stage's
result; :func:`loop_content` puts it together with sizes from the final fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import zip_longest
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from daq.messages import Sentence
from fitting.effects import effect, line_effect
from fitting.effects.base import Effect
from fitting.loop.kinematic_check import KinematicFinding, KinematicLaw
from fitting.loop.session import Session
from fitting.pipeline.results.loop_results import AcceptedTerm, Attributed, Kinematic, Resolution
from fitting.pipeline.results.stage_results import Residual, StageResults
from fitting.pipeline.verdict import label, verdict
from fitting.planning.detection import visible_size
from fitting.regression.drive import effort_unit
from fitting.report.drawing_data import spline_curve, worst_place
from fitting.report.joint_words import in_own_units, own_unit
from fitting.residual.change_points import ChangePoint
from fitting.residual.findings import Accepted, Attribution, Hypothesis, Unconfirmed
from fitting.residual.laws import Law
from fitting.residual.lines import Line, ripples
from fitting.residual.stored_terms import step_to_json
from fitting.residual.surfaces import second_variable
from fitting.residual.terms import Model, Term
from fitting.selection.evidence import least_gain
from fitting.selection.gains import margin

#: Where play or a compliance is (shape ``sensor``), by the efforts; absent of all other effects.
_PLACES = "fitting.efforts_follow_piston", "fitting.efforts_follow_joint"
#: Shapes that are one of two, in words.
_CHOICES = {
    "sensor": ("place: between piston and joint", "place: between piston and its sensor"),
    "about": ("place: along the cylinder", "place: about the joint"),
    "friction": ("bent by: the load alone", "bent by: load and friction"),
    "load": ("pressed on by: load and friction", "pressed on by: the load alone"),
}
#: Chance with which an effect of the size of its detection limit is found.
LIMIT_POWER = 0.95


def loop_content(session: Session, results: StageResults, model: Model) -> dict[str, Any]:
    """Build ``loop`` of report.json; ``model`` is the final fit, with the terms that were found."""
    machine = session.machine
    names = [joint.name for joint in machine.joints]
    found, kinematics, effects, unexplained = results[Attributed], results[Residual].kinematics, [], []
    added = {term.family for term in found.terms}
    for finding in kinematics:
        if (finding.steps[0]["effect"], finding.steps[0]["joint"]) not in added:  # a name is reported once
            effects.append(finding.effect)
    for number, accepted in enumerate(found.accepted):
        content = accepted.term.content
        if isinstance(content, Law):
            unexplained.append(_added_law(machine, content, model, number, accepted))
        else:
            effects.append(_added_effect(machine, content, model, number, accepted))
    effects += [_line_effect(names, line) for line in ripples(machine, found.lines, session.bank.bandwidth_hz)]
    unexplained += [*results[Residual].laws, *found.unconfirmed]
    outcome, reasons = verdict(results, names)
    designed, resolved = found.next_experiment, results.get(Resolution) or Resolution()
    return {
        "verdict": outcome,
        "label": label(results),
        "reasons": reasons,
        "effects": effects,
        "unexplained": unexplained,
        "candidates": [finding.candidate for finding in kinematics]
        + [asdict(tried) | _named(machine, tried.id, tried.joint) for tried in found.candidates],
        "detection_limits": list(found.limits),
        "hypotheses": _hypotheses(found.hypotheses, names),
        "changes": [_change(change, names) for change in found.changes],
        "looked": found.looked,
        "next_experiment": _next_experiment(effects) if designed is None else designed.content,
        "resolution": [
            {"before": _hypotheses(step.before, names), "motion": step.motion, "after": _hypotheses(step.after, names)}
            for step in resolved.steps
        ],
    }


def _change(found: ChangePoint, names: Sequence[str]) -> dict[str, Any]:
    content = asdict(found) | {"joint": names[found.joint], "of": found.column}
    return {key: value for key, value in content.items() if key not in ("column", "gain")}


def _added_law(machine: Machine, law: Law, model: Model, number: int, accepted: AcceptedTerm) -> dict[str, Any]:
    """Build a law that was added to the model, term ``number``."""
    part = model.term_slice(number)
    return _law_entry(
        machine,
        law,
        accepted.term.joint or 0,
        law=spline_curve(law, model.fit.theta[part], model.fit.covariance[part, part]),
        amplitude=_amplitude(model, number),
        added=True,
        probability=accepted.probability,
        could_be=list(accepted.rivals),
        evidence=accepted.evidence,
    )


def _added_effect(machine: Machine, own: Effect, model: Model, number: int, accepted: AcceptedTerm) -> dict[str, Any]:
    """Build a catalogue effect that was added to the model, as term ``number``."""
    joint = accepted.term.joint
    return {
        **_head(own, None if joint is None else machine.joints[joint].name),
        "parameters": _term_parameters(accepted.term, model, model.term_slice(number), machine),
        "amplitude": _amplitude(model, number),
        "indistinguishable_from": list(accepted.rivals),
        "probability": accepted.probability,
        "evidence": accepted.evidence,
    }


def _head(content: Effect, joint: str | None) -> dict[str, Any]:
    """Build the head of every effect that was found."""
    words = {"title": content.title, "equation": content.equation, "look_at": content.look_at}
    return {"id": content.id, "joint": joint, **words}


def kinematic(machine: Machine, finding: KinematicFinding) -> Kinematic:
    """Build a finding between position sensors, with its entries of effects and candidates."""
    rivals = zip(finding.rivals, finding.rival_probabilities, strict=True)
    shape, content = finding.steps[0].shape, finding.effect
    parameters: dict[str, Any] = {
        p.name: {"value": value, "std": std, "unit": own_unit(machine, finding.joint, unit)}
        for p, unit, value, std in zip(
            content.parameters, content.gap_units(shape), finding.values, finding.stds, strict=True
        )
    }
    joint = machine.joints[finding.joint].name
    found = {
        **_head(content, joint),
        "parameters": _shape_values(content, shape, machine, finding.joint) | parameters,
        "indistinguishable_from": [_likely(machine, rival, finding.joint, share) for rival, share in rivals],
        "probability": finding.probability,
        "evidence": {key: getattr(finding, key) for key in ("score", "gain", "gap_before", "gap_after")},
    }
    tried = {
        "id": content.id,
        "joint": joint,
        "score": finding.score,
        "status": "accepted",
        "reason": Sentence(
            "fitting.position_sensors_disagree",
            before=1e3 * finding.gap_before,
            after=1e3 * finding.gap_after,
            place=Sentence(_PLACES[int(shape["sensor"])]) if "sensor" in shape else "",
        ),
    }
    return Kinematic(tuple(step_to_json(step) for step in finding.steps), found, tried)


def position_law(machine: Machine, found: KinematicLaw) -> dict[str, Any]:
    """Build a law of two position sensors' difference, m, with its possible alternatives beside it."""
    curve = spline_curve(found.law.law, found.values, found.covariance)
    return _law_entry(
        machine,
        found.law.law,
        found.joint,
        law=curve,
        evidence={"gain": found.gain, "between": "position sensors"},
        probability=found.probability,
        could_be=[_likely(machine, name, found.joint, p) for name, p in found.could_be],
        added=False,
    )


def unconfirmed_law(machine: Machine, item: Unconfirmed) -> dict[str, Any]:
    """Build a law found in the fitted motions and not confirmed on others."""
    score, law = item.score, item.score.term.content
    assert isinstance(law, Law)
    covariance = np.asarray(np.linalg.pinv(score.information, rcond=1e-8, hermitian=True), float)
    return _law_entry(
        machine,
        law,
        score.term.joint or 0,
        law=spline_curve(law, np.array(score.values), covariance),
        evidence=_gains(item),
        probability=None,
        could_be=[],
        added=False,
    )


def _law_entry(machine: Machine, of: Law, joint: int, **entries: Any) -> dict[str, Any]:
    """Build a joint's law with what is reported (``said``) of it."""
    names = tuple(own.name for own in machine.joints)
    where = _law_place(of, names[joint], names) | second_variable(of, names)
    return in_own_units(machine, {**where, "unit": of.unit, **entries})


def accepted_term(machine: Machine, item: Accepted) -> AcceptedTerm:
    """Build an added term, with its rivals and its evidence; what was not measured is left out."""
    null = item.score.null
    evidence = {
        **_gains(item),
        "surviving": item.score.surviving,
        "witness": item.witness,
        "cutoffs": [dict(zip(("hz", "value", "std"), cutoff, strict=True)) for cutoff in item.cutoffs],
    }
    evidence = {key: value for key, value in evidence.items() if value not in (None, "", [])}
    evidence |= {} if null is None else {"replicas": null.draws, "inflation": null.inflation}
    rivals = [
        _likely(machine, rival.term.id, rival.term.joint, probability)
        for rival, probability in zip_longest(item.rivals, item.rival_probabilities[: len(item.rivals)])
    ]
    return AcceptedTerm(item.score.term, tuple(rivals), evidence, item.probability)


def _gains(item: Accepted | Unconfirmed) -> dict[str, Any]:
    return {
        "score": margin(item.score),
        "gain": item.score.gain,
        "held_out_gain": item.held_out.gain,
        "held_out_z": item.held_out.z,
        "validate_gain": item.validate_gain,
    }


def detection_limits(machine: Machine, found: Attribution) -> tuple[dict[str, Any], ...]:
    """Return the smallest size of each unadded effect that these recordings would have shown."""
    accused, limits = {a.score.term.family for a in found.accepted}, []
    for score in found.limits:
        content, joint = score.term.content, score.term.joint
        determined = [number for number, std in enumerate(score.stds) if std > 0]
        if score.term.family in accused or isinstance(content, Law) or not determined:
            continue
        # The chi-square that accuses, for the first parameter that this motion determines at all, with the others free.
        size = visible_size(least_gain(score.live, score.grid), score.live, LIMIT_POWER)
        parameter = content.parameters[determined[0]]
        limits.append(
            {
                "smallest": size * score.stds[determined[0]],
                "power": LIMIT_POWER,
                "parameter": parameter.name,
                "unit": own_unit(machine, joint, parameter.unit),
                **_named(machine, content.id, joint),
            }
        )
    return tuple(limits)


def _named(machine: Machine, name: str, joint: int | None) -> dict[str, Any]:
    """Name an effect as everywhere: id, title and joint."""
    return {"id": name, "title": effect(name).title, "joint": None if joint is None else machine.joints[joint].name}


def _likely(machine: Machine, name: str, joint: int | None, probability: float | None) -> dict[str, Any]:
    """Build an equivalent effect, with its probability."""
    return _named(machine, name, joint) | {"probability": probability}


def _hypotheses(found: Sequence[Hypothesis], names: Sequence[str]) -> list[dict[str, Any]]:
    """List explanations of the efforts, the most probable first; the empty one is "nothing"."""
    result = []
    for hypothesis in found:
        effects, laws = list[dict[str, Any]](), list[dict[str, Any]]()
        for term in hypothesis.terms:
            place = None if term.joint is None else names[term.joint]
            if isinstance(term.content, Law):
                laws.append(_law_place(term.content, place, names))
            else:
                effects.append({"id": term.id, "joint": place})
        result.append({"effects": effects, "laws": laws, "probability": hypothesis.probability})
    return result


def _law_place(law: Law, joint: str | None, names: Sequence[str]) -> dict[str, Any]:
    """Return what a law is a law of, and where."""
    variable, only = law.variable(tuple(names)), law.only or None
    return {"joint": joint, "variable": variable, "times_sign_of_speed": law.signed, "only_while": only}


def _line_effect(names: list[str], line: Line) -> dict[str, Any]:
    """Build a spectral line above the identification band: named, but not to add."""
    content = line_effect()
    return {
        **_head(content, names[line.joint]),
        "parameters": {
            "amplitude": {"value": line.amplitude, "std": line.amplitude_std, "unit": "N"},
            "frequency": {"value": line.frequency_hz, "std": line.frequency_std, "unit": "Hz"},
        },
        "indistinguishable_from": [],
        "evidence": {"p": line.p, "outside_band": True},
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
        for p, value, std, already, determined in zip(
            term.content.parameters,
            model.fit.theta[part],
            model.fit.std[part],
            rebuilt,
            model.fit.determined[part],
            strict=True,
        )
        if determined  # a column that the base takes whole has no value of its own
    }
    view = model.views[model.fitted[0]][term.joint or 0]
    references = {}
    for name, (value, unit) in term.content.references(view, term.shape).items():
        if other is not None:  # a pose of the other joint
            unit = unit.replace("rad", "m") if slides else unit
        else:
            unit = own_unit(machine, term.joint, unit)
        references[name] = {"value": value, "std": None, "unit": unit}
    return {**_shape_values(term.content, term.shape, machine, term.joint), **values, **references}


def _amplitude(model: Model, number: int) -> dict[str, Any]:
    """Compute a term's size over the fitted motions, independent of what a formula counts from.

    ``largest`` is the 99th percentile of its magnitude over the moving samples, on the joint where it is largest; of a
    delay what is left of it after the efforts were moved. ``worst`` is where on its variable it is largest there.
    """
    machine = model.design.machine
    best: dict[str, Any] = {"largest": 0.0, "rms": 0.0, "unit": "N", "joint": None, "worst": None}
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
                "worst": worst_place(model, number, joint),
            }
    return best


def _shape_values(content: Effect, shape: Mapping[str, float], machine: Machine, joint: int | None) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in shape.items():
        without = "choice" if key in content.discrete_shapes else "1"
        name, unit = key, own_unit(machine, joint, content.shape_units.get(key, without))
        if key == "other":
            name, unit = Sentence("fitting.other_joint", joint=machine.joints[int(value)].name), "index"
        elif key in _CHOICES:
            name, unit = _CHOICES[key][int(value)], "choice"
        values[name] = {"value": value, "std": None, "unit": unit}
    return values


def _next_experiment(effects: list[dict[str, Any]]) -> dict[str, Any] | None:
    for entry in effects:
        if entry["indistinguishable_from"]:
            rivals = [r["id"] for r in entry["indistinguishable_from"]]
            return {
                "motion": effect(entry["id"]).experiment,
                "why": Sentence("fitting.leave_same_trace", effect=entry["id"], rivals=", ".join(rivals)),
                "separates": [entry["id"], *rivals],
                "joint": entry["joint"],
            }
    return None
