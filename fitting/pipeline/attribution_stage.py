"""The residual loop as a step of the pipeline: what it found, as its result."""

from __future__ import annotations

from itertools import zip_longest

import numpy as np

from fitting.loop.attribution import attributed
from fitting.loop.closing import asked_of, next_experiment
from fitting.loop.everything import said
from fitting.loop.kinematic_check import corrections_from_json
from fitting.loop.noise_scale import words as noise_words
from fitting.loop.residual_loop import is_ripple, other_bands
from fitting.loop.session import Session
from fitting.pipeline.results.loop_results import (
    AcceptedTerm,
    Attributed,
    Bias,
    Cutoff,
    Designed,
    Limit,
    OtherBand,
    Program,
    Rival,
    SpectralLine,
    UnconfirmedLaw,
)
from fitting.pipeline.results.stage_results import Residual, StageResults
from fitting.pipeline.stage_names import NEXT_MOTION, Progress
from fitting.planning.detection import visible_size
from fitting.report.drawing_data import spline_curve
from fitting.residual.findings import Accepted, Attribution, Family, Unconfirmed
from fitting.residual.laws import Law
from fitting.residual.surfaces import second_variable
from fitting.selection.evidence import least_gain
from fitting.selection.gains import margin
from fitting.selection.posterior import together
from fitting.signals.corrections import Corrections

#: Chance with which an effect of the size of its detection limit is found.
LIMIT_POWER = 0.95


def attribution(session: Session, results: StageResults, progress: Progress) -> Attributed:
    """What the residual is traced to."""
    if not session.options.loop:
        return Attributed("not_examined", looked=False)
    corrections, search = found_corrections(session, results), session.search
    found = attributed(session, corrections, progress)
    names = tuple(joint.name for joint in session.machine.joints)
    warnings = [*found.warnings, *([] if search.whole else [said(search)])]
    warnings += noise_words(names, search.session.plain.rescaled)
    # Another bandwidth is asked only where it can change the verdict: not where structure is certain, or noise unknown.
    residual = results[Residual]
    silent = found.verdict == "nothing_missing" and not (residual.kinematics or residual.laws)
    silent = silent and all(residual.floor_valid)
    others = other_bands(search.session, corrections, progress) if silent else ()
    progress(0.92, "designing the experiment that tells rivals apart")
    result = Attributed(
        verdict=found.verdict,
        accepted=tuple(_accepted(a) for a in found.accepted),
        candidates=tuple(c for c in found.candidates if c.id != "law"),
        limits=_limits(found),
        hypotheses=together(residual.hypotheses, found.hypotheses),
        nothing=found.nothing,
        unconfirmed=tuple(_unconfirmed(item, names) for item in found.unconfirmed),
        lines=tuple(
            SpectralLine(
                joint=line.joint,
                frequency=(line.frequency_hz, line.frequency_std),
                amplitude=(line.amplitude, line.amplitude_std),
                p=line.p,
                in_band=bool(line.frequency_hz <= session.bank.bandwidth_hz),
                ripple=is_ripple(session.machine, line),
            )
            for line in found.lines
        ),
        changes=found.changes,
        other_bands=tuple(OtherBand(hz, tuple(_called(f, names) for f in families)) for hz, families in others),
        next_experiment=_next_experiment(search.session, found),
        warnings=tuple(warnings),
    )
    session.forget_search()
    return result


def _unconfirmed(item: Unconfirmed, names: tuple[str, ...]) -> UnconfirmedLaw:
    law, score = item.score.term.content, item.score
    assert isinstance(law, Law)
    covariance = np.asarray(np.linalg.pinv(score.information, rcond=1e-8, hermitian=True), float)
    return UnconfirmedLaw(
        joint=score.term.joint or 0,
        variable=law.variable(names),
        second_variable=second_variable(law, names).get("second_variable"),
        times_sign_of_speed=law.signed,
        only_while=law.only or None,
        unit=law.unit,
        law=spline_curve(law, np.array(score.values), covariance),
        evidence={
            "score": margin(score),
            "gain": score.gain,
            "held_out_gain": item.held_out.gain,
            "held_out_z": item.held_out.z,
            "validate_gain": item.validate_gain,
        },
    )


def _called(family: Family, names: tuple[str, ...]) -> str:
    """An effect and its joint in words."""
    name, joint = family
    what = "a law" if name == "law" else name
    return what if joint is None else f"{what} at {names[joint]}"


def _next_experiment(session: Session, found: Attribution) -> Designed | None:
    """The experiment that best separates the members of the first set, and its motion where the set is closable."""
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


def _accepted(item: Accepted) -> AcceptedTerm:
    score, null = item.score, item.score.null
    return AcceptedTerm(
        term=score.term,
        score=margin(score),
        gain=score.gain,
        surviving=score.surviving,
        held_out_gain=item.held_out.gain,
        held_out_z=item.held_out.z,
        validate_gain=item.validate_gain,
        witness=item.witness,
        cutoffs=tuple(Cutoff(*cutoff) for cutoff in item.cutoffs),
        null=None if null is None else Bias(null.draws, null.inflation),
        rivals=tuple(
            Rival(r.term.id, r.term.joint, margin(r), p)
            for r, p in zip_longest(item.rivals, item.rival_probabilities[: len(item.rivals)])
        ),
        probability=item.probability,
    )


def _limits(found: Attribution) -> tuple[Limit, ...]:
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
        smallest = visible_size(needed, score.live, LIMIT_POWER) * score.stds[told[0]]
        limits.append(Limit(score.term.id, score.term.joint, smallest, LIMIT_POWER, parameter.name, parameter.unit))
    return tuple(limits)


def found_corrections(session: Session, results: StageResults) -> Corrections:
    """The corrections of positions that the kinematic check found."""
    return corrections_from_json(session, results[Residual].steps)
