"""The identification as stages, each of which can be a process of its own.

``check, cylinder_stage, rigid_body_stage, residual, attribution, refit, report``. A stage takes a session and what
earlier stages found and gives its own result (:mod:`fitting.pipeline.results.stage_results`); :func:`run_stage` keeps
each in ``output/stages/<stage>.json``, written atomically, so that a stage that is done is never run again. The program
is :mod:`fitting.pipeline.stage_program`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import HilfitError, InputError
from daq.messages import Sentence
from daq.motion_files import Motion, write_motion
from daq.whole_files import replacing
from fitting.arm.dynamics import self_check
from fitting.checks.check import check_recordings
from fitting.checks.findings import Places
from fitting.estimators.effort_fit import EffortRows, mean_levers, parameter_error, predicted_std
from fitting.loop.closing import asked_of, next_experiment
from fitting.loop.everything import search_note
from fitting.loop.kinematic_check import Kinematics, kinematics
from fitting.loop.noise_scale import words as noise_words
from fitting.loop.refits import final_model
from fitting.loop.residual_loop import attributed, other_bands
from fitting.loop.session import Request, Session
from fitting.model.codec import MODEL_FILE, save_model
from fitting.model.handover import hand_over
from fitting.model.motion import indefinite
from fitting.pipeline.check_gate import with_explanation
from fitting.pipeline.comparison import estimation
from fitting.pipeline.cylinder_stage import InSitu, identify_cylinders
from fitting.pipeline.plausibility import physics
from fitting.pipeline.results.loop_content import (
    accepted_term,
    detection_limits,
    kinematic,
    position_law,
    unconfirmed_law,
)
from fitting.pipeline.results.loop_results import Attributed, Designed, OtherBand, Program
from fitting.pipeline.results.results import build_report, final_fit
from fitting.pipeline.results.stage_results import (
    RESULTS,
    Checked,
    Cylinders,
    Fitted,
    Refitted,
    Residual,
    RigidBody,
    StageResults,
    Written,
    from_json,
    to_json,
)
from fitting.pipeline.stage_names import NEXT_MOTION, STAGES, WORDS
from fitting.pipeline.stage_two import choice, comparison, estimated, rigid_body_stage
from fitting.pipeline.verdict import MOST_NOISE
from fitting.progress import Progress, quiet
from fitting.regression.design import reduced_errors
from fitting.regression.error_sizes import ROLES, errors_of, independent_rows, overall_errors
from fitting.regression.noise import effort_floor
from fitting.regression.solving import Fit
from fitting.report.html import write_report
from fitting.report.languages import language
from fitting.report.presented import presented
from fitting.residual.confirmation.confirmation import overall_change
from fitting.residual.findings import Attribution, Family
from fitting.residual.stored_terms import corrections_from_json
from fitting.selection.decision import together
from fitting.signals.corrections import Corrections


def _check(session: Session, results: StageResults, progress: Progress) -> Checked:
    """Check that recordings fit and excite the machine, and that its own equations agree."""
    choice(session)
    findings = check_recordings(session.machine, session.measured, places=Places.of(session.file))
    session.require_excitation()
    progress(0.5, Sentence("fitting.checking_equations_motion_against"))
    return Checked(
        bandwidth_hz=session.bank.bandwidth_hz,
        self_check=self_check(session.machine),
        standard_parameters=session.base.standard_count,
        base_parameters=len(session.base),
        repeated=bool(session.plain.pairs),
        findings=tuple(findings),
    )


def _cylinder_stage(session: Session, results: StageResults, progress: Progress) -> Cylinders:
    """Run stage 1."""
    prepared = session.plain
    estimates = identify_cylinders(
        prepared.design,
        prepared.noise,
        session.prior,
        forgetting=session.options.forgetting,
        in_situ=lambda: InSitu(
            session.stage_noise,
            session.weighted_base.model.fit,
            session.weighted_base.model.prior or session.prior,
            session.weighted_base.weights == "equal",
        ),
    )
    return Cylinders(estimates)


def _residual(session: Session, results: StageResults, progress: Progress) -> Residual:
    """Compute the noise floor, and what two position sensors show of each other."""
    prepared, model = session.plain, session.weighted_base.model
    if prepared.pairs:
        floor = effort_floor(prepared.design, model.fit.theta, prepared.pairs)
    else:  # that of the noise model, at each joint's mean lever arm
        floor = prepared.noise.std * mean_levers(prepared.design)
    left = np.nan_to_num(session.weighted_base.errors[session.weighted_base.weights])
    valid = (floor <= MOST_NOISE * left) | (left == 0)
    found = Kinematics(Corrections(session.machine))
    if session.options.loop:
        found = kinematics(session.search.session, progress)
    return Residual(
        # What is above the error that the fit leaves is no noise floor; that error is a bound from above.
        noise_floor=tuple(np.where(valid, floor, left).tolist()),
        floor_valid=tuple(valid.tolist()),
        measured=bool(prepared.pairs),
        kinematics=tuple(kinematic(session.machine, finding) for finding in found.findings),
        laws=tuple(position_law(session.machine, law) for law in found.laws),
        hypotheses=found.hypotheses,
    )


def _attribution(session: Session, results: StageResults, progress: Progress) -> Attributed:
    """Attribute the residual."""
    if not session.options.loop:
        return Attributed("not_examined", looked=False)
    residual, search = results[Residual], session.search
    corrections = corrections_from_json(session.machine, residual.steps)
    found = attributed(session, corrections, progress)
    names = tuple(joint.name for joint in session.machine.joints)
    warnings = [*found.warnings, *([] if search.whole else [search_note(search)])]
    warnings += noise_words(names, search.session.plain.rescaled)
    # Another bandwidth is asked only where it can change the verdict: not where structure is certain, or noise unknown.
    silent = found.verdict == "nothing_missing" and not (residual.kinematics or residual.laws)
    silent = silent and all(residual.floor_valid)
    others = other_bands(search.session, corrections, progress) if silent else ()
    progress(0.92, Sentence("fitting.designing_experiment_tells_rivals"))
    result = Attributed(
        verdict=found.verdict,
        accepted=tuple(accepted_term(session.machine, item) for item in found.accepted),
        candidates=tuple(c for c in found.candidates if c.id != "law"),
        limits=detection_limits(session.machine, found),
        hypotheses=together(residual.hypotheses, found.hypotheses),
        nothing=found.nothing,
        nothing_more=found.nothing_more,
        unconfirmed=tuple(unconfirmed_law(session.machine, item) for item in found.unconfirmed),
        lines=found.lines,
        changes=found.changes,
        other_bands=tuple(OtherBand(hz, tuple(_called(f, names) for f in families)) for hz, families in others),
        next_experiment=_next_experiment(search.session, found),
        warnings=tuple(warnings),
    )
    session.forget_search()
    return result


def _called(family: Family, names: tuple[str, ...]) -> str:
    """Word an effect and its joint."""
    name, joint = family
    what = "a law" if name == "law" else name
    return what if joint is None else Sentence("fitting.at_joint", effect=what, joint=names[joint])


def _next_experiment(session: Session, found: Attribution) -> Designed | None:
    """Design the experiment that best separates the first set's members, with motion where closable."""
    designed = next_experiment(session, found)
    if designed is None:
        return None
    asked = asked_of(designed, session)
    content = designed.to_json(session.machine, None if asked is None else NEXT_MOTION)
    if asked is None:
        return Designed(content)
    motion = asked.motion
    columns = {name: np.round(column, 7) for name, column in motion.columns.items()}
    return Designed(content, Program(motion.rods, motion.time, columns, asked.text, asked.chance))


