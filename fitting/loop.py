"""The residual loop on a session: kinematics, then attribution; signals are rebuilt where columns fall short."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.effects import effect, effects
from fitting.effects.base import Effect
from fitting.prior import Prior
from fitting.residual.attribution import (
    ACCUSE,
    MISFIT_SHARE,
    MOST_RIVALS,
    SET_SHARE,
    SET_WIDTH,
    Attribution,
    attribute,
)
from fitting.residual.kinematics import Corrections, GapScore, checkable, corrected, gap_error, score_gaps
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term, fit_model
from fitting.session import Prepared, Session

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[float, str], None]

_MOST_PER_JOINT = 2
_REBUILDS = 4


@dataclass(frozen=True)
class KinematicFinding:
    """An effect found between two position sensors.

    Attributes
    ----------
    steps : what was rebuilt, step by step: the effect with its values
    values, stds : totals of its parameters
    gain, score : chi-square of the gap, and the same less its price
    gap_before, gap_after : root mean square of the filtered gap on `validate` (`train` without one), m
    rivals : effects that explain the gap as well
    """

    steps: tuple[GapScore, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    gain: float
    score: float
    gap_before: float
    gap_after: float
    rivals: tuple[str, ...]

    @property
    def effect(self) -> Effect:
        """The effect."""
        return self.steps[0].effect

    @property
    def joint(self) -> int:
        """Its joint's number."""
        return self.steps[0].joint


def kinematic_findings(
    session: Session, progress: Progress = lambda fraction, text: None
) -> tuple[tuple[KinematicFinding, ...], Corrections]:
    """Check every joint that has two position sensors; returns what was found and the corrections."""
    corrections = Corrections(session.machine)
    found: list[KinematicFinding] = []
    joints = checkable(session.machine)
    prepared, model = session.plain, session.base_model
    for number, joint in enumerate(joints):
        progress(number / len(joints), f"comparing the position sensors of {session.machine.joints[joint].name}")
        for _ in range(_MOST_PER_JOINT):
            if not any(prepared.design.segments[i].loaded for i in prepared.fitted):
                break
            scores = _gap_scores(prepared, model, effects(), joint)
            taken = {f.effect.id for f in found if f.joint == joint}
            usable = [s for s in scores if s.plausible and s.effect.id not in taken]
            earlier = max((f.gain for f in found if f.joint == joint), default=0.0)
            if not usable or usable[0].score <= ACCUSE or usable[0].gain < MISFIT_SHARE * earlier:
                break
            best = usable[0]
            shown = prepared.validate or prepared.fitted
            before = gap_error(prepared.design, shown, joint)
            trial, steps = corrections, []
            step = best
            values = np.zeros(len(best.values))
            for _ in range(_REBUILDS):
                steps.append(step)
                values += step.values
                trial = corrected(trial, step)
                changed = session.prepared(trial)
                again = _gap_scores(changed, session.fit(changed), (best.effect,), joint)
                step = next(s for s in again if s.shape == best.shape)
                if best.effect.id == "backlash" or np.all(np.abs(step.values) < 0.1 * np.asarray(step.stds)):
                    break
            after = gap_error(changed.design, shown, joint)
            if best.effect.id == "backlash":  # play stays in the gap: judged by what its column takes away
                after = float(np.sqrt(max(before**2 - float(values[0]) ** 2 / 4, 0.0)))
            if after >= before:
                break
            width = max(SET_WIDTH, SET_SHARE * best.gain)
            rivals = dict.fromkeys(
                s.effect.id for s in usable if s.effect.id != best.effect.id and best.score - s.score < width
            )
            found.append(
                KinematicFinding(
                    tuple(steps),
                    tuple(values.tolist()),
                    best.stds,
                    best.gain,
                    best.score,
                    before,
                    after,
                    tuple(rivals)[:MOST_RIVALS],
                )
            )
            corrections, prepared = trial, changed
            model = session.fit(prepared)
            if best.effect.id == "backlash":
                break  # the play is still in this gap, and would be taken for whatever resembles it
    return tuple(found), corrections


def _gap_scores(prepared: Prepared, model: Model, among: Sequence[Effect], joint: int) -> list[GapScore]:
    scores, _ = score_gaps(prepared.design, model.views, prepared.fitted, prepared.pairs, among, joint)
    return scores


