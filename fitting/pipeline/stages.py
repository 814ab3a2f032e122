"""The identification as stages, each of which can be a process of its own.

``check, cylinder_stage, rigid_body_stage, residual, attribution, refit, report``. A stage takes a session and what
earlier stages found (plain JSON) and gives plain JSON; :func:`run_stage` keeps each result in
``output/stages/<stage>.json``, written atomically, so that a stage that is done is never run again. The program is
:mod:`fitting.pipeline.stage_program`.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.errors import HilfitError, InputError
from fitting.arm.dynamics import self_check
from fitting.estimators.effort_fit import EffortRows, mean_levers, parameter_error
from fitting.excitation.motion import Motion, write_motion
from fitting.loop.closing import next_experiment
from fitting.loop.effort_confirmation import confirmed_in_effort
from fitting.loop.everything import held_against_everything, said
from fitting.loop.kinematic_check import corrections_from_json, kinematic_findings, step_to_json
from fitting.loop.residual_loop import (
    final_model,
    is_ripple,
    other_bands,
    run_attribution,
    term_from_json,
    term_to_json,
)
from fitting.loop.session import Request, Session
from fitting.model.codec import MODEL_FILE, save_model
from fitting.model.handover import hand_over
from fitting.pipeline.check_gate import checked, with_explanation
from fitting.pipeline.cylinder_stage import InSitu, identify_cylinders
from fitting.pipeline.estimation import estimation
from fitting.pipeline.plausibility import physics
from fitting.pipeline.results import build_report, final_fit
from fitting.pipeline.stage_names import NEXT_MOTION, STAGES, WORDS
from fitting.pipeline.stage_two import choice, chosen_refit, comparison, rigid_body_stage, std
from fitting.pipeline.verdict import MOST_NOISE
from fitting.planning.detection import visible_size
from fitting.regression.design import Design, reduced_residual
from fitting.regression.error_sizes import ROLES, errors_of, independent_rows, overall_errors
from fitting.regression.noise import effort_floor
from fitting.report import presented, write_report
from fitting.report.drawing_data import spline_curve
from fitting.residual.change_points import ChangePoint
from fitting.residual.confirmation import overall_change
from fitting.residual.findings import Accepted, Attribution, Family, Unconfirmed
from fitting.residual.laws import Law
from fitting.residual.surfaces import second_variable
from fitting.residual.terms import Model
from fitting.selection.evidence import least_gain
from fitting.signals.corrections import Corrections

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[float, str], None]
#: Chance with which an effect of the size of its detection limit is found.
LIMIT_POWER = 0.95
Results = Mapping[str, dict[str, Any]]


def _quiet(fraction: float, text: str) -> None:
    return None


def check(session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """Recordings fit the machine and excite it; the machine's own equations agree with each other."""
    choice(session)
    findings = checked(session)
    session.require_excitation()
    progress(0.5, "checking the equations of motion against themselves")
    return {
        "bandwidth_hz": session.bank.bandwidth_hz,
        "self_check": self_check(session.machine).error,
        "standard_parameters": session.base.standard_count,
        "base_parameters": len(session.base),
        "repeated": bool(session.plain.pairs),
        "findings": findings,
    }


