"""Explanations with their odds and probabilities: which of one place is to be reported, and whole explanations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.residual.findings import MOST_LISTED, Accepted, Hypothesis, Place, most_probable
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Term
from fitting.selection import priors
from fitting.selection.evidence import log_sum

#: What counts as one explanation.
Family = tuple[object, ...]


@dataclass(frozen=True)
class Rated:
    """One explanation: an effect on a joint with its best shape, or a law of one signal.

    Attributes
    ----------
    score : its best shape, with what a least-squares fit of it takes
    log_odds : log posterior odds against nothing more than leftovers, shapes and sizes averaged out
    log_bayes : log Bayes factor alone
    exact : log odds if its formula is exactly nature's, so that what is left of it is free to be something else
    leftover : log Bayes factor of the same as what is left of effects that were found
    against : log odds that leftovers explain it instead, which the odds are held against
    """

    score: Score
    log_odds: float
    log_bayes: float
    exact: float
    leftover: float
    against: float = 0.0

    @property
    def term(self) -> Term:
        """The candidate, in its best shape."""
        return self.score.term

    def held_against(self, log_odds: float) -> Rated:
        """Return it against something that is so much more probable, log odds."""
        return replace(self, log_odds=self.log_odds - log_odds, exact=self.exact - log_odds)


def family(term: Term) -> Family:
    """Return what counts as one explanation: an effect on a joint; a law of one signal on a joint, or of two."""
    law = term.content
    if isinstance(law, Law):
        return ("law", term.joint, frozenset(law.signals), *law.parity, law.loaded_only)
    return (term.id, term.joint)


def by_formula(rated: Sequence[Rated]) -> list[Rated]:
    """Compare names of one joint by exact formulas, the best of them lifted to what the best has with a curve.

    What a curve beside a name makes up for counts for names against laws, not for one name against another.
    """
    places: dict[int | None, list[Rated]] = {}
    for r in rated:
        places.setdefault(r.term.place, []).append(r)
    result = []
    for own in places.values():
        names = [r for r in own if not isinstance(r.term.content, Law)]
        lift = max((r.log_odds for r in names), default=0.0) - max((r.exact for r in names), default=0.0)
        result += [r if isinstance(r.term.content, Law) else replace(r, log_odds=r.exact + lift) for r in own]
    return sorted(result, key=lambda r: -r.log_odds)


def here(rated: Sequence[Rated]) -> list[Rated]:
    """List explanations at the joint of the best, and what acts everywhere; all where the best does."""
    best = rated[0].term
    return [r for r in rated if r.term.joint == best.joint or r.term.everywhere or best.everywhere]


def instead(rated: Sequence[Rated], beside: Mapping[Family, float]) -> list[Rated]:
    """List explanations of what one term explains, best first: at other joints as far as they are nothing beside it.

    Of ``B`` at another joint either is there alone, or both: ``P(A) = o_A (1 + o_BA) / (1 + o_B + o_A (1 + o_BA))``.

    Parameters
    ----------
    rated : beside the model without the term
    beside : log odds of families beside the model with it
    """
    own = here(rated)
    there = {family(r.term) for r in own}
    others = [(r, beside.get(family(r.term), -np.inf)) for r in rated if family(r.term) not in there]
    both = np.logaddexp.reduce([0.0, *(odds for _, odds in others)])
    alone = [
        replace(r, log_odds=r.log_odds + np.log(-np.expm1(o - r.log_odds)) - both) for r, o in others if o < r.log_odds
    ]
    return sorted([*own, *alone], key=lambda r: -r.log_odds)


def tempered(rated: Sequence[Rated]) -> list[tuple[Rated, float]]:
    """Compute log odds of explanations of one place, best first; names differ as far as formulas hold.

    Whichever name is right, its own formula leaves chi-square, a share epsilon squared of what is there; differences of
    that size are chance, so those of names shrink by as much as it outweighs what noise alone asks for. How far nature
    is from the formula is not known: probabilities are averaged over :data:`~fitting.selection.priors.EPSILONS`. A law
    has no formula; names are compared with it with a curve beside them.
    """
    if not rated:
        return []
    near = [r for r in rated if r.log_odds > 0] or [rated[0]]
    head = next((r for r in near if isinstance(r.term.content, Effect)), near[0])
    series = isinstance(head.term.content, Effect) and head.term.content.series
    odds = np.array([r.log_odds for r in near])
    named = np.array([isinstance(r.term.content, Effect) for r in near])
    probable = []
    for share in tempering(head.score.gain):
        own = np.where(named, head.log_odds - share * (head.log_odds - odds), odds)
        probable.append(np.append(own, 0.0) - float(log_sum(np.append(own, 0.0))))
    whole = log_sum(np.array(probable), axis=0, weights=np.array(priors.weights(series))[:, None])
    result = list(zip(near, (whole[:-1] - whole[-1]).tolist(), strict=True))
    return sorted(result, key=lambda pair: -pair[1])


def odds_behind(stated: float, gain: float) -> float:
    """Compute log odds of one name over another by formula, that :func:`tempered` states as ``stated``.

    Parameters
    ----------
    stated : log odds, as they are reported
    gain : chi-square that the effect takes; its formula is taken for a law of physics
    """
    shares, weights = tempering(gain), np.array(priors.weights(series=False))

    def missing(odds: float) -> float:
        return float(weights @ scipy.special.expit(shares * odds)) - float(scipy.special.expit(abs(stated)))

    # At the smallest share it is enough for every share.
    found = float(scipy.optimize.brentq(missing, 0.0, abs(stated) / float(shares.min()) + 1.0))
    return float(np.copysign(found, stated))


def tempering(gain: float | FloatArray) -> FloatArray:
    """Compute which share of a difference between names counts, per :data:`~fitting.selection.priors.EPSILONS`.

    Along the last axis; ``gain`` is the chi-square that the effect takes, or of each difference, (N, 1).
    """
    return np.asarray(1.0 / (1.0 + np.array(priors.EPSILONS) ** 2 * gain / priors.CLOSE))


def decided(rated: Sequence[Rated], there: Family | None = None) -> Rated:
    """Decide what to report of explanations of a place: the best name, unless laws are too probable beside all names.

    ``there`` is what has the place already.
    """
    near = tempered(here(rated))
    laws = [(r, odds) for r, odds in near if isinstance(r.term.content, Law)]
    names = [(r, odds) for r, odds in near if not isinstance(r.term.content, Law)]
    if not laws or not names:
        return rated[0]
    known = log_sum([own for _, own in near])
    named, unknown = ([float(np.exp(own - known)) for _, own in part] for part in (names, laws))
    beaten = laws_win(max(named), sum(named), sum(unknown), family(names[0][0].term) == there)
    return (laws if beaten else names)[0][0]


def laws_win(name: float, names: float, laws: float, there: bool = False) -> bool:
    """Return whether laws are too probable together beside names: by the best one's probability, all names', all laws'.

    A name alone has to be as probable as anything that is reported, one that is ``there`` may leave laws a fifth.
    """
    wanted = priors.CREDIBLE if name > priors.CREDIBLE * names and not there else priors.NAMED
    return laws > (1.0 - wanted) * (names + laws)


#: Alternatives of one place that are named.
MOST_NAMED = 3
#: Probability below which a name is none that a law could be.
LEAST_BESIDE_LAW = 0.05

Kind = TypeVar("Kind")


@dataclass(frozen=True)
class Slot:
    """One place of the model: the term there, and what else could be.

    Attributes
    ----------
    alternatives : with their probabilities, the best first; the term there among them
    probability : of the term there
    nothing : that nothing has to be there
    moved : the place was given up or taken by another
    """

    item: Accepted
    alternatives: tuple[tuple[Rated, float], ...]
    probability: float
    nothing: float
    moved: bool = False

    @classmethod
    def of(cls, item: Accepted, rated: Sequence[Rated]) -> Slot:
        """Compute the slot from posterior odds beside everything else (:func:`instead`), best first."""
        near = tempered(rated)
        rated, log_odds = [r for r, _ in near], np.array([odds for _, odds in near])
        total = float(np.logaddexp.reduce(np.append(log_odds, 0.0)))
        shares = np.exp(log_odds - total)
        there = [family(r.term) == family(item.score.term) for r in rated]
        probability = float(np.sum(shares[there]))
        listed = tuple((r, float(p)) for r, p in zip(rated, shares, strict=True) if p > 1e-3)
        return cls(item, listed, probability, float(np.exp(-total)))

    @property
    def place(self) -> Place:
        """The place as a question of its own: what may be there, and that nothing is."""
        return (*((r.term, p) for r, p in self.alternatives), (None, self.nothing))

    @property
    def improbable(self) -> bool:
        """True where neither this nor what is reported with it is the more probable; laws of a joint are one."""
        own = sum(p for r, p in self.alternatives if r.term.family == self.item.score.term.family)
        return max(self.probability, own) + sum(p for _, p in self.rivals()) < 0.5

    def rivals(self) -> list[tuple[Rated, float]]:
        """List the other names needed for the probability from which on something is reported.

        Beside a law, names that are improbable by themselves are none; nor are those that are only more general.
        """
        name, own = self.item.score.term, family(self.item.score.term)
        least = 0.0 if isinstance(name.content, Effect) else LEAST_BESIDE_LAW

        def other(term: Term) -> bool:
            general = term.joint == name.joint and isinstance(term.content, Effect) and name.id in term.content.includes
            return family(term) != own and isinstance(term.content, Effect) and not general

        return needed([(r, p) for r, p in self.alternatives if p >= least and other(r.term)], self.probability)


def needed(alternatives: Iterable[tuple[Kind, float]], reached: float) -> list[tuple[Kind, float]]:
    """List the alternatives, of falling probability, that are needed beside what is ``reached``; at most two."""
    result = list[tuple[Kind, float]]()
    for own, p in alternatives:
        if reached >= priors.CREDIBLE or len(result) >= MOST_NAMED - 1:
            break
        result.append((own, p))
        reached += p
    return result


def nothing_more(rated: Sequence[Rated]) -> float:
    """Return the probability that nothing more is missing beside the model that all candidates are rated beside."""
    return float(np.exp(-np.logaddexp.reduce([0.0, *(r.log_odds for r in rated)])))


def open_place(rated: Sequence[Rated], unknown: Iterable[float] = ()) -> Place:
    """Return the one question where nothing was added: what may be missing, or nothing.

    Of what was refused its log odds are ``unknown``: they count against nothing, and are no explanation.
    """
    total = float(np.logaddexp.reduce([0.0, *(r.log_odds for r in rated), *unknown]))
    found = [(r.term, float(np.exp(r.log_odds - total))) for r in rated[:MOST_LISTED]]
    return ((None, float(np.exp(-total))), *found)


def together(positions: Sequence[Hypothesis], efforts: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Combine explanations of positions and of efforts, the most probable first.

    Findings of efforts are reported with the rebuilt positions, whichever explanation of those it is. What both
    have is reported once.
    """

    def terms(both: Hypothesis, more: Hypothesis) -> tuple[Term, ...]:
        named = {t.family: t for t in (*both.terms, *more.terms) if isinstance(t.content, Effect)}
        laws = {t.label: t for t in (*both.terms, *more.terms) if not isinstance(t.content, Effect)}
        return (*named.values(), *laws.values())

    return most_probable(
        Hypothesis(terms(p, e), p.probability * e.probability)
        for p, e in product(positions or (Hypothesis((), 1.0),), efforts)
    )