def _refit(session: Session, results: StageResults, progress: Progress) -> Refitted:
    """Refit both stages jointly with the findings; errors before and after."""
    corrections = corrections_from_json(session.machine, results[Residual].steps)
    prepared, final = final_model(session, corrections, results[Attributed].terms)
    (model, chosen), before = estimated(session, final.model), estimated(session, session.base_with(final.weights))[0]
    design = session.plain.design
    found = {
        "before": errors_of(design, before.fit.theta),
        "after": errors_of(prepared.design, model.fit.theta, model.extra),
    }
    errors = {state: sizes for state, (sizes, _, _) in found.items()}
    if chosen is not None:
        errors["joint"] = errors_of(prepared.design, final.model.fit.theta, model.extra)[0]
    progress(0.6, Sentence("fitting.interval_improvement"))
    shown = "validate" if design.indices("validate") else "train"
    floor = np.asarray(results[Residual].noise_floor)
    series = [by_role[shown] for _, by_role, _ in found.values()]
    change = overall_change(series[0], series[1], floor, design.bank.reduced_rate_hz, np.random.default_rng(20))
    parameters = len(design.parameters)
    judged = EffortRows(prepared.design, prepared.design.indices(*ROLES[shown]), model.extra)
    none = (None,) * len(floor)
    theta, joints = model.fit.theta, range(len(floor))
    drives = (reduced_errors(prepared.design, theta, joint, model.fitted, model.extra) for joint in joints)
    return Refitted(
        chosen=chosen,
        joint=_fitted(final.model.fit, len(final.model.fit.theta)),
        comparison=comparison(session, results[RigidBody], floor),
        weights=final.weights,
        estimation=estimation(session, results[RigidBody], final),
        before=_fitted(before.fit, parameters),
        after=_fitted(model.fit, len(model.fit.theta)),
        parameter_error=parameter_error(judged, model.fit, floor),
        predicted_std=_predicted(judged, model.fit, errors["after"]["train"]) if shown == "validate" else none,
        independent_rows={role: independent_rows(found["after"][1][role]) for role in ("train", "validate")},
        plausibility=physics(prepared.design, model),
        condition_number=model.fit.condition_number,
        drive_residual_std=tuple(float(np.std(own)) if len(own) else None for own in drives),
        errors=errors,
        overall={**change, "role": shown, "unit": "noise floors", **overall_errors(found, floor, shown)},
    )