def cylinder_stage(session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """Stage 1."""
    prepared = session.plain
    estimates = identify_cylinders(
        prepared.design,
        prepared.noise,
        session.prior,
        forgetting=session.options.forgetting,
        in_situ=lambda: InSitu(
            session.stage_noise, session.handed_base.model.fit, session.handed_base.weights == "equal"
        ),
    )
    return {
        "cylinders": [
            {
                "joint": e.joint,
                "names": list(e.names),
                "theta": e.theta.tolist(),
                "std": e.std.tolist(),
                "residual_std": e.residual_std,
                "in_situ": e.in_situ,
                "rows": e.rows,
                "covariance": None if e.covariance is None else e.covariance.tolist(),
                "condition": e.condition,
                "refused": e.refused,
            }
            for e in estimates
        ]
    }


def residual(session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """Noise floor, and what two position sensors say of each other."""
    prepared, model = session.plain, session.handed_base.model
    floor = (
        effort_floor(prepared.design, model.fit.theta, prepared.pairs) if prepared.pairs else _estimated_floor(session)
    )
    left = np.nan_to_num(session.handed_base.errors[session.handed_base.weights])
    valid = (floor <= MOST_NOISE * left) | (left == 0)
    findings = kinematic_findings(session.search.session, progress)[0] if session.options.loop else ()
    return {
        # What is above the error that the fit leaves is no noise floor; that error is a bound from above.
        "noise_floor": np.where(valid, floor, left).tolist(),
        "floor_valid": valid.tolist(),
        "measured": bool(prepared.pairs),
        "kinematics": [
            {
                "steps": [step_to_json(s) for s in f.steps],
                "values": list(f.values),
                "stds": list(f.stds),
                "gain": f.gain,
                "score": f.score,
                "gap_before": f.gap_before,
                "gap_after": f.gap_after,
                "rivals": list(f.rivals),
                "probability": f.probability,
                "rival_probabilities": list(f.rival_probabilities),
            }
            for f in findings
        ],
    }


def _estimated_floor(session: Session) -> FloatArray:
    """Noise floor in joint effort from the noise model, at each joint's mean lever arm."""
    return np.asarray(session.plain.noise.std * mean_levers(session.plain.design))


def attribution(session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """What the residual is traced to."""
    if not session.options.loop:
        nothing: dict[str, Any] = {key: [] for key in ("accepted", "candidates", "limits", "warnings")}
        nothing |= {key: [] for key in ("unconfirmed", "lines", "changes", "hypotheses")}
        return nothing | {"verdict": "not_examined", "looked": False, "next_experiment": None}
    corrections, search = _corrections(session, results), session.search
    found = run_attribution(search.session, corrections, progress)
    warnings = list(found.warnings)
    if not search.whole:
        found = held_against_everything(session, corrections, search, found, progress)
        warnings.append(said(search))
    found = confirmed_in_effort(session, corrections, found)
    silent = found.verdict == "nothing_missing" and not results["residual"]["kinematics"]
    others = other_bands(search.session, corrections, progress) if silent else ()
    progress(0.92, "designing the experiment that tells rivals apart")
    names = tuple(joint.name for joint in session.machine.joints)
    result = {
        "verdict": found.verdict,
        "looked": True,
        "accepted": [_accepted(a) for a in found.accepted],
        "candidates": [
            {"id": c.id, "joint": c.joint, "score": c.score, "status": c.status, "reason": c.reason}
            for c in found.candidates
            if c.id != "law"
        ],
        "limits": _limits(found),
        "warnings": warnings,
        "searched": {"pieces": search.pieces, "seconds": search.seconds, "of_seconds": search.of_seconds},
        "unconfirmed": [_unconfirmed(item, names) for item in found.unconfirmed],
        "lines": [
            {
                "joint": line.joint,
                "frequency": [line.frequency_hz, line.frequency_std],
                "amplitude": [line.amplitude, line.amplitude_std],
                "p": line.p,
                "in_band": bool(line.frequency_hz <= session.bank.bandwidth_hz),
                "ripple": is_ripple(session.machine, line),
            }
            for line in found.lines
        ],
        "changes": [_change(c, names) for c in found.changes],
        "hypotheses": [
            {"terms": [term_to_json(term) for term in h.terms], "probability": h.probability} for h in found.hypotheses
        ],
        "other_bands": [
            {"bandwidth_hz": hz, "found": [_called(f, names) for f in families]} for hz, families in others
        ],
        "next_experiment": _next_experiment(search.session, found),
    }
    session.forget_search()
    return result


def _unconfirmed(item: Unconfirmed, names: tuple[str, ...]) -> dict[str, Any]:
    law, score = item.score.term.content, item.score
    assert isinstance(law, Law)
    return {
        "joint": item.score.term.joint,
        "variable": law.variable(names),
        "times_sign_of_speed": law.signed,
        **second_variable(law, names),
        "unit": law.unit,
        "law": spline_curve(
            law,
            np.array(score.values),
            np.asarray(np.linalg.pinv(score.information, rcond=1e-8, hermitian=True), float),
        ),
        "evidence": {
            "score": score.score,
            "gain": score.gain,
            "held_out_gain": item.held_out.gain,
            "held_out_z": item.held_out.z,
            "validate_gain": item.validate_gain,
        },
    }


def _change(found: ChangePoint, names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "joint": names[found.joint],
        "of": found.column,
        "kind": found.kind,
        "recording": found.recording,
        "time": found.time,
        "interval": list(found.interval),
        "change": found.change,
        "std": found.std,
        "p": found.p,
    }


def _called(family: Family, names: tuple[str, ...]) -> str:
    """An effect and its joint in words."""
    name, joint = family
    what = "a law" if name == "law" else name
    return what if joint is None else f"{what} at {names[joint]}"


def _next_experiment(session: Session, found: Attribution) -> dict[str, Any] | None:
    """The experiment that best separates the members of the first set; ``program`` is a motion worth an attempt."""
    designed = next_experiment(session, found)
    if designed is None:
        return None
    best, attempt = designed.best, designed.attempt
    recommended = best is not None and best.motion is not None
    content = designed.to_json(session.machine, NEXT_MOTION if recommended else None)
    if attempt is None or attempt.motion is None:
        return content
    motion = attempt.motion
    columns = {name: np.round(column, 7).tolist() for name, column in motion.columns.items()}
    program = {"rods": motion.rods, "time": motion.time.tolist(), "columns": columns}
    return content | {"program": program | {"text": attempt.text, "chance": attempt.expected.probability}}


def _accepted(item: Accepted) -> dict[str, Any]:
    return {
        "term": term_to_json(item.score.term),
        "score": item.score.score,
        "gain": item.score.gain,
        "surviving": item.score.surviving,
        "held_out_gain": item.held_out.gain,
        "held_out_z": item.held_out.z,
        "validate_gain": item.validate_gain,
        "witness": item.witness,
        "cutoffs": [{"hz": hz, "value": value, "std": std} for hz, value, std in item.cutoffs],
        "null": None
        if item.score.null is None
        else {"draws": item.score.null.draws, "inflation": item.score.null.inflation},
        "rivals": [
            {"id": r.term.id, "joint": r.term.joint, "score": r.score, "probability": p}
            for r, p in zip_longest(item.rivals, item.rival_probabilities[: len(item.rivals)])
        ],
        "probability": item.probability,
    }


def _limits(found: Attribution) -> list[dict[str, Any]]:
    accused = {a.score.term.family for a in found.accepted}
    limits = []
    for score in found.limits:
        if score.term.family in accused or isinstance(score.term.content, Law):
            continue
        # The chi-square that accuses, for the first parameter that this motion tells at all, with the others free.
        needed = least_gain(score.live, score.grid)
        told = [number for number, std in enumerate(score.stds) if std > 0]
        if not told:
            continue
        parameter = score.term.content.parameters[told[0]]
        limits.append(
            {
                "id": score.term.id,
                "joint": score.term.joint,
                "smallest": visible_size(needed, score.live, LIMIT_POWER) * score.stds[told[0]],
                "power": LIMIT_POWER,
                "parameter": parameter.name,
                "unit": parameter.unit,
            }
        )
    return limits


def refit(session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """Both stages refitted jointly with what was found; errors before and after."""
    terms = [term_from_json(a["term"]) for a in results["attribution"]["accepted"]]
    prepared, final = final_model(session, _corrections(session, results), terms)
    model, before = final.model, session.base_with(final.weights)
    design = session.plain.design
    found = {
        "before": errors_of(design, before.fit.theta),
        "after": errors_of(prepared.design, model.fit.theta, model.extra),
    }
    errors = {state: sizes for state, (sizes, _, _) in found.items()}
    progress(0.6, "interval of the improvement")
    shown = "validate" if design.indices("validate") else "train"
    floor = np.asarray(results["residual"]["noise_floor"])
    series = [by_role[shown] for _, by_role, _ in found.values()]
    change = overall_change(series[0], series[1], floor, design.bank.reduced_rate_hz, np.random.default_rng(20))
    parameters = len(design.parameters)
    return {
        "chosen": chosen_refit(session, prepared.design, model),
        "comparison": comparison(session, results, floor),
        "weights": final.weights,
        "estimation": estimation(session, results, final),
        "before": _parameters(before.fit.theta[:parameters], before.fit.std[:parameters], before.fit.told[:parameters]),
        "after": _parameters(model.fit.theta, model.fit.std, model.fit.told),
        "parameter_error": parameter_error(
            EffortRows(prepared.design, prepared.design.indices(*ROLES[shown]), model.extra), model.fit, floor
        ),
        "independent_rows": {role: independent_rows(found["after"][1][role]) for role in ("train", "validate")},
        "plausibility": physics(prepared.design, model),
        "condition_number": model.fit.condition_number,
        "chi_square_per_row": model.fit.chi_square / max(model.fit.rows - len(model.fit.theta), 1),
        "drive_residual_std": [std(e) for e in _drive_errors(prepared.design, model)],
        "errors": errors,
        "overall": {**change, "role": shown, "unit": "noise floors", **overall_errors(found, floor, shown)},
    }


def _drive_errors(design: Design, model: Model) -> list[FloatArray]:
    result = []
    for joint in range(len(design.machine.joints)):
        parts = [
            reduced_residual(design, model.fit.theta, joint, i, model.extra)[design.blocks[joint][i].keep]
            for i in model.fitted
        ]
        result.append(np.concatenate(parts))
    return result


def _parameters(theta: FloatArray, std: FloatArray, told: npt.NDArray[np.bool_]) -> dict[str, Any]:
    return {"theta": theta.tolist(), "std": std.tolist(), "told": told.tolist()}


def _corrections(session: Session, results: Results) -> Corrections:
    steps = [step for f in results["residual"]["kinematics"] for step in f["steps"]]
    return corrections_from_json(session, steps)


#: The stages before the report, in order.
STEPS: dict[str, Callable[[Session, Results, Progress], dict[str, Any]]] = {
    "check": check,
    "cylinder_stage": cylinder_stage,
    "rigid_body_stage": rigid_body_stage,
    "residual": residual,
    "attribution": attribution,
    "refit": refit,
}


def identify(request: Request, progress: Progress = _quiet) -> dict[str, Any]:
    """Run all stages in this process and return the report (also written to ``request.output``).

    Raises
    ------
    InputError
        One line about the machine file or a recording; nothing is written then.
    """
    session = opened(request)
    results = computed(STEPS, request, session, {}, progress)
    return reported(request, session, results, progress)


def opened(request: Request) -> Session:
    """The session of a request whose output can be written and whose options make sense.

    Raises
    ------
    InputError
        As :func:`identify` does.
    """
    require_writable(request.output)
    session = with_explanation(request, lambda: Session.load(request))
    choice(session)  # a wrong option is said before any work
    return session


def computed(
    stages: Iterable[str], request: Request, session: Session, results: Results, progress: Progress
) -> dict[str, dict[str, Any]]:
    """Earlier results, and those of these stages."""
    found = dict(results)
    for stage in stages:
        found[stage] = _computed(stage, request, session, found, _part(progress, STAGES.index(stage)))
    return found


def reported(request: Request, session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """The report of these results, written to ``request.output``."""
    progress((len(STAGES) - 1) / len(STAGES), WORDS["report"])
    content, _, _ = _write_results(session, results, request.output)
    progress(1.0, "done")
    return content


def _computed(stage: str, request: Request, session: Session, results: Results, progress: Progress) -> dict[str, Any]:
    """A stage's result; where the first one refuses the input, what the checks make of it is said as well."""
    compute = STEPS[stage]
    if stage != "check":
        return compute(session, results, progress)
    return with_explanation(request, lambda: compute(session, results, progress))


def _write_results(session: Session, results: Results, output: Path) -> tuple[dict[str, Any], Path, Path]:
    """The report, its page, the model, and the next experiment's motion if one was designed."""
    final = final_fit(session, results)
    content, figures = build_report(session, results, final)
    content = presented(content, figures)
    paths = write_report(content, figures, output)
    save_model(output / MODEL_FILE, hand_over(session, final.steps, final.model, content))
    experiment = results["attribution"]["next_experiment"]
    if experiment is not None and experiment.get("motion_file"):
        write_motion(output / NEXT_MOTION, motion_of(experiment["program"], session.machine.name))
    return content, *paths


def motion_of(program: Mapping[str, Any], machine: str) -> Motion:
    """The motion of ``next_experiment["program"]``."""
    columns = {name: np.array(column) for name, column in program["columns"].items()}
    return Motion(machine, program["rods"], np.array(program["time"]), columns)


def require_writable(directory: Path) -> None:
    """Refuse an output directory that cannot be made or written, before any work is done; nothing is made yet.

    Raises
    ------
    InputError
        One line that says what is in the way.
    """
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is a file; give a directory with -o")
    place = directory.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{directory}: {place} is a file, so no directory can be made there; choose another with -o")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"{directory}: {place} cannot be written; choose another directory with -o")


def _part(progress: Progress, number: int) -> Progress:
    """Progress of one stage as a part of the whole."""
    stage = STAGES[number]
    progress(number / len(STAGES), WORDS[stage])
    return lambda fraction, text: progress((number + fraction) / len(STAGES), text)


def run_stage(
    stage: str,
    request: Request,
    progress: Progress = _quiet,
    load: Callable[[Request], Session] = Session.load,
) -> dict[str, Any]:
    """Run one stage, or give back its stored result if it is done.

    Earlier stages have to be done; their results are read from ``output/stages``.

    Parameters
    ----------
    load : gives the session of the request, where it is needed
    """
    if stage not in STAGES:
        raise InputError(f"there is no stage '{stage}'; use one of {', '.join(STAGES)}")
    directory = request.output / "stages"
    stored = directory / f"{stage}.json"
    if stored.exists():
        return dict(json.loads(stored.read_text(encoding="utf-8")))
    results: dict[str, dict[str, Any]] = {}
    for earlier in STAGES[: STAGES.index(stage)]:
        path = directory / f"{earlier}.json"
        if not path.exists():
            raise HilfitError(f"{path}: stage '{earlier}' has not been run; run the stages in order")
        results[earlier] = json.loads(path.read_text(encoding="utf-8"))
    progress(0.0, WORDS[stage])
    session = with_explanation(request, lambda: load(request))
    if stage == "report":
        _, json_path, html_path = _write_results(session, results, request.output)
        result: dict[str, Any] = {"report": json_path.name, "page": html_path.name}
    else:
        result = _computed(stage, request, session, results, progress)
    _write(stored, result)
    progress(1.0, WORDS[stage])
    return result


def _write(path: Path, content: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(content, file)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
