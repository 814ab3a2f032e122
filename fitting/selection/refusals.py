"""What a search does not add any more, and what of it is left to be explained."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
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
    failed : what refused names lived on, per joint; without it a force with another sign on `validate` gets a name
    unconfirmed : laws that did not hold elsewhere
    """

    def __init__(self) -> None:
        self.names: set[Family] = set()
        self.dropped: set[Family] = set()
        self.worse: set[tuple[frozenset[Family], Family]] = set()
        self.laws: set[int | None] = set()
        self.failed: list[tuple[int | None, float]] = []
        self.unconfirmed: list[Unconfirmed] = []

    def add(self, score: Score, answer: Answer, there: Sequence[Term], choice: Family) -> None:
        """Take the gate's refusal of a candidate beside the terms that are there.

        Parameters
        ----------
        score : the candidate as it was tried, its shape searched
        choice : the explanation that it was chosen as
        """
        if answer.worse:
            self.worse.add((frozenset(map(family, there)), choice))
        else:
            self.names.add(choice)
        if answer.faint:
            return
        if isinstance(score.term.content, Law):
            self.laws.add(score.term.joint)
            found = answer.found
            self.unconfirmed.append(Unconfirmed(score, found.held_out, found.validate_gain or 0.0))
        elif not answer.worse:
            self.failed.append((score.term.joint, score.gain))

    def without(self, rated: Sequence[Rated], there: Sequence[Term], settled: bool) -> list[Rated]:
        """List the explanations that may be beside some terms: not one of them, and not closed.

        What was dropped is closed until the search has settled: then it is an alternative again.
        """
        beside = frozenset(map(family, there))
        closed = beside | self.names | {name for terms, name in self.worse if terms == beside}
        closed |= set() if settled else self.dropped
        return [
            r
            for r in rated
            if family(r.term) not in closed and not (isinstance(r.term.content, Law) and r.term.joint in self.laws)
        ]

    def amplitudes(self, joints: int) -> FloatArray:
        """Compute amplitudes per joint (joints,) of what was significant and not confirmed elsewhere."""
        seen = np.zeros(joints)
        for joint, size in self.failed:
            seen[slice(None) if joint is None else joint] += priors.FAILED**2 * size
        return np.sqrt(seen)

    def open_questions(self, signals: Signals, model: Model, accepted: Sequence[Accepted]) -> tuple[Unconfirmed, ...]:
        """List unconfirmed laws of joints without findings where something is certainly missing.

        It holds on blocks that were left out of the fit, or two runs of one motion leave the same.
        """
        best: dict[int | None, Unconfirmed] = {}
        for item in self.unconfirmed:
            joint = item.score.term.joint
            if joint is None or any(_gains_at(found.score, joint) for found in accepted):
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
