"""Posterior odds of every candidate against nothing more: beside one model, and beside each that a search comes to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects import effects
from fitting.effects.base import Effect
from fitting.residual.laws import Law
from fitting.residual.refinement import refined
from fitting.residual.scoring import Candidates, Score, catalogue_terms, law_terms, score_terms
from fitting.residual.surfaces import best_surface, surfaces
from fitting.residual.terms import Model, Term
from fitting.selection import priors
from fitting.selection.decision import Family, Rated, by_formula, family
from fitting.selection.evidence import log_sum, named_evidence
from fitting.selection.gains import Sizes
from fitting.selection.rated_laws import RatedLaws, resolved
from fitting.selection.rated_names import RatedNames, is_curve, is_series
from fitting.selection.trust import BEYOND_BIAS, Draws, Trust

#: Explanations of a joint whose shapes are searched.
WIDTH = 4
#: Share of the best gain from which on a name is looked at closer.
NEAR = 0.25
#: Contenders whose null is drawn.
MOST_CONTENDERS = 12


class Rating:
    """Posterior odds of candidates beside a model.

    Parameters
    ----------
    candidates : with their columns
    model : what is there
    visible : (n,) amplitude per joint of effects that were found, standard deviations
    overtones : number of a name to the number of its overtone, where a candidate is one
    settled : nothing more is looked for: gains are divided by how much noisier the rows are that show them
    """

    def __init__(
        self,
        candidates: Candidates,
        model: Model,
        visible: FloatArray,
        overtones: Mapping[int, int] | None = None,
        settled: bool = False,
    ) -> None:
        self._visible, self._settled = visible, settled
        self._inflations: dict[int, float] = {}
        keys: dict[tuple[object, ...], int] = {}
        for number, term in enumerate(candidates.terms):
            law = term.content
            if is_curve(term) and isinstance(law, Law):
                keys[term.joint, law.signal, law.other, *law.parity, law.loaded_only] = number
        self._trust = Trust(candidates, model)
        sizes = Sizes(model, visible)
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
        result = self._against_leftovers(result, scores)
        return by_formula([*result, *(self._surface(score, law_each, result) for score in surfaces)])

    def _against_leftovers(self, rated: Sequence[Rated], scores: Mapping[int, Score]) -> list[Rated]:
        """Rate against what found effects leave alone: in the direction of any candidate, by its prior.

        That is there beside what explains another joint as well, but for what both explain by way of the base.
        """
        places: dict[int | None, list[Rated]] = {}
        for r in rated:
            places.setdefault(r.term.place, []).append(r)
        result, nothing, heads = list[Rated](), dict[int, float](), dict[int, Rated]()
        for place, own in places.items():
            prior = np.array([r.log_odds - r.log_bayes for r in own])
            left = np.array([r.leftover for r in own])
            here = max(0.0, float(log_sum(left + prior - log_sum(prior))))
            result += [replace(r.held_against(here), against=here) for r in own]
            if place is not None and here > 0:
                nothing[place], heads[place] = here, own[int(np.argmax(left + prior))]
        asked = [r for r in result if r.term.place is not None and r.log_odds > 0] if heads else []
        if not asked:
            return result
        numbers = {score.term.label: n for n, score in scores.items()}
        one, two = ([numbers[r.term.label] for r in own] for own in (asked, heads.values()))
        elsewhere = np.array([[r.term.place != place for place in heads] for r in asked])
        lost = (self._trust.common(one, two, scores) * elsewhere) @ np.array(list(nothing.values()))
        more = dict(zip((r.term.label for r in asked), lost.tolist(), strict=True))
        return [r.held_against(more.get(r.term.label, 0.0)) for r in result]

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
        rating = Rating(small, model, self._visible, overtones)
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


@dataclass(frozen=True)
class _Scored:
    """Scores of all candidates beside a model by their number."""

    model: Model
    scores: dict[int, Score]


class Ratings:
    """Catalogue, laws and twists with their columns, rated beside one model after the other.

    Parameters
    ----------
    base : joint fit of the base model
    draws : of replicas, which take the bias of noisy regressors off contenders
    once : they are rated beside the base alone
    """

    def __init__(self, base: Model, draws: Draws, once: bool = False) -> None:
        terms, grid = catalogue_terms(base, effects())
        laws, law_grid = law_terms(base)
        joints = range(len(base.design.machine.joints))
        twists = [Term(law, joint) for joint in joints for law in surfaces(base, joint, twist=True)]
        self.draws = draws
        grid += [*law_grid, *[len(twists)] * len(twists)]
        self._candidates = Candidates(base, [*terms, *laws, *twists], grid, once)
        self._scored = _Scored(base, self._candidates.scores(base))
        self._before = self._scored  # beside the model that the last term was added to
        self._fresh: set[int] = set()  # candidates whose columns were made anew since
        self._rating: Rating

    @property
    def before(self) -> Model:
        """The model that the last term was added to."""
        return self._before.model

    def added(self) -> None:
        """Keep the scores beside the last rated model: a term was added to it."""
        self._before = self._scored
        self._fresh.clear()

    def rated(self, model: Model, visible: FloatArray, settled: bool, surfaces: Sequence[Score] = ()) -> list[Rated]:
        """Rate all candidates, and ``surfaces``, beside a model; the noisy regressors' bias is taken off contenders.

        Scores of the last model are kept: after a rejection only the odds against leftovers change.

        Parameters
        ----------
        visible, settled : as of :class:`fitting.selection.rating.Rating`
        """
        if self._scored.model is not model:
            self._scored = self._scores_beside(model)
        scores = self._scored.scores
        self._rating = Rating(self._candidates, model, visible, settled=settled)
        surfaces = score_terms(model, [s.term for s in surfaces], [s.grid for s in surfaces])
        rated = self._rating.rated(scores, surfaces)
        number = {score.term.label: n for n, score in scores.items()}  # of a surface no replicas are drawn
        # What was drawn may lose by it, and others contend then: they are drawn as well.
        while chosen := [r for r in _contending(rated) if r.term.label in number and self.draws.open(r)]:
            for score in self.draws.unbiased(model, chosen):
                scores[number[score.term.label]] = score
            rated = self._rating.rated(scores, surfaces)
        return rated

    def at_best_shapes(self, rated: Sequence[Rated]) -> list[Rated]:
        """Rate explanations beside the last rated model, shapes of names near their joint's best searched.

        A spline adapts itself; a formula is compared with it at its best shape.
        """
        if not rated:
            return []
        head = rated[0]
        near = [
            r
            for r in rated
            if r.term.joint == head.term.joint
            and isinstance(r.term.content, Effect)
            and r.score.gain > NEAR * head.score.gain
        ][:WIDTH]
        refined_names = [self._rating.at_best_shape(r, self._scored.model) for r in near]
        return by_formula([*refined_names, *(r for r in rated if r not in near)])

    def _scores_beside(self, model: Model) -> _Scored:
        """Score all candidates beside a model, with columns made anew of those that matter."""
        self._candidates.follow(self._scored.model, model)
        if model is self.before:
            self._candidates.refresh(model, self._fresh)
            self._fresh.clear()
            return self._before
        scores = self._candidates.scores(model)
        anew = set(self._candidates.refresh(model, {n for n, s in scores.items() if s.gain > priors.SMALLEST**2}))
        self._fresh |= anew
        again = self._candidates.scores(model, anew)
        return _Scored(model, {n: s for n, s in scores.items() if n not in anew} | again)


def _contending(rated: Sequence[Rated]) -> list[Rated]:
    """List explanations whose odds noise in the regressors may decide.

    They contend with nothing, and with the best of all: what is far below it remains there unless it falls.
    """
    least = max(rated[0].log_odds, 0.0) - priors.CREDIBLE_ODDS if rated else 0.0
    return [r for r in rated if r.log_odds > least and r.score.gain < BEYOND_BIAS][:MOST_CONTENDERS]


def at_best_shape(model: Model, score: Score) -> Score:
    """Score a name at its best shape; a law with as many functions as needed, of two signals where better."""
    if not isinstance(score.term.content, Law):
        name = refined(model, score)
        held = tuple(np.flatnonzero((np.asarray(name.values) == 0.0) & (np.asarray(name.free) != 0.0)).tolist())
        return replace(name, term=replace(name.term, held=held))
    law = resolved(model, score)
    assert law.term.joint is not None
    found = best_surface(model, law.term.joint, score.term.content.signals[0])
    if found is None:
        return law
    found = resolved(model, found)
    one, two = (
        float(named_evidence(np.array([s.gain]), np.array([float(s.live)]), np.array([np.sqrt(s.gain)]))[0, 0])
        for s in (law, found)
    )
    return found if two - np.log(found.grid) > one + priors.CREDIBLE_ODDS else law
