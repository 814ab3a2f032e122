"""From residual to named effect: the most probable set of terms, found step by step, each confirmed elsewhere.

One criterion decides: the posterior odds of :mod:`fitting.selection.rating`. A step takes the most probable
explanation, rebuilds and refits, and looks again. Where nothing more is probable, every term is held against all others
in its place, beside the rest; where one is dropped or replaced, the search goes on beside what is there then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.progress import Progress, quiet
from fitting.residual.findings import Accepted, Attribution, Candidate, Family, Place
from fitting.residual.scoring import Score
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.confirm import Gate, Signals
from fitting.selection.decision import Family as Kind
from fitting.selection.decision import Rated, Slot, decided, family, instead, nothing_more, open_place
from fitting.selection.evidence import least_gain
from fitting.selection.gains import margin
from fitting.selection.rating import Ratings, at_best_shape
from fitting.selection.refusals import Refusals
from fitting.selection.trust import Draws


class Search:
    """State of the search: the model so far, what was added and what was refused.

    Parameters
    ----------
    base : joint fit of the base model
    validate : segments of the `validate` recordings; nothing is selected on them, they only confirm or reject
    signals : refits, with delays and the like corrected in the signals themselves
    bootstrap : most replicas that a null distribution is drawn from; 0 trusts the chi-square
    known : what was found before, in the order of the base's terms (spectral lines)
    """

    def __init__(
        self,
        base: Model,
        validate: Sequence[int],
        signals: Signals,
        bootstrap: int = 0,
        known: Sequence[Accepted] = (),
    ) -> None:
        self.base, self.signals = base, signals
        self.gate = Gate(signals, validate)
        self.ratings = Ratings(base, Draws(signals, bootstrap))
        self.refusals = Refusals()
        self.model, self.accepted = base, list(known)
        self.known = len(known)
        self.table: dict[Family, Candidate] = {}
        for item in known:
            self._note(item.score, "accepted", Sentence("fitting.spectral_line"))
        self.limits: tuple[Score, ...] = ()
        self.open: list[Rated] = []  # what may be beside the model, as it was rated last
        self.held: set[frozenset[tuple[object, ...]]] = set()  # explanations that exchanges led to
        self.slots: list[Slot] = []
        self.dropped: list[Slot] = []
        self.settled = False  # nothing more is looked for beside this model

    def run(self, progress: Progress = quiet) -> Attribution:
        """Search until nothing more is probable and every term keeps its place, and return the findings."""
        for number in range(4 * priors.MOST):
            progress(min(0.9, number / 4), Sentence("fitting.looking_round", number=number + 1))
            if not self.step() and not self.exchange():
                break
        self.settle()
        return self.result()

    def step(self) -> bool:
        """Add the most probable further term, or reject it for good. False when nothing more is probable."""
        if len(self.accepted) - self.known >= priors.MOST:
            return False
        self.open = rated = self.beside(self.model, self.accepted)
        if not self.limits:
            self.limits = tuple(r.score for r in rated if isinstance(r.term.content, Effect))
        self._record(rated)
        if np.logaddexp.reduce([-np.inf, *(r.log_odds for r in rated)]) < priors.CREDIBLE_ODDS:
            return False
        self.attempt(decided(self.ratings.at_best_shapes(rated)))
        return True

    def beside(
        self, model: Model, there: Sequence[Accepted], surfaces: Sequence[Score] = (), own: Kind | None = None
    ) -> list[Rated]:
        """Rate what may be beside a model of what is ``there``, best first: neither in it nor rejected.

        ``surfaces`` are rated as well: they are no candidates. ``own`` has its place there.
        """
        rated = self.ratings.rated(model, _visible(model, there), self.settled, surfaces)
        return self.refusals.without(rated, model.terms, self.settled, own)

    def attempt(self, choice: Rated) -> None:
        """Add the choice, its shape searched, if nothing is against it elsewhere."""
        score = at_best_shape(self.model, choice.score)
        trial = self.gate.with_term(self.model, score.term)
        score = replace(score, term=trial.terms[-1])
        answer = self.gate.asked(score, self.model, trial)
        place = score.term.family
        if answer.reason:
            self.refusals.add(choice, answer, self.model.terms)
            self._note(score, "rejected", answer.reason)
            return
        # What is in the model itself is no other name any more for what was found before.
        self.accepted = [
            replace(item, rivals=tuple(rival for rival in item.rivals if rival.term.family != place))
            for item in self.accepted
        ]
        self.accepted.append(answer.found)
        self._note(score, "accepted", Sentence("fitting.gains_chi_square", gain=score.gain))
        self.ratings.added()
        self.model = trial

    def exchange(self) -> bool:
        """Drop a term that is not needed beside the others, or replace one that is beaten; False where none is.

        Here gains are divided by how much noisier the rows that show them are in what the model leaves.
        """
        self._without_needless_lines()
        self._at_rest()
        for number in range(self.known, len(self.accepted)):
            slot = self._slot(number)
            if slot.moved:
                self.settled = False  # that model is no more: what it lacks is looked for anew
                return True
            self.slots.append(slot)
        return False

    def settle(self) -> None:
        """Hold every term that is left against all others in its place, and drop what is improbable."""
        if not self.settled:  # rounds are over, and no place was at rest
            self._at_rest()
            self.slots = [self._slot(n, final=True) for n in range(self.known, len(self.accepted))]
        self._without_improbable()
        if not self.slots:
            self.open = self.beside(self.model, self.accepted)

    def _at_rest(self) -> None:
        """Rate what may be beside the model, before its places are looked at."""
        self.settled, self.slots = True, []
        if len(self.accepted) > self.known:
            self.open = self.beside(self.model, self.accepted)

    def _without_improbable(self) -> None:
        """Drop what the posterior calls improbable; what favours it remains an open question."""
        for number in reversed(range(len(self.slots))):
            if self.slots[number].improbable:
                item = self.accepted.pop(self.known + number)
                self._note(item.score, "rejected", Sentence("fitting.improbable_beside_all_others"))
                self.dropped.append(self.slots.pop(number))
                self.model = self.signals.refit([a.score.term for a in self.accepted])

    def _without_needless_lines(self) -> None:
        """Drop spectral lines that an effect found later explains: what is left of them is worth nothing.

        Friction along a periodic motion has such a line; without this it would be a pump's ripple beside its name.
        """
        if len(self.accepted) == self.known:
            return
        for number in reversed(range(self.known)):
            if self.model.wald(number) >= least_gain(2):
                continue
            place = self.accepted.pop(number).score.term.family
            self.known -= 1
            known = self.table[place]
            self.table[place] = replace(known, status="rejected", reason=Sentence("fitting.not_needed_beside_found"))
            self.model = self.signals.refit([item.score.term for item in self.accepted])

    def _slot(self, number: int, final: bool = False) -> Slot:
        """Rate what could be in one term's place; unless final, the term is dropped or replaced if it is beaten."""
        item = self.accepted[number]
        others = [a for n, a in enumerate(self.accepted) if n != number]
        rest = [a.score.term for a in others]
        known = next((m for m in (self.base, self.ratings.before) if m.terms == tuple(rest)), None)
        model = self.signals.refit(rest) if known is None else known
        own, content = family(item.score.term), item.score.term.content
        surfaces = [item.score] if isinstance(content, Surface) and not content.twist else []  # twists are candidates
        rated = self.ratings.at_best_shapes(self.beside(model, others, surfaces, own))
        slot = Slot.of(item, instead(rated, {family(r.term): r.log_odds for r in self.open}) if rated else [])
        choice = decided(rated, own) if rated and slot.nothing <= 1 - priors.CREDIBLE else None
        leads_to = frozenset([*map(family, rest), *([] if choice is None else [family(choice.term)])])
        if final or leads_to in self.held or (choice is not None and family(choice.term) == own):
            return slot
        self.held.add(leads_to)
        self.accepted, self.model = others, model
        if choice is None:
            self.refusals.dropped.add(own)
            self._note(item.score, "rejected", Sentence("fitting.not_needed_beside_found"))
            return replace(slot, moved=True)
        self._note(item.score, "rejected", Sentence("fitting.another_explanation_more_probable"))
        self.attempt(choice)
        return replace(slot, moved=True)

    def result(self) -> Attribution:
        """Return the findings."""
        accepted = list(self.accepted[: self.known])
        for item, slot in zip(self.accepted[self.known :], self.slots, strict=True):
            rivals = slot.rivals()
            accepted.append(
                replace(
                    item,
                    rivals=tuple(r.score for r, _ in rivals),
                    rival_probabilities=tuple(p for _, p in rivals),
                    probability=slot.probability,
                )
            )
            for rival, _ in rivals:
                named = isinstance(item.score.term.content, Effect)
                words = Sentence(
                    "fitting.data_cannot_tell",
                    rival=item.score.term.id if named else Sentence("fitting.unknown_effect"),
                )
                self._note(rival.score, "indistinguishable", words)
        ordered = tuple(sorted(self.table.values(), key=lambda c: -c.score))
        return Attribution(
            self.base,
            self.model,
            tuple(accepted),
            ordered,
            self.limits,
            (),
            self.refusals.open_questions(self.signals, self.model, self.accepted),
            places=self._places(),
            nothing_more=nothing_more(self.beside(self.model, self.accepted))
            if len(self.accepted) - self.known >= priors.MOST
            else 1.0,
        )

    def _places(self) -> tuple[Place, ...]:
        """List the questions: of each added term, of what was dropped, or of everything where nothing was added."""
        dropped = {slot.item.score.term.family for slot in self.dropped}
        left = [tuple((t, p) for t, p in s.place if t is None or t.family not in dropped) for s in self.dropped]
        asked = [slot.place for slot in self.slots]
        return (*asked, *left) if asked or left else (open_place(self.open, self.refusals.unknown.values()),)

    def _record(self, rated: Sequence[Rated]) -> None:
        """Note each family's status, unless it already has one."""
        for r in rated:
            place = r.term.family
            if not isinstance(r.term.content, Effect):
                continue
            known = self.table.get(place)
            if known is not None and (known.status != "rejected" or known.score >= margin(r.score)):
                continue
            if r.log_odds <= 0:
                reason = Sentence("fitting.gains_chi_square_chance", gain=r.score.gain)
            else:
                reason = Sentence("fitting.significant_but_another_effect")
            self._note(r.score, "rejected", reason)

    def _note(self, score: Score, status: str, reason: str) -> None:
        """Write a candidate's line of the table."""
        family = score.term.family
        self.table[family] = Candidate(*family, margin(score), status, reason)


def _visible(model: Model, accepted: Sequence[Accepted]) -> FloatArray:
    """Compute amplitudes per joint of a model's effects, each as large as when it was accepted if that was more."""
    seen = np.zeros(len(model.design.machine.joints))
    for number, term in enumerate(model.terms):
        if term.is_line:
            continue
        item = next((a for a in accepted if a.score.term.family == term.family), None)
        size = model.wald(number) if item is None else max(model.wald(number), item.score.gain)
        if not term.everywhere:
            seen[term.joint or 0] += size
        else:
            seen += size * (np.clip(item.score.places, 0.0, 1.0) if item is not None and item.score.places else 1.0)
    return np.sqrt(seen)
