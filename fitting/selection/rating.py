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
from fitting.residual.scoring import Candidates, Score
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.decision import Family, Rated, by_formula, family
from fitting.selection.evidence import log_sum
from fitting.selection.gains import Sizes
from fitting.selection.rated_laws import RatedLaws
from fitting.selection.rated_names import RatedNames, is_curve, is_series
from fitting.selection.trust import Trust


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
        self._laws = RatedLaws(sizes, self._trust)

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
