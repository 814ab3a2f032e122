"""The kinematic check of a session: two position sensors of a joint against each other, before the efforts.

Every joint's gap has a posterior over sets of effects and laws (:mod:`fitting.selection.gaps`). Each geometry that it
leaves is rebuilt into positions or linkages, the arm's forces are fitted again with that, and the gap as it was
measured is looked at once more with the forces of each. Between explanations that it leaves then, the efforts decide:
an encoder that is off turns the link in the model, a pin that is off changes a lever arm, and play is at the pin or in
the sensor.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import scipy

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.loop.session import Prepared, Session
from fitting.progress import Progress, quiet
from fitting.regression.drive import drive_columns, known_effort
from fitting.residual.confirmation.robustness import Leftover
from fitting.residual.findings import LEAST, MOST_LISTED, Hypothesis, combined
from fitting.residual.kinematics import (
    GapLaw,
    GapRows,
    GapScore,
    checkable,
    corrected,
    gap_columns,
    gap_error,
    gap_rows,
    with_forces,
)
from fitting.residual.terms import Model
from fitting.residual.views import Views
from fitting.selection import priors
from fitting.selection.decision import tempering
from fitting.selection.gaps import APART, GapConclusion, GapPosterior, GapSet, Pose, gap_posterior
from fitting.signals.corrections import Corrections

#: Times that an error of geometry is rebuilt until nothing of it is left.
_REBUILDS = 4


@dataclass(frozen=True)
class KinematicFinding:
    """An effect found between two position sensors.

    Attributes
    ----------
    steps : what was rebuilt, step by step: the effect with its values
    values, stds : totals of its parameters
    gain, score : chi-square of the gap that it takes, and its log posterior odds against nothing
    gap_before, gap_after : root mean square of the filtered gap on `validate` (`train` without one), m, before and
        after everything that was found on the joint
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
class KinematicLaw:
    """A law of the gap that no effect of the catalogue is: it is reported, and nothing is rebuilt.

    Attributes
    ----------
    joint, law : where, and of what
    values, covariance : of its spline, m
    gain : chi-square of the gap that it takes
    probability : that it is this; ``could_be`` effects that it may be all the same, with their probabilities
    """

    joint: int
    law: GapLaw
    values: FloatArray
    covariance: FloatArray
    gain: float
    probability: float
    could_be: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Kinematics:
    """Findings between the position sensors of all joints.

    Attributes
    ----------
    findings, laws : of all joints
    corrections : of the positions
    hypotheses : explanations of all joints' gaps, the most probable first
    """

    corrections: Corrections
    findings: tuple[KinematicFinding, ...] = ()
    laws: tuple[KinematicLaw, ...] = ()
    hypotheses: tuple[Hypothesis, ...] = field(default_factory=lambda: (Hypothesis((), 1.0),))


def kinematics(session: Session, progress: Progress = quiet) -> Kinematics:
    """Check every joint that has two position sensors."""
    posteriors = gap_posteriors(session, progress)
    corrections, findings, laws = Corrections(session.machine), list[KinematicFinding](), list[KinematicLaw]()
    for joint, own in posteriors.items():
        rebuilt, corrections = _rebuilt(session, corrections, own)
        if rebuilt is None:  # what would be rebuilt does not make the mismatch smaller on `validate`
            posteriors[joint] = own = own.without([one.name for one in own.conclusions() if one.part is not None])
        findings += rebuilt or []
        laws += [_law(own, one) for one in own.conclusions() if one.part is None]
    return Kinematics(corrections, tuple(findings), tuple(laws), _hypotheses(posteriors))


def gap_posteriors(session: Session, progress: Progress = quiet) -> dict[int, GapPosterior]:
    """Compute the posterior of the gap of every joint with two position sensors, by joint number."""
    plain, model, joints = session.plain, session.base_model, checkable(session.machine)
    posteriors = dict[int, GapPosterior]()
    if not any(plain.design.segments[i].loaded for i in plain.fitted):
        return posteriors
    for number, joint in enumerate(joints):
        name = session.machine.joints[joint].name
        progress(number / len(joints), Sentence("fitting.comparing_position_sensors", joint=name))
        posteriors[joint] = gap_posterior({(): with_forces(_rows(session, plain, model.views, joint), model)})
    for joint, own in posteriors.items():
        if own.sets[0][0].names:
            posteriors[joint] = _again(session, posteriors, joint)
    return posteriors


def _rows(session: Session, prepared: Prepared, views: Views, joint: int) -> GapRows:
    """Compute the whitened gap of a joint."""
    return gap_rows(prepared.design, views, prepared.fitted, prepared.pairs, session.sensor_errors, joint)


