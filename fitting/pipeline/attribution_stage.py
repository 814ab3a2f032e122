"""The residual loop as a step of the pipeline: what it found, as its result."""

from __future__ import annotations

import numpy as np

from daq.messages import Sentence
from fitting.loop.closing import asked_of, next_experiment
from fitting.loop.everything import search_note
from fitting.loop.noise_scale import words as noise_words
from fitting.loop.residual_loop import attributed, other_bands
from fitting.loop.session import Session
from fitting.pipeline.results.loop_content import accepted_term, detection_limits, unconfirmed_law
from fitting.pipeline.results.loop_results import Attributed, Designed, OtherBand, Program
from fitting.pipeline.results.stage_results import Residual, StageResults
from fitting.pipeline.stage_names import NEXT_MOTION, Progress
from fitting.residual.findings import Attribution, Family
from fitting.residual.stored_terms import corrections_from_json
from fitting.selection.posterior import together


def attribution(session: Session, results: StageResults, progress: Progress) -> Attributed:
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
