"""Posterior odds of every candidate beside a model, against nothing more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.residual.laws import Law
from fitting.residual.refinement import refined
from fitting.residual.scoring import Candidates, Score, score_terms
from fitting.residual.simple_formulas import simple_curves
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.decision import Family, Rated, by_formula, family
from fitting.selection.evidence import (
    curve_evidence,
    curve_roots,
    expected_curve,
    formula_gains,
    log_mean,
    log_sum,
    named_evidence,
)
from fitting.selection.gains import Sizes
from fitting.selection.rated_names import RatedNames, is_curve, is_series
from fitting.selection.trust import Trust
from fitting.signals.splines import spline_knots

#: Basis functions that a law may have in the end: as many as its curve takes.
RESOLUTIONS = (4, 6, 8, 12, 16, 24, 32)
#: Degrees that a surface of two signals may have.
DEGREES = (2, 3, 4, 5)


class _RatedLaws:
    """Rates the laws of one signal: any smooth curve of it, or one of a few simple formulas.

    They are rated with a few functions; a law that is chosen has as many as its curve takes.

    Parameters
    ----------
    sizes, trust : how large laws can be, and which share of the candidates' gains counts
    """

    def __init__(self, sizes: Sizes, trust: Trust) -> None:
        self._candidates, self._sizes, self._trust = trust.candidates, sizes, trust

    def of_joint(
        self, joint: int, numbers: Sequence[int], scores: Mapping[int, Score], prior: float, covered: set[int]
    ) -> list[Rated]:
        """Rate a joint's laws, each with its log prior odds; ``covered`` are no simple formula by themselves."""
        groups: dict[tuple[int, bool], list[int]] = {}
        for n in numbers:
            groups.setdefault((self._candidates.width(n), n not in covered), []).append(n)
        found = dict[int, list[float]]()
        for (_, simple), own in groups.items():
            found |= zip(own, self._law_evidence(joint, own, scores, simple).tolist(), strict=True)
        ordered = sorted(numbers, key=self._candidates.width)
        rated = ((scores[n], found[n][0], found[n][1]) for n in ordered)
        return [Rated(score, prior + bayes, bayes, prior + bayes, left, left) for score, bayes, left in rated]

    def of_surface(self, joint: int, score: Score, prior: float, share: float, against: float) -> Rated:
        """Rate a surface of two signals, one of ``score.grid``: each of its coefficients is as free as any.

        Parameters
        ----------
        joint : where it is
        score : beside the model
        prior : log prior odds of a law
        share : of its gain that counts
        against : log odds that leftovers explain laws of this joint
        """
        gain, live = np.array([score.gain * share]), np.array([float(score.live)])
        bayes = float(log_mean(named_evidence(gain, live, priors.amplitudes(self._sizes.limit(score)))[0]))
        bayes -= float(np.log(score.grid))
        left = named_evidence(gain, live, self._sizes.left(joint, law=True))[0]
        leftover = float(log_sum(left, weights=priors.LEFTOVER_WEIGHTS))
        odds = prior + bayes - against
        return Rated(score, odds, bayes, odds, leftover, leftover, against)

    def _law_evidence(
        self, joint: int, numbers: Sequence[int], scores: Mapping[int, Score], simple: bool
    ) -> FloatArray:
        """Compute log evidence (T, 2) of laws of one width, alone and as what found effects leave.

        A law is any smooth curve, or, where it may be ``simple``, with :data:`priors.SIMPLE` a simple formula.
        """
        grams = np.array([self._trust.of(n) * scores[n].information for n in numbers])
        products = np.einsum("tij,tj->ti", grams, np.array([scores[n].values for n in numbers]))
        roots = curve_roots(len(products[0]), priors.LENGTHS)
        left = self._sizes.left(joint, law=True)
        limits = np.array([self._sizes.limit(scores[n]) for n in numbers])
        sizes = priors.amplitudes(float(limits.max()))
        bayes = log_mean(curve_evidence(grams, products, roots, sizes), axis=1)
        allowed = sizes[None, :] <= np.maximum(limits, priors.SMALLEST)[:, None] * priors.RATIO
        leftover = np.zeros((len(numbers), len(left)))
        if left.max() > 0:
            leftover = log_mean(curve_evidence(grams, products, roots, left), axis=1)
        if simple:
            short = [simple_curves(_law(scores[n]).knots) for n in numbers]
            gains, live = formula_gains(grams, products, np.array([curves for curves, _ in short]))
            listed = short[0][1]  # of every formula of the short list, its share
            bayes = _either(bayes, _formulas(gains, live, sizes, listed))
            leftover = _either(leftover, _formulas(gains, live, left, listed)) if left.max() > 0 else leftover
        bayes = log_sum(bayes, weights=allowed / allowed.sum(axis=1, keepdims=True))
        return np.stack([bayes, log_sum(leftover, weights=priors.LEFTOVER_WEIGHTS)], axis=1)