def _again(session: Session, posteriors: Mapping[int, GapPosterior], joint: int) -> GapPosterior:
    """Compute a joint's posterior with the forces of the arm as each set has it, and with the efforts' evidence.

    An encoder that is off turns the link in the model, and with it the load that bends the structure; what gives way
    is between the sensors, of which no mean is right then. So the base is fitted with the positions as each set has
    them, those of the other joints as their best sets have them.
    """
    own, start, fits = posteriors[joint], Corrections(session.machine), dict[Pose, Model]()
    for other in (other for j, other in posteriors.items() if j != joint):
        start = _rebuilt_by(start, other, other.sets[0][0])

    def fit(corrections: Corrections) -> Model:
        if corrections == Corrections(session.machine):
            return session.base_model
        return session.fit(session.prepared(corrections, known=session.base_model))

    def fit_all(posterior: GapPosterior, poses: Collection[Pose] = ()) -> None:
        for chosen, p in posterior.sets:
            if (p > LEAST or chosen.pose in poses) and chosen.pose not in fits:
                with suppress(ValueError):  # no linkage has such lengths
                    fits[chosen.pose] = fit(_rebuilt_by(start, posterior, chosen))

    if APART in own.sets[0][0].pose:
        apart = fit(start.with_play(session.machine.joints[joint].name, "pin"))
        views = tuple(apart.views[index][joint] for index in own.rows.indices)
        own = gap_posterior({(): with_forces(replace(own.rows, design=apart.design, views=views), apart)})
    driven = [np.hstack([part.columns, part.rates]) for part in own.sets[0][0].parts if part.effect.between_sensors]
    rows = replace(own.rows, beside=driven[0] if driven else None)
    # As long as forces are bent by what is between the sensors, they choose nothing but whether something gives way.
    gives_way = APART in own.sets[0][0].pose
    fit_all(own, {chosen.pose for chosen, _ in own.sets if (APART in chosen.pose) == gives_way})
    names = {name for chosen, p in own.sets for name in chosen.names if p > LEAST}
    again = gap_posterior({pose: with_forces(rows, model) for pose, model in fits.items()}, names)
    fit_all(again)
    return _with_efforts(again, fits)


def _with_efforts(posterior: GapPosterior, fits: Mapping[Pose, Model]) -> GapPosterior:
    """Weight a posterior that leaves several sets by the efforts' evidence of their poses.

    The chi-square that each one's model leaves counts, divided by how much noisier the rows are that separate two
    sets, and as far as a formula counts (:func:`fitting.selection.decision.tempering`).
    """
    sets = [pair for pair in posterior.sets if pair[1] > LEAST and pair[0].pose in fits]
    if posterior.sets[0][1] >= priors.CREDIBLE or len({chosen.pose for chosen, _ in sets}) < 2:
        return posterior
    rest = [pair for pair in posterior.sets if pair[1] <= LEAST or pair[0].pose not in fits]
    least = min((fits[chosen.pose] for chosen, _ in sets), key=_left)
    left, spread = Leftover.of(least), _spread(least)
    behind, sizes = list[float](), list[float]()
    for model in (fits[chosen.pose] for chosen, _ in sets):
        both = zip(_spread(model), spread, strict=True)
        apart = {n: ((own - best) * there)[kept] for n, ((own, there), (best, kept)) in enumerate(both)}
        behind.append(0.5 * (_left(model) - _left(least)) / left.inflation(apart))
        sizes.append(sum(float(each @ each) for each in apart.values()))
    odds = np.log([p for _, p in sets])[:, None] - np.array(behind)[:, None] * tempering(np.array(sizes)[:, None])
    chances = np.exp(odds - scipy.special.logsumexp(odds, axis=0)) @ np.array(priors.PHYSICS) * sum(p for _, p in sets)
    pairs = [(chosen, p) for (chosen, _), p in zip(sets, chances.tolist(), strict=True)]
    return replace(posterior, sets=tuple(sorted([*pairs, *rest], key=lambda pair: -pair[1])))


def _rebuilt_by(start: Corrections, posterior: GapPosterior, chosen: GapSet) -> Corrections:
    """Return corrections with the effects of a set rebuilt as well; ``start`` itself without any."""
    corrections = start
    for score in posterior.scores(chosen):
        corrections = corrected(corrections, score)
    return corrections


def _left(model: Model) -> float:
    """Compute the chi-square beyond one of each row."""
    return model.fit.chi_square - sum(map(len, model.fit.residual))


def _spread(model: Model) -> list[tuple[FloatArray, npt.NDArray[np.bool_]]]:
    """Spread each joint's whitened residual over all rows, 0 where not fitted, with that mask; a prior's last."""
    result = []
    for joint, own in enumerate(model.fit.residual):
        rows = [model.design.kept(model.noise, joint, index) for index in model.fitted]
        there = np.concatenate([*rows, np.ones(len(own) - sum(map(np.count_nonzero, rows)), dtype=bool)])
        spread = np.zeros(len(there))
        spread[there] = own
        result.append((spread, there))
    return result


