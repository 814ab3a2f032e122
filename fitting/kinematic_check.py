"""The kinematic check of a session: two position sensors of a joint against each other, before any dynamics.

What is found is rebuilt into positions or linkages (:mod:`fitting.residual.kinematics`) and looked at again. Of two
findings on one joint, the second may be the whole truth and the first only what resembled it most: then it alone closes
the gap as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.effects import effect, effects
from fitting.effects.base import Effect
from fitting.residual.kinematics import (
    Corrections,
    GapScore,
    checkable,
    corrected,
    gap_error,
    gap_rows,
    score_gaps,
)
from fitting.residual.rules import ACCUSE, MISFIT_SHARE, MOST_RIVALS, SET_SHARE, SET_WIDTH
from fitting.residual.terms import Model, fit_model
from fitting.session import Described, Prepared, Session

Progress = Callable[[float, str], None]

_MOST_PER_JOINT = 2
_REBUILDS = 4
#: A sensor's steps are not noise: structure of a few hundredths of a step is significant and means nothing. What is
#: rebuilt has to take a tenth off the filtered gap at least.
LEAST_GAP_SHARE = 0.9


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


@dataclass(frozen=True)
class _State:
    """What is known of the positions so far, and the design on positions corrected so."""

    corrections: Corrections
    prepared: Prepared
    model: Model

    def scores(self, among: Sequence[Effect], joint: int) -> list[GapScore]:
        """Scores on a joint's gap, best first."""
        prepared = self.prepared
        return score_gaps(prepared.design, self.model.views, prepared.fitted, prepared.pairs, among, joint)[0]

    def gap(self, joint: int) -> float:
        """Root mean square of a joint's filtered gap on `validate`, or on what is fitted, m."""
        return gap_error(self.prepared.design, self.prepared.validate or self.prepared.fitted, joint)


def kinematic_findings(
    session: Session, progress: Progress = lambda fraction, text: None
) -> tuple[tuple[KinematicFinding, ...], Corrections]:
    """Check every joint that has two position sensors; returns what was found and the corrections."""
    state = _State(Corrections(session.machine), session.plain, session.base_model)
    found: list[KinematicFinding] = []
    joints = checkable(session.machine)
    for number, joint in enumerate(joints):
        progress(number / len(joints), f"comparing the position sensors of {session.machine.joints[joint].name}")
        own, state = _of_joint(session, state, joint)
        found += own
    return tuple(found), state.corrections


def _of_joint(session: Session, start: _State, joint: int) -> tuple[list[KinematicFinding], _State]:
    """What is found on one joint, and the state with that corrected."""
    found, states = list[KinematicFinding](), [start]
    if not any(start.prepared.design.segments[i].loaded for i in start.prepared.fitted):
        return found, start
    while len(found) < _MOST_PER_JOINT:
        scores = states[-1].scores(effects(), joint)
        usable = [s for s in scores if s.plausible and s.effect.id not in {f.effect.id for f in found}]
        if (
            not usable
            or usable[0].score <= ACCUSE
            or usable[0].gain < max((MISFIT_SHARE * f.gain for f in found), default=0)
        ):
            break
        following = _rebuilt(session, states[-1], usable[0], usable)
        if following is None:
            break
        found.append(following[0])
        states.append(following[1])
        if found[-1].effect.id == "backlash":
            break  # the play is still in this gap, and would be taken for whatever resembles it
    if len(found) > 1:
        alone = _alone(session, start, found[-1], joint)
        # The first would not be added to the second.
        if alone is not None and _left(alone[1], states[-1], joint) < max(ACCUSE, MISFIT_SHARE * alone[0].gain):
            return [alone[0]], alone[1]
    return found, states[-1]


def _alone(
    session: Session, start: _State, second: KinematicFinding, joint: int
) -> tuple[KinematicFinding, _State] | None:
    """The second finding in the place of the first, where it can stand there."""
    if second.effect.id == "backlash":
        return None
    usable = [s for s in start.scores(effects(), joint) if s.plausible]
    own = next((s for s in usable if s.effect.id == second.effect.id), None)
    return None if own is None else _rebuilt(session, start, own, usable)


def _left(state: _State, both: _State, joint: int) -> float:
    """Chi-square of the gap that a state leaves more than ``both`` does."""
    rows = gap_rows(both.prepared.design, both.prepared.fitted, both.prepared.pairs, joint)
    design = state.prepared.design
    values = [rows.whitening(design.bank.reduce(design.segments[i].gap[:, joint])) for i in rows.indices]
    return float(sum(v @ v for v in values)) - rows.chi_square


def _rebuilt(
    session: Session, state: _State, best: GapScore, usable: Sequence[GapScore]
) -> tuple[KinematicFinding, _State] | None:
    """A score built into the positions, with those that explain the gap as well; None if too little of it goes."""
    before = state.gap(best.joint)
    if best.effect.id == "backlash":  # it stays in the gap: judged by what its column takes away
        steps, changed = _placed(session, state.corrections, best)
        values = np.asarray(best.values)
        after = float(np.sqrt(max(before**2 - float(values[0]) ** 2 / 4, 0.0)))
    else:
        steps, changed = _steps(session, state.corrections, best)
        values = np.sum([step.values for step in steps], axis=0)
        after = changed.gap(best.joint)
    if after > LEAST_GAP_SHARE * before:
        return None
    width = max(SET_WIDTH, SET_SHARE * best.gain)
    rivals = dict.fromkeys(
        s.effect.id
        for s in usable
        if abs(best.score - s.score) < width and best.effect.id not in (s.effect.id, *s.effect.includes)
    )
    finding = KinematicFinding(
        steps, tuple(values.tolist()), best.stds, best.gain, best.score, before, after, tuple(rivals)[:MOST_RIVALS]
    )
    return finding, changed


def _steps(session: Session, corrections: Corrections, best: GapScore) -> tuple[tuple[GapScore, ...], _State]:
    """A finding built into the positions, step by step until nothing of it is left."""
    steps, step = list[GapScore](), best
    for _ in range(_REBUILDS):
        steps.append(step)
        corrections = corrected(corrections, step)
        prepared = session.prepared(corrections)
        state = _State(corrections, prepared, session.fit(prepared))
        step = next(s for s in state.scores((best.effect,), best.joint) if s.shape == best.shape)
        if np.all(np.abs(step.values) < 0.1 * np.asarray(step.stds)):
            break
    return tuple(steps), state


def _placed(session: Session, corrections: Corrections, best: GapScore) -> tuple[tuple[GapScore, ...], _State]:
    """Play with its place, in the pin or in the piston's sensor: where less is left of the efforts.

    Friction jumps with the piston's own speed, so efforts tell whether the piston made the jump that its sensor did.
    """
    tried, noise = list[tuple[float, GapScore, _State]](), None
    for sensor in (0.0, 1.0):
        step = replace(best, shape={**best.shape, "sensor": sensor})
        trial = corrected(corrections, step)
        prepared = session.prepared(trial)
        noise = noise or prepared.noise
        model = fit_model(prepared.design, noise, prepared.fitted, (), session.prior)
        excess = model.fit.chi_square - sum(map(len, model.fit.residual))
        tried.append((excess, step, _State(trial, prepared, model)))
    _, step, state = min(tried, key=lambda place: place[0])
    return (step,), state


def corrections_from_json(session: Described, steps: Sequence[Mapping[str, Any]]) -> Corrections:
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
