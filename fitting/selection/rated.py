"""Explanations and what they are worth."""

from __future__ import annotations

from dataclasses import dataclass

from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Term

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
    refuted : the same of effects that were found, and of names that did not hold elsewhere
    against : log odds that leftovers explain it instead, which the odds are held against
    """

    score: Score
    log_odds: float
    log_bayes: float
    exact: float
    leftover: float
    refuted: float
    against: float = 0.0

    @property
    def term(self) -> Term:
        """The candidate, in its best shape."""
        return self.score.term


def family(term: Term) -> Family:
    """Return what counts as one explanation: an effect on a joint; a law of one signal on a joint, or of two."""
    law = term.content
    if isinstance(law, Law):
        return ("law", term.joint, frozenset(law.signals), *law.parity, law.loaded_only)
    return (term.id, term.joint)