def _law(score: Score) -> Law:
    assert isinstance(score.term.content, Law)
    return score.term.content


def _formulas(gains: FloatArray, live: FloatArray, amplitudes: FloatArray, shares: FloatArray) -> FloatArray:
    """Compute log evidence (T, A) of a law as one of some formulas (F,): gains and live (T, F), shares (F,)."""
    found = named_evidence(gains.ravel(), live.ravel().astype(float), amplitudes)
    return log_sum(found.reshape(*gains.shape, -1), axis=1, weights=shares[:, None])


def _either(curve: FloatArray, formula: FloatArray) -> FloatArray:
    """Compute log evidence (T, A) of laws: any smooth curve, or with chance ``priors.SIMPLE`` a simple formula."""
    return log_sum(np.stack([curve, formula], axis=-1), weights=np.array([1 - priors.SIMPLE, priors.SIMPLE]))


def resolved(model: Model, score: Score) -> Score:
    """Return the law with the most probable number of basis functions, as narrow bumps need many; a curve as smooth
    as is most probable."""
    law = score.term.content
    assert isinstance(law, Law)
    contents: list[Law]
    if isinstance(law, Surface):
        contents = [law] if law.twist else [replace(law, degree=degree) for degree in DEGREES]
    else:
        values = np.concatenate([law.values(model.views[index][score.term.joint or 0]) for index in model.fitted])
        contents = [replace(law, knots=tuple(spline_knots(values, count).tolist())) for count in RESOLUTIONS]
    terms = [replace(score.term, content=content) for content in contents]
    trials = score_terms(model, terms, [score.grid] * len(terms))
    if not trials:
        return score
    gain, live = np.array([s.gain for s in trials]), np.array([float(s.live) for s in trials])
    shown = np.sqrt(np.maximum(gain.max(), 9.0))
    best = trials[int(np.argmax(named_evidence(gain, live, np.array([shown]))[:, 0]))]
    if isinstance(law, Surface):
        return best
    products = best.information @ np.asarray(best.values)
    sizes = priors.amplitudes(max(priors.USUAL_EFFORT, float(np.sqrt(best.gain))))
    expected = expected_curve(best.information, products, priors.LENGTHS, sizes)
    return replace(best, term=replace(best.term, expected=expected))