def _rebuilt(
    session: Session, start: Corrections, posterior: GapPosterior
) -> tuple[list[KinematicFinding] | None, Corrections]:
    """Rebuild a joint's findings into the positions until nothing of its gap is left; None where that is not less."""
    conclusions = posterior.conclusions()
    scores = posterior.scores(conclusions[0].chosen) if conclusions else ()
    if not scores:
        return [], start
    joint, corrections, steps = scores[0].joint, start, {score.effect.id: [score] for score in scores}
    driven = [score for score in scores if score.effect.between_sensors]
    for number in range(_REBUILDS):
        for own in steps.values():
            if not own[0].effect.between_sensors and len(own) > number:
                corrections = corrected(corrections, own[number])
        prepared, left = session.prepared(corrections), tuple[GapScore, ...]()
        model = session.fit(prepared)
        rows = _rows(session, prepared, model.views, joint)
        parts = [gap_columns(rows, own.effect, own.shape) for own in scores]
        if len(rows.values):
            left = GapPosterior(rows).scores(GapSet(tuple(part for part in parts if part is not None)))
        rest = [own for own in left if not own.effect.between_sensors]
        if all(np.all(np.abs(own.values) < 0.1 * np.asarray(own.stds)) for own in rest):
            break
        for more in rest:
            steps[more.effect.id].append(more)
    for score in driven:
        placed, corrections = _placed(session, corrections, score)
        steps[score.effect.id] = [placed]
    before, after = _gaps(session, prepared, model, joint, driven)
    if after >= before:
        return None, start
    nothing = next((p for own, p in posterior.sets if not own.names), 0.0)
    findings = []
    for one in conclusions:
        if one.part is not None:
            own, first = steps[one.name], next(score for score in scores if score.effect.id == one.name)
            values = tuple(np.sum([step.values for step in own], axis=0).tolist())
            odds = float(np.log(max(one.probability, 1e-300) / max(nothing, 1e-300)))
            names, chances = tuple(name for name, _ in one.rivals), tuple(p for _, p in one.rivals)
            sizes = tuple(own), values, first.stds, first.gain, odds, before, after
            findings.append(KinematicFinding(*sizes, names, one.probability, chances))
    return findings, corrections


def _gaps(
    session: Session, prepared: Prepared, model: Model, joint: int, driven: Sequence[GapScore]
) -> tuple[float, float]:
    """Compute the RMS of a joint's filtered gap as measured, and less the findings, m."""
    plain, indices = session.plain, prepared.validate or prepared.fitted
    explained = []
    for view in (model.views[i][joint] for i in indices if prepared.design.segments[i].loaded):
        changes = (score.effect.gap_change(view, score.shape, score.values) for score in driven)
        explained.append(sum((own for own in changes if own is not None), np.zeros(len(view))))
    before = gap_error(plain.design, plain.validate or plain.fitted, joint)
    return before, gap_error(prepared.design, indices, joint, explained)


def _placed(session: Session, corrections: Corrections, score: GapScore) -> tuple[GapScore, Corrections]:
    """Place what is left in the gap before the piston's sensor or in it, where the efforts show which."""
    places = score.effect.places(score.shape)
    if len(places) > 1:
        reading_alone = session.fit(session.prepared(corrected(corrections, replace(score, shape=places[1]))))
        odds = _log_odds_of_moving(reading_alone, score)
        if abs(odds) > priors.CREDIBLE_ODDS:
            score = replace(score, shape=places[int(odds < 0)])
    return score, corrected(corrections, score)


def _log_odds_of_moving(model: Model, score: GapScore) -> float:
    """Return the log odds that the piston moves by the gap, and not its reading alone, of a model of the latter.

    Friction and inertia follow the piston's own motion: with a change ``D`` of the effort that is predicted for that,
    what the model leaves is ``D`` and noise, or noise, as large as it is in these rows.
    """
    design, joint, rows = model.design, score.joint, list[FloatArray]()
    theta = model.fit.theta[design.parameters.drive_slice(joint)]

    def effort(x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        columns = drive_columns(design.parameters.drive[joint], x, v, a, design.noise[joint].sign)
        return np.asarray(columns @ theta + known_effort(design.machine.joints[joint], v, a))

    for index in model.fitted:
        view, change = model.views[index][joint], None
        if view.segment.loaded:
            change = score.effect.gap_change(view, score.shape, score.values)
        gap = np.zeros(len(view)) if change is None else change
        rate = design.bank.rate(gap)
        moved = effort(view.x + gap, view.v + rate, view.a + design.bank.rate(rate)) - effort(view.x, view.v, view.a)
        rows.append(design.white(model.noise, joint, index, design.bank.reduce(moved)))
    D = np.concatenate(rows)
    left = model.fit.residual[joint][: len(D)]
    taken = model.fit.orthonormal[joint][: len(D)].T @ D
    return float(D @ left - 0.5 * (D @ D - taken @ taken)) / Leftover.of(model).inflation({joint: D})


def _law(posterior: GapPosterior, conclusion: GapConclusion) -> KinematicLaw:
    """Return the law of a set with its curve."""
    law, curve = conclusion.chosen.law, posterior.curve(conclusion.chosen)
    assert law is not None
    return KinematicLaw(posterior.rows.joint, law, *curve, conclusion.probability, conclusion.rivals)


def _hypotheses(posteriors: Mapping[int, GapPosterior]) -> tuple[Hypothesis, ...]:
    """Combine whole explanations of all gaps; joints are independent."""
    sets = {joint: posterior.sets[:MOST_LISTED] for joint, posterior in posteriors.items()}
    return combined([[(own.terms(joint), p) for own, p in there if p > LEAST] for joint, there in sets.items()])