def _fitted(fit: Fit, count: int) -> Fitted:
    """Return the first parameters of a fit for the stage."""
    share = np.ones(len(fit.theta)) if fit.share is None else fit.share
    return Fitted(fit.theta[:count], fit.std[:count], fit.determined[:count], share[:count])


def _predicted(rows: EffortRows, fit: Fit, trained: Sequence[float | None]) -> tuple[float | None, ...]:
    """Compute the standard deviation of each joint's expected error on some rows."""
    both = zip(predicted_std(rows, fit).tolist(), trained, strict=True)
    return tuple(float(np.hypot(own, left)) if left is not None and np.isfinite(own) else None for own, left in both)


#: The stages before the report, in order.
STEPS: dict[str, Callable[[Session, StageResults, Progress], Any]] = {
    "check": _check,
    "cylinder_stage": _cylinder_stage,
    "rigid_body_stage": rigid_body_stage,
    "residual": _residual,
    "attribution": _attribution,
    "refit": _refit,
}


def identify(request: Request, progress: Progress = quiet) -> dict[str, Any]:
    """Run all stages in this process and return the report (also written to ``request.output``).

    Raises
    ------
    InputError
        One line about the machine file or a recording; nothing is written then.
    """
    session = opened(request)
    results = computed(STEPS, request, session, StageResults(), progress)
    return reported(request, session, results, progress)


def opened(request: Request) -> Session:
    """Open the session of a request with a writable output and sensible options.

    Raises
    ------
    InputError
        As :func:`identify` does.
    """
    require_writable(request.output)
    for code in request.languages:
        language(code)  # a wrong one is reported before any work
    session = with_explanation(request, lambda: Session.load(request))
    choice(session)  # a wrong option is reported before any work
    return session


def computed(
    stages: Iterable[str], request: Request, session: Session, results: StageResults, progress: Progress
) -> StageResults:
    """Add these stages' results to earlier ones."""
    for stage in stages:
        results = results.having(_computed(stage, request, session, results, _part(progress, STAGES.index(stage))))
    return results