class Rating:
    """Posterior odds of candidates beside a model.

    Parameters
    ----------
    candidates : with their columns
    model : what is there
    visible : (n,) amplitude per joint of effects that were found, standard deviations
    failed : (n,) the same of names that did not hold elsewhere: what they lived on is open to a law of that joint
    overtones : number of a name to the number of its overtone, where a candidate is one
    settled : nothing more is looked for: gains are divided by how much noisier the rows are that show them
    """

    def __init__(
        self,
        candidates: Candidates,
        model: Model,
        visible: FloatArray,
        failed: FloatArray | None = None,
        overtones: Mapping[int, int] | None = None,
        settled: bool = False,
    ) -> None:
        self._visible, self._settled = visible, settled
        self._inflations: dict[int, float] = {}
        self._failed = np.zeros_like(visible) if failed is None else failed
        keys: dict[tuple[object, ...], int] = {}
        for number, term in enumerate(candidates.terms):
            law = term.content
            if is_curve(term) and isinstance(law, Law):
                keys[term.joint, law.signal, law.other, *law.parity, law.loaded_only] = number
        self._trust = Trust(candidates, model)
        sizes = Sizes(model, visible, self._failed)
        self._names = RatedNames(sizes, self._trust, keys, overtones or {})
        self._laws = _RatedLaws(sizes, self._trust)

    def rated(self, scores: Mapping[int, Score], surfaces: Sequence[Score] = ()) -> list[Rated]:
        """Rate all explanations of finite evidence, best first: ``scores`` as of :meth:`Candidates.scores`, and
        ``surfaces``, which are no candidates.
        """
        names, laws = _families(scores)
        catalogued = sum(f[0] != "law" for f in names)
        unknown = max(sum(len(own) for own in laws.values()) + len(names) - catalogued, 1)
        each = float(np.log(priors.CATALOGUE / priors.NOTHING / max(catalogued, 1)))
        law_each = float(np.log(priors.UNKNOWN / priors.NOTHING / unknown))
        self._trust.weigh(names.values(), laws.values(), scores)
        self._inflations = {}
        explained = partial(self._explanations, names, laws, scores, surfaces, each, law_each)
        rated = explained()
        if self._settled:
            heads: dict[int, Score] = {}
            for r in rated:
                if r.term.joint is not None and not r.term.everywhere and r.score.gain > priors.SMALLEST**2:
                    heads.setdefault(r.term.joint, r.score)
            self._inflations = self._trust.inflations(heads)
            self._trust.divide(self._inflations, scores)
            rated = explained()
        return rated

    def _explanations(
        self,
        names: Mapping[Family, Sequence[int]],
        laws: Mapping[int, Sequence[int]],
        scores: Mapping[int, Score],
        surfaces: Sequence[Score],
        each: float,
        law_each: float,
    ) -> list[Rated]:
        """Rate all explanations with the present shares of their gains; ``each`` and ``law_each`` are log priors."""
        result = self._names.of_families(names, scores, each, law_each)
        covered = self._covered(names, scores)
        for joint, own in laws.items():
            result += self._laws.of_joint(joint, own, scores, law_each, covered)
        result = _against_leftovers(result)
        return by_formula([*result, *(self._surface(score, law_each, result) for score in surfaces)])

    def _surface(self, score: Score, prior: float, rated: Sequence[Rated]) -> Rated:
        """Rate a surface beside the laws that were rated, each of log prior odds ``prior``."""
        joint = score.term.joint or 0
        laws = (r.against for r in rated if r.term.joint == joint and isinstance(r.term.content, Law))
        share = 1.0 / self._inflations.get(joint, 1.0)
        return self._laws.of_surface(joint, score, prior, share, next(laws, 0.0))

    def at_best_shape(self, rated: Rated, model: Model) -> Rated:
        """Search the shape of a name between the grid's, and rate the result.

        Shapes are averaged: a peak that is narrower than the grid holds that much less of what was expected of shapes.
        """
        found = refined(model, rated.score)
        if found is rated.score or found.term == rated.term:
            return rated
        terms = [found.term, rated.term, *(self._trust.candidates.terms[n] for n in self._names.own_laws(found.term))]
        effect = found.term.content
        overtone = effect.overtone(found.term.shape) if isinstance(effect, Effect) else None
        if overtone is not None:
            terms.append(replace(found.term, shape=overtone))
        small = Candidates(model, terms, [1] * len(terms))
        scores = small.scores(model)
        if 0 not in scores or 1 not in scores:
            return rated
        overtones = {} if overtone is None else {0: len(terms) - 1}
        rating = Rating(small, model, self._visible, self._failed, overtones)
        rating._trust.divide(self._inflations, scores)
        both = [rating._names.alone(number, scores) for number in (0, 1)]
        narrow = 0.5 * float(np.log1p(max(0.0, both[0].score.gain - both[1].score.gain)))
        more = both[0].log_bayes - both[1].log_bayes - narrow
        if more <= 0:
            return rated
        exact = max(0.0, both[0].exact - both[1].exact - narrow)
        return replace(
            rated,
            score=replace(found, null=None),
            log_odds=rated.log_odds + more,
            log_bayes=rated.log_bayes + more,
            exact=rated.exact + exact,
        )

    def _covered(self, names: Mapping[Family, Sequence[int]], scores: Mapping[int, Score]) -> set[int]:
        """Return laws that a catalogue's series covers: their simple formulas count for that name, not against it."""
        series = [scores[n].term for own in names.values() if is_series(scores[own[0]].term) for n in own]
        return {n for term in series for n in self._names.own_laws(term)}


def _families(scores: Mapping[int, Score]) -> tuple[dict[Family, list[int]], dict[int, list[int]]]:
    """Group candidates by number: names by family, laws by joint; lines are none."""
    names: dict[Family, list[int]] = {}
    laws: dict[int, list[int]] = {}
    for number, score in scores.items():
        term = score.term
        if term.is_line:
            continue
        if is_curve(term):
            laws.setdefault(term.joint or 0, []).append(number)
        else:
            names.setdefault(family(term), []).append(number)
    return names, laws


def _against_leftovers(rated: Sequence[Rated]) -> list[Rated]:
    """Rate against what found effects leave alone: in the direction of any candidate, by its prior."""
    places: dict[int | None, list[Rated]] = {}
    for r in rated:
        places.setdefault(r.term.place, []).append(r)
    result = []
    for own in places.values():
        prior = np.array([r.log_odds - r.log_bayes for r in own])
        for laws in (False, True):  # what did not hold elsewhere under a name is open to a law of its joint
            left = np.array([r.leftover if laws else r.refuted for r in own])
            nothing = max(0.0, float(log_sum(left + prior - log_sum(prior))))
            ours = [r for r in own if isinstance(r.term.content, Law) == laws]
            result += [
                replace(r, log_odds=r.log_odds - nothing, exact=r.exact - nothing, against=nothing) for r in ours
            ]
    return result
