"""Probabilities: of what is in one place, and of whole explanations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeVar

import numpy as np

from fitting.effects.base import Effect
from fitting.residual.findings import MOST_LISTED, Accepted, Hypothesis, Place, most_probable
from fitting.residual.terms import Term
from fitting.selection import priors
from fitting.selection.decision import Rated, family, tempered

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
        """Compute the slot from posterior odds beside everything else."""
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


def open_place(rated: Sequence[Rated]) -> Place:
    """Return the one question where nothing was added: what may be missing, or nothing."""
    total = float(np.logaddexp.reduce([0.0, *(r.log_odds for r in rated)]))
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
