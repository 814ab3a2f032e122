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
from fitting.loop.session import Described, Prepared, Session
from fitting.residual.kinematics import GapScore, checkable, corrected, gap_error, gap_rows, score_gaps
from fitting.residual.terms import Model, fit_model
from fitting.selection import priors
from fitting.selection.evidence import log_sum
from fitting.selection.gaps import RatedGap, rated_gaps
from fitting.selection.posterior import MOST_NAMED
from fitting.signals.corrections import Corrections

Progress = Callable[[float, str], None]

_MOST_PER_JOINT = 2
_REBUILDS = 4
#: A sensor's steps are not noise: structure of a few hundredths of a step is significant and means nothing. What is
#: rebuilt has to take a tenth off the filtered gap at least.
LEAST_GAP_SHARE = 0.9
#: Share of its chi-square that one explanation may leave more than two, and still be the whole one.
LEFT_SHARE = 0.01
#: Share of the best gain from which on an explanation is rebuilt, to be compared by what it really leaves.
NEAR = 0.5


@dataclass(frozen=True)
class KinematicFinding:
    """An effect found between two position sensors.

    Attributes
    ----------
    steps : what was rebuilt, step by step: the effect with its values
    values, stds : totals of its parameters
    gain, score : chi-square of the gap that it takes, and its log posterior odds against nothing
    gap_before, gap_after : root mean square of the filtered gap on `validate` (`train` without one), m
    rivals : effects that explain the gap as well
    probability : that it is this; ``rival_probabilities`` of each rival
    """

    steps: tuple[GapScore, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    gain: float
    score: float
    gap_before: float
    gap_after: float
    rivals: tuple[str, ...]
    probability: float = 1.0
    rival_probabilities: tuple[float, ...] = ()

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
        """Scores on a joint's gap, the most gain first."""
        prepared = self.prepared
        return score_gaps(prepared.design, self.model.views, prepared.fitted, prepared.pairs, among, joint)[0]

    def rated(self, joint: int, found: float) -> list[RatedGap]:
        """Explanations of a joint's gap beside findings that took ``found`` of its chi-square, best first."""
        prepared = self.prepared
        scores, rows = score_gaps(prepared.design, self.model.views, prepared.fitted, prepared.pairs, effects(), joint)
        return rated_gaps(scores, rows, found)

    def gap(self, joint: int, without: GapScore | None = None) -> float:
        """Root mean square of a joint's filtered gap on `validate`, or on what is fitted, m, ``without`` a score."""
        return gap_error(
            self.prepared.design, self.prepared.validate or self.prepared.fitted, joint, self.model.views, without
        )


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
        there = {f.effect.id for f in found}
        rated = states[-1].rated(joint, sum(f.gain for f in found))
        usable = [r for r in rated if r.score.effect.id not in there]
        if not usable or log_sum([r.log_odds for r in usable]) < priors.SAID_ODDS:
            break
        following = _rebuilt(session, states[-1], usable)
        if following is None:
            break
        found.append(following[0])
        states.append(following[1])
        if found[-1].effect.stays_in_gap:
            break  # it is still in this gap, and would be taken for whatever resembles it
    if len(found) > 1:
        alone = _alone(session, start, found[-1], joint)
        if alone is not None and _left(alone[1], states[-1], joint, by=states[-1]) < LEFT_SHARE * alone[0].gain:
            return [alone[0]], alone[1]  # the first would not be added to the second
    return found, states[-1]


def _alone(
    session: Session, start: _State, second: KinematicFinding, joint: int
) -> tuple[KinematicFinding, _State] | None:
    """The second finding in the place of the first, where it can stand there."""
    if second.effect.stays_in_gap:
        return None
    rated = start.rated(joint, 0.0)
    own = [r for r in rated if r.score.effect.id == second.effect.id]
    return _rebuilt(session, start, [*own, *(r for r in rated if r not in own)]) if own else None


def _left(state: _State, other: _State, joint: int, by: _State) -> float:
    """Chi-square of the gap that one state leaves more than another, by the noise of a third."""
    rows = gap_rows(by.prepared.design, by.prepared.fitted, by.prepared.pairs, joint)

    def left(one: _State) -> float:
        design = one.prepared.design
        values = rows.whitened([design.segments[i].gap[:, joint] for i in rows.indices])
        return float(sum(v @ v for v in values))

    return left(state) - left(other)


def _rebuilt(session: Session, state: _State, usable: Sequence[RatedGap]) -> tuple[KinematicFinding, _State] | None:
    """The first of some explanations built into the positions, the others beside it; None if too little of it goes."""
    before = state.gap(usable[0].score.joint)
    near = [r for r in usable if r.score.gain > NEAR * usable[0].score.gain][:MOST_NAMED]
    built = {}
    for number, one in enumerate(near if len(near) > 1 else []):
        if not one.score.effect.stays_in_gap:  # what is rebuilt is compared by what is really left
            built[one.score.effect.id] = _steps(session, state.corrections, one.score)
            there = built[one.score.effect.id][1]
            more = _left(state, there, one.score.joint, by=state) - one.score.gain
            near[number] = replace(one, log_odds=one.log_odds + 0.5 * more)
    usable = sorted([*near, *(r for r in usable if r.score not in [n.score for n in near])], key=lambda r: -r.log_odds)
    best = usable[0].score
    if best.effect.stays_in_gap:  # it stays in the gap: judged by what its column takes away
        steps, changed = _placed(session, state.corrections, best)
        after = state.gap(best.joint, best)
        values = np.asarray(best.values)
    else:
        steps, changed = built.get(best.effect.id) or _steps(session, state.corrections, best)
        values = np.sum([step.values for step in steps], axis=0)
        after = changed.gap(best.joint)
    if after > LEAST_GAP_SHARE * before:
        return None
    total = log_sum([0.0, *(r.log_odds for r in usable)])
    shares = [float(np.exp(r.log_odds - total)) for r in usable]
    reached, rivals = shares[0], list[tuple[str, float]]()
    for other, share in sorted(zip(usable[1:], shares[1:], strict=True), key=lambda pair: -pair[1]):
        if reached >= priors.SAID or len(rivals) >= MOST_NAMED - 1:
            break
        if best.effect.id in other.score.effect.includes:
            continue  # only more general
        rivals.append((other.score.effect.id, share))
        reached += share
    finding = KinematicFinding(
        steps,
        tuple(values.tolist()),
        best.stds,
        best.gain,
        usable[0].log_odds,
        before,
        after,
        tuple(name for name, _ in rivals),
        shares[0],
        tuple(share for _, share in rivals),
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
    """What stays in the gap; play with its place, pin or piston's sensor: where less is left of the efforts.

    Friction jumps with the piston's own speed, so efforts tell whether the piston made the jump that its sensor did.
    """
    tried, noise = list[tuple[float, GapScore, _State]](), None
    for shape in best.effect.places(best.shape):
        step = replace(best, shape=shape)
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
            effect(step["effect"]), step["joint"], dict(step["shape"]), 0.0, 0, tuple(step["values"]), (), True
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