class SessionSignals:
    """Refits on a session's recordings: positions corrected as kinematics found, delays as accepted terms say."""

    def __init__(self, session: Session, corrections: Corrections) -> None:
        self._session = session
        self._corrections = corrections
        self._prepared: dict[tuple[tuple[str, float], ...], Prepared] = {}

    @property
    def prior(self) -> Prior:
        """What is known before any measurement."""
        return self._session.prior

    def prepared(self, terms: Sequence[Term]) -> Prepared:
        """The design on signals corrected as the terms say; the last one is kept."""
        late = delays(self._session, terms)
        key = tuple(sorted(late.items()))
        if key not in self._prepared:
            untouched = self._corrections == Corrections(self._session.machine) and not late
            design = self._session.plain if untouched else self._session.prepared(self._corrections, late)
            self._prepared = {key: design}
        return self._prepared[key]

    def refit(self, terms: Sequence[Term]) -> Model:
        """Both stages refitted jointly with these terms."""
        prepared = self.prepared(terms)
        return fit_model(
            prepared.design, prepared.noise, prepared.fitted, terms, self._session.prior, passes=3 if terms else 1
        )

    def rebuilt(self, model: Model) -> Model:
        """Move the effort in time instead of approximating it, once ``sensor_latency`` is the last term."""
        if model.terms[-1].id != "sensor_latency":
            return model
        for _ in range(_REBUILDS):
            part = model.term_slice(len(model.terms) - 1)
            late = float(model.fit.theta[part][0])
            if abs(late) < 0.05 * float(model.fit.std[part][0]):
                break
            already = sum(model.terms[-1].rebuilt)
            model = self.refit((*model.terms[:-1], replace(model.terms[-1], rebuilt=(already + late,))))
        return model


def delays(session: Session, terms: Sequence[Term]) -> dict[str, float]:
    """Joint name to seconds by which accepted terms say its effort is late."""
    return {
        session.machine.joints[t.joint].name: t.rebuilt[0]
        for t in terms
        if t.id == "sensor_latency" and t.rebuilt and t.joint is not None
    }


def run_attribution(
    session: Session, corrections: Corrections, progress: Progress = lambda fraction, text: None
) -> Attribution:
    """Attribution of what the efforts leave, on signals with the kinematic corrections rebuilt."""
    signals = SessionSignals(session, corrections)
    validate = signals.prepared(()).validate
    return attribute(signals.refit(()), effects(), validate, signals, progress)


def final_model(session: Session, corrections: Corrections, terms: Sequence[Term]) -> tuple[Prepared, Model]:
    """Both stages refitted jointly with everything that was found."""
    signals = SessionSignals(session, corrections)
    return signals.prepared(terms), signals.refit(terms)


def term_to_json(term: Term) -> dict[str, Any]:
    """A term as plain JSON; :func:`term_from_json` reads it back."""
    content = term.content
    law = None
    if isinstance(content, Law):
        law = {
            "signal": content.signal,
            "other": content.other,
            "signed": content.signed,
            "loaded_only": content.loaded_only,
            "knots": list(content.knots),
        }
    return {
        "effect": None if isinstance(content, Law) else content.id,
        "law": law,
        "joint": term.joint,
        "shape": dict(term.shape),
        "rebuilt": list(term.rebuilt),
    }


def term_from_json(value: Mapping[str, Any]) -> Term:
    """Inverse of :func:`term_to_json`."""
    law = value["law"]
    content: Effect | Law = (
        effect(value["effect"])
        if law is None
        else Law(law["signal"], law["other"], law["signed"], law["loaded_only"], tuple(law["knots"]))
    )
    return Term(content, value["joint"], dict(value["shape"]), tuple(value["rebuilt"]))


def corrections_from_json(session: Session, steps: Sequence[Mapping[str, Any]]) -> Corrections:
    """Corrections from the ``steps`` of stored kinematic findings, in order."""
    corrections = Corrections(session.machine)
    for step in steps:
        score = GapScore(
            effect(step["effect"]), step["joint"], dict(step["shape"]), 0.0, 0.0, tuple(step["values"]), (), True
        )
        corrections = corrected(corrections, score)
    return corrections


def step_to_json(step: GapScore) -> dict[str, Any]:
    """One rebuilt step as plain JSON."""
    return {
        "effect": step.effect.id,
        "joint": step.joint,
        "shape": dict(step.shape),
        "values": list(step.values),
    }