def reported(request: Request, session: Session, results: StageResults, progress: Progress) -> dict[str, Any]:
    """Write the report of these results to ``request.output``."""
    progress((len(STAGES) - 1) / len(STAGES), WORDS["report"])
    content, _, _ = _write_results(request, session, results)
    progress(1.0, "done")
    return content


def _computed(stage: str, request: Request, session: Session, results: StageResults, progress: Progress) -> Any:
    """Compute a stage's result; where the first one refuses the input, add what the checks find."""
    compute = STEPS[stage]
    if stage != "check":
        return compute(session, results, progress)
    return with_explanation(request, lambda: compute(session, results, progress))


def _write_results(request: Request, session: Session, results: StageResults) -> tuple[dict[str, Any], Path, Path]:
    """Write the report, its pages, the model, and any designed next experiment's motion."""
    output, (first, *others) = request.output, request.languages
    final = final_fit(session, results)
    content, figures = build_report(session, results, final)
    model = hand_over(session, results[Residual].steps, final, content)
    wrong = indefinite(model)
    if wrong is not None:
        content["warnings"].append(Sentence("fitting.efforts_all_the_same", problem=wrong.text))
    content = presented(content, figures)
    paths = write_report(content, figures, output, language=first, others=others)
    save_model(output / MODEL_FILE, model)
    experiment = results[Attributed].next_experiment
    if experiment is not None and experiment.program is not None and experiment.content.get("motion_file"):
        write_motion(output / NEXT_MOTION, motion_of(experiment.program, session.machine.name))
    return content, *paths


def motion_of(program: Program, machine: str) -> Motion:
    """Return the motion of a designed experiment."""
    return Motion(machine, program.rods, program.time, program.columns)


def require_writable(directory: Path) -> None:
    """Refuse an output directory that cannot be made or written, before any work is done; nothing is made yet.

    Raises
    ------
    InputError
        One line that names what is in the way.
    """
    if directory.exists() and not directory.is_dir():
        raise InputError("fitting.output_is_file", directory=directory)
    place = directory.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise InputError("fitting.file_no_directory_can", directory=directory, place=place)
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError("fitting.cannot_written", directory=directory, place=place)


def _part(progress: Progress, number: int) -> Progress:
    """Map one stage's progress to a part of the whole."""
    stage = STAGES[number]
    progress(number / len(STAGES), WORDS[stage])
    return lambda fraction, text: progress((number + fraction) / len(STAGES), text)


def run_stage(
    stage: str,
    request: Request,
    progress: Progress = quiet,
    load: Callable[[Request], Session] = Session.load,
) -> dict[str, Any]:
    """Run one stage, or give back its stored result if it is done, as JSON.

    Earlier stages have to be done; their results are read from ``output/stages``. ``load`` gives the session if needed.
    """
    if stage not in STAGES:
        raise InputError("fitting.no_stage", stage=stage, stages=", ".join(STAGES))
    directory = request.output / "stages"
    stored = directory / f"{stage}.json"
    if stored.exists():
        return dict(json.loads(stored.read_text(encoding="utf-8")))
    results = StageResults()
    for earlier in STAGES[: STAGES.index(stage)]:
        path = directory / f"{earlier}.json"
        if not path.exists():
            raise HilfitError("fitting.stage_not_been_run", path=path, earlier=earlier)
        content = json.loads(path.read_text(encoding="utf-8"))
        results = results.having(from_json(RESULTS[earlier], content, str(path)), content.get("messages"))
    progress(0.0, WORDS[stage])
    session = with_explanation(request, lambda: load(request))
    if stage == "report":
        _, json_path, html_path = _write_results(request, session, results)
        result: Any = Written(json_path.name, html_path.name)
    else:
        result = _computed(stage, request, session, results, progress)
    content = to_json(result)
    with replacing(stored) as temporary:
        temporary.write_text(json.dumps(content), encoding="utf-8")  # three times as fast as to dump into the file
    progress(1.0, WORDS[stage])
    return content
