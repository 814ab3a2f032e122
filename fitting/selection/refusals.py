"""What a search does not add any more, and what of it is left to be explained."""

from __future__ import annotations

from collections.abc import Sequence

from fitting.residual.confirmation.cross_validation import CONFIRMED
from fitting.residual.findings import Accepted, Unconfirmed
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Model, Term
from fitting.selection import priors
from fitting.selection.confirm import Answer, Signals
from fitting.selection.decision import Family, Rated, family

#: Standard errors from which on two runs of one motion certainly share something.
SHARED_Z = 4.0
#: Share of a refused law's gain that two runs of one motion have to share for it to be an open question.
SHARED = 0.25


class Refusals:
    """Explanations that were refused beside the terms of a model, or dropped, and why they are closed.

    Attributes
    ----------
    names : refused for good
    dropped : improbable beside what was found later: not added again, but not refuted
    worse : what made another joint worse, and beside which terms: parameters that joints share are bent by all effects
    laws : joints of a law that did not hold elsewhere: no other curve of them is a candidate, but names are. Without it
        two of eight runs of seals lose the right name
    left : per joint, what is left of the log odds of refused names: something that is not known. A name has to be more
        probable than that; without it a force with another sign on `validate` gets a name
    unknown : of these, what rows that were left out of the fit confirm: nothing is the less probable for it
    unconfirmed : laws that did not hold elsewhere
    """

    def __init__(self) -> None:
        self.names: set[Family] = set()
        self.dropped: set[Family] = set()
        self.worse: set[tuple[frozenset[Family], Family]] = set()
        self.laws: set[int | None] = set()
        self.left: dict[int | None, float] = {}
        self.unknown: dict[int | None, float] = {}
        self.unconfirmed: list[Unconfirmed] = []

    def add(self, choice: Rated, answer: Answer, there: Sequence[Term]) -> None:
        """Take the gate's refusal of a choice beside the terms that are there."""
        score = answer.found.score
        if answer.worse:
            self.worse.add((frozenset(map(family, there)), family(choice.term)))
        else:
            self.names.add(family(choice.term))
        if answer.faint:
            return
        if isinstance(score.term.content, Law):
            self.laws.add(score.term.joint)
            found = answer.found
            self.unconfirmed.append(Unconfirmed(score, found.held_out, found.validate_gain or 0.0))
        elif not answer.worse:
            joint, left = score.term.joint, answer.left_of(choice.log_odds)
            self.left[joint] = max(left, self.left.get(joint, 0.0))
            if answer.found.held_out.confirmed > CONFIRMED:
                self.unknown[joint] = max(left, self.unknown.get(joint, left))

    def without(
        self, rated: Sequence[Rated], there: Sequence[Term], settled: bool, own: Family | None = None
    ) -> list[Rated]:
        """List the explanations that may be beside some terms: not one of them, and not closed.

        What was dropped is closed until the search has settled: then it is an alternative again. What has its ``own``
        place there is not closed by what was refused beside it.
        """
        beside = frozenset(map(family, there))
        closed = beside | self.names | {name for terms, name in self.worse if terms == beside}
        closed |= set() if settled else self.dropped
        return [r for r in rated if family(r.term) == own or (family(r.term) not in closed and self._is_open(r))]

    def _is_open(self, rated: Rated) -> bool:
        """Return whether nothing that was refused at its joint is against a law, or a name of these odds."""
        joint = rated.term.joint
        if isinstance(rated.term.content, Law):
            return joint not in self.laws
        left = max((own for place, own in self.left.items() if place == joint or None in (place, joint)), default=0.0)
        return left <= 0.0 or rated.log_odds > left + priors.CREDIBLE_ODDS

    def open_questions(self, signals: Signals, model: Model, accepted: Sequence[Accepted]) -> tuple[Unconfirmed, ...]:
        """List unconfirmed laws of joints without findings where something is certainly missing.

        It holds on blocks that were left out of the fit, or two runs of one motion leave the same.
        """
        best: dict[int | None, Unconfirmed] = {}
        for item in self.unconfirmed:
            joint = item.score.term.joint
            if joint is None or any(_gains_at(a.score, joint) for a in accepted if not a.score.term.is_line):
                continue
            left = signals.misfit(model, joint)
            shared = left.z > SHARED_Z and left.excess > SHARED * item.score.gain
            if (shared or item.held_out.confirmed > CONFIRMED) and (
                joint not in best or item.score.gain > best[joint].score.gain
            ):
                best[joint] = item
        return tuple(best.values())


def _gains_at(score: Score, joint: int) -> bool:
    """Return whether most of what a term gains is of the effort of this joint."""
    return score.places[joint] > 0.5 if score.places else score.term.joint == joint
