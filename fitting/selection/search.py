"""From residual to named effect: the most probable set of terms, found step by step, each confirmed elsewhere.

One criterion decides: the posterior odds of :mod:`fitting.selection.rating`. A step takes the most probable
explanation, rebuilds and refits, and looks again. Where nothing more is probable, every term is held against all others
in its place, beside the rest; where one is dropped or replaced, the search goes on beside what is there then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.effects import effects
from fitting.effects.base import Effect
from fitting.progress import Progress, quiet
from fitting.residual.confirmation.cross_validation import CONFIRMED
from fitting.residual.findings import Accepted, Attribution, Candidate, Family, Place, Unconfirmed
from fitting.residual.laws import Law
from fitting.residual.refinement import refined
from fitting.residual.scoring import Candidates, Score, catalogue_terms, law_terms, score_terms
from fitting.residual.surfaces import Surface, best_surface, surfaces
from fitting.residual.terms import Model, Term
from fitting.selection import priors
from fitting.selection.confirm import Gate, Signals
from fitting.selection.decision import Rated, Slot, by_formula, decided, family, open_place
from fitting.selection.evidence import least_gain, named_evidence
from fitting.selection.gains import margin
from fitting.selection.rating import Rating, resolved
from fitting.selection.trust import BEYOND_BIAS, Draws

#: Explanations of a joint whose shapes are searched.
WIDTH = 4
#: Share of the best gain from which on a name is looked at closer.
NEAR = 0.25
#: Standard errors from which on two runs of one motion certainly share something.
SHARED_Z = 4.0
#: Contenders whose null is drawn.
MOST_CONTENDERS = 12


@dataclass(frozen=True)
class _Scored:
    """Scores of all candidates beside a model by their number, and the labels of those whose nulls were drawn."""

    model: Model
    scores: dict[int, Score]
    drawn: set[tuple[object, ...]] = field(default_factory=set)


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
        self.draws = Draws(signals, bootstrap)
        self.model, self.accepted = base, list(known)
        self.known = len(known)
        self.refused: set[tuple[object, ...]] = set()
        self.unneeded: set[tuple[object, ...]] = set()  # dropped as improbable: not added again, but not refuted
        #: What made another joint worse, and beside which terms: parameters that joints share are bent by all effects.
        self.worse: set[tuple[frozenset[tuple[object, ...]], tuple[object, ...]]] = set()
        #: Joints of a law that did not hold elsewhere. Without it two of eight runs of seals lose the right name.
        self.without_law: set[int | None] = set()
        #: What refused names lived on, per joint; without it a force with another sign on `validate` gets a name.
        self.failed: list[tuple[int | None, float]] = []
        self.table: dict[Family, Candidate] = {}
        for item in known:
            self._note(item.score, "accepted", Sentence("fitting.spectral_line"))
        self.unconfirmed: list[Unconfirmed] = []
        self.limits: tuple[Score, ...] = ()
        terms, grid = catalogue_terms(base, effects())
        laws, law_grid = law_terms(base)
        joints = range(len(base.design.machine.joints))
        twists = [Term(law, joint) for joint in joints for law in surfaces(base, joint, twist=True)]
        self.candidates = Candidates(base, [*terms, *laws, *twists], [*grid, *law_grid, *[len(twists)] * len(twists)])
        self.scored = _Scored(base, self.candidates.scores(base))
        self.before = self.scored  # beside the model that the last term was added to
        self.fresh: set[int] = set()  # candidates whose columns were made anew since
        self.held: set[frozenset[tuple[object, ...]]] = set()  # explanations that exchanges led to
        self.slots: list[Slot] = []
        self.open: list[Rated] = []
        self.settled = False  # nothing more is looked for beside this model
        self.dropped: list[Slot] = []

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
        rated = self._open()
        if not self.limits:
            self.limits = tuple(r.score for r in rated if isinstance(r.term.content, Effect))
        self._record(rated)
        self.open = rated
        if np.logaddexp.reduce([-np.inf, *(r.log_odds for r in rated)]) < priors.CREDIBLE_ODDS:
            return False
        self._try(decided(self._at_best_shapes(rated)))
        return True

    def _rated(self, model: Model, surfaces: Sequence[Score] = ()) -> list[Rated]:
        """Rate all candidates, and ``surfaces``, beside a model; the noisy regressors' bias is taken off contenders.

        Scores of the last model are kept: after a rejection only the odds against leftovers change.
        """
        if self.scored.model is not model:
            self.scored = self._scores_beside(model)
        scores, drawn = self.scored.scores, self.scored.drawn
        self.rating = Rating(self.candidates, model, self._visible(model), self._failed(), settled=self.settled)
        surfaces = score_terms(model, [s.term for s in surfaces], [s.grid for s in surfaces])
        rated = self.rating.rated(scores, surfaces)
        number = {score.term.label: n for n, score in scores.items()}  # of a surface no replicas are drawn
        # What was drawn may lose by it, and others contend then: they are drawn as well.
        open_ = number.keys() if self.draws.wanted else set[object]()
        while chosen := [r for r in _contending(rated) if r.term.label in open_ - drawn]:
            drawn |= {r.term.label for r in chosen}
            for score in self.draws.unbiased(model, [r.score for r in chosen]):
                scores[number[score.term.label]] = score
            rated = self.rating.rated(scores, surfaces)
        return rated

    def _scores_beside(self, model: Model) -> _Scored:
        """Score all candidates beside a model, with columns made anew of those that matter."""
        self.candidates.follow(self.scored.model, model)
        if model is self.before.model:
            self.candidates.refresh(model, self.fresh)
            self.fresh.clear()
            return self.before
        scores = self.candidates.scores(model)
        anew = set(self.candidates.refresh(model, {n for n, s in scores.items() if s.gain > priors.SMALLEST**2}))
        self.fresh |= anew
        return _Scored(model, {n: s for n, s in scores.items() if n not in anew} | self.candidates.scores(model, anew))

    def _open(self) -> list[Rated]:
        """Rate what may be beside the model: neither in it nor rejected."""
        return self._beside(self._rated(self.model), self.model.terms)

    def _beside(self, rated: Sequence[Rated], there: Sequence[Term]) -> list[Rated]:
        """List explanations that may be beside some terms: not one of them, not rejected."""
        beside = frozenset(map(family, there))
        closed = beside | self.refused | {name for terms, name in self.worse if terms == beside}
        closed |= set() if self.settled else self.unneeded
        return [
            r
            for r in rated
            if family(r.term) not in closed
            and not (isinstance(r.term.content, Law) and r.term.joint in self.without_law)
        ]

    def _visible(self, model: Model) -> FloatArray:
        """Compute amplitudes per joint of a model's effects, and of what was rejected."""
        seen = np.zeros(len(model.design.machine.joints))
        for number, term in enumerate(model.terms):
            if term.is_line:
                continue
            item = next((a for a in self.accepted if a.score.term.family == term.family), None)
            size = model.wald(number) if item is None else max(model.wald(number), item.score.gain)
            if not term.everywhere:
                seen[term.joint or 0] += size
            else:
                seen += size * (np.clip(item.score.places, 0.0, 1.0) if item is not None and item.score.places else 1.0)
        return np.sqrt(seen)

    def _failed(self) -> FloatArray:
        """Compute amplitudes per joint of what was significant and not confirmed elsewhere."""
        seen = np.zeros(len(self.base.design.machine.joints))
        for joint, size in self.failed:
            seen[slice(None) if joint is None else joint] += priors.FAILED**2 * size
        return np.sqrt(seen)

    def _at_best_shapes(self, rated: Sequence[Rated]) -> list[Rated]:
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
        refined_names = [self.rating.at_best_shape(r, self.scored.model) for r in near]
        return by_formula([*refined_names, *(r for r in rated if r not in near)])

    def _try(self, choice: Rated) -> None:
        """Add the choice, its shape searched, if nothing is against it elsewhere."""
        score = self._at_best_shape(choice.score)
        trial = self.gate.with_term(self.model, score.term)
        score = replace(score, term=trial.terms[-1])
        answer = self.gate.asked(score, self.model, trial)
        place, found = score.term.family, answer.found
        if answer.reason:
            if answer.worse:
                self.worse.add((frozenset(map(family, self.model.terms)), family(choice.term)))
            else:
                self.refused.add(family(choice.term))
            self._note(score, "rejected", answer.reason)
            if not answer.faint and isinstance(score.term.content, Law):
                # A curve that does not hold elsewhere: no other curve of this joint is a candidate, but names are.
                self.without_law.add(score.term.joint)
                self.unconfirmed.append(Unconfirmed(score, found.held_out, found.validate_gain or 0.0))
            elif not answer.faint and not answer.worse:
                self.failed.append((score.term.joint, score.gain))
            return
        # What is in the model itself is no other name any more for what was found before.
        self.accepted = [
            replace(item, rivals=tuple(rival for rival in item.rivals if rival.term.family != place))
            for item in self.accepted
        ]
        self.accepted.append(found)
        self._note(score, "accepted", Sentence("fitting.gains_chi_square", gain=score.gain))
        self.before, self.model = self.scored, trial
        self.fresh.clear()

    def _at_best_shape(self, score: Score) -> Score:
        """Score a name at its best shape; a law with as many functions as needed, of two signals where better."""
        if not isinstance(score.term.content, Law):
            name = refined(self.model, score)
            held = tuple(np.flatnonzero((np.asarray(name.values) == 0.0) & (np.asarray(name.free) != 0.0)).tolist())
            return replace(name, term=replace(name.term, held=held))
        law = resolved(self.model, score)
        assert law.term.joint is not None
        found = best_surface(self.model, law.term.joint, score.term.content.signals[0])
        if found is None:
            return law
        found = resolved(self.model, found)
        one, two = (
            float(named_evidence(np.array([s.gain]), np.array([float(s.live)]), np.array([np.sqrt(s.gain)]))[0, 0])
            for s in (law, found)
        )
        return found if two - np.log(found.grid) > one + priors.CREDIBLE_ODDS else law

    def exchange(self) -> bool:
        """Drop a term that is not needed beside the others, or replace one that is beaten; False where none is.

        Here gains are divided by how much noisier the rows that show them are in what the model leaves.
        """
        self._without_needless_lines()
        self.settled = True
        self.slots = []
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
            self.settled = True
            self.slots = [self._slot(n, final=True) for n in range(self.known, len(self.accepted))]
        self._without_improbable()
        if not self.slots:
            self.open = self._open()

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
        known = next((m for m in (self.base, self.before.model) if m.terms == tuple(rest)), None)
        model = self.signals.refit(rest) if known is None else known
        all_, self.accepted = self.accepted, others
        own, content = family(item.score.term), item.score.term.content
        surfaces = [item.score] if isinstance(content, Surface) and not content.twist else []  # twists are candidates
        rated = self._at_best_shapes(self._beside(self._rated(model, surfaces=surfaces), rest))
        slot = Slot.of(item, rated)
        self.accepted = all_
        named = isinstance(content, Effect)
        choice = decided(rated, there=named) if rated and slot.nothing <= 1 - priors.CREDIBLE else None
        instead = frozenset([*map(family, rest), *([] if choice is None else [family(choice.term)])])
        if final or instead in self.held or (choice is not None and family(choice.term) == own):
            return slot
        self.held.add(instead)
        self.accepted, self.model = others, model
        if choice is None:
            self.unneeded.add(own)
            self._note(item.score, "rejected", Sentence("fitting.not_needed_beside_found"))
            return replace(slot, moved=True)
        self._note(item.score, "rejected", Sentence("fitting.another_explanation_more_probable"))
        self._try(choice)
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
            self._open_questions(),
            places=self._places(),
            nothing_more=self.rate_nothing() if len(self.accepted) - self.known >= priors.MOST else 1.0,
        )

    def _places(self) -> tuple[Place, ...]:
        """List the questions: of each added term, of what was dropped, or of everything where nothing was added."""
        dropped = {slot.item.score.term.family for slot in self.dropped}
        left = [tuple((t, p) for t, p in s.place if t is None or t.family not in dropped) for s in self.dropped]
        asked = [slot.place for slot in self.slots]
        return (*asked, *left) if asked or left else (open_place(self.open),)

    def rate_nothing(self) -> float:
        """Rate all candidates beside the model: the probability that nothing more is missing."""
        self.settled = True
        self.open = self._open()
        return float(np.exp(-np.logaddexp.reduce([0.0, *(r.log_odds for r in self.open)])))

    def _open_questions(self) -> tuple[Unconfirmed, ...]:
        """List unconfirmed laws of joints without findings where something is certainly missing.

        It holds on blocks that were left out of the fit, or two runs of one motion leave the same.
        """
        best: dict[int | None, Unconfirmed] = {}
        for item in self.unconfirmed:
            joint = item.score.term.joint
            if joint is None or any(_gains_at(found.score, joint) for found in self.accepted):
                continue
            left = self.signals.misfit(self.model, joint)
            shared = left.z > SHARED_Z and left.excess > NEAR * item.score.gain
            if (shared or item.held_out.confirmed > CONFIRMED) and (
                joint not in best or item.score.gain > best[joint].score.gain
            ):
                best[joint] = item
        return tuple(best.values())

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


def _gains_at(score: Score, joint: int | None) -> bool:
    """Return whether most of what a term gains is of the effort of this joint."""
    return score.places[joint] > 0.5 if score.places and joint is not None else score.term.joint == joint


def _contending(rated: Sequence[Rated]) -> list[Rated]:
    """List explanations whose odds noise in the regressors may decide.

    They contend with nothing, and with the best of all: what is far below it remains there unless it falls.
    """
    least = max(rated[0].log_odds, 0.0) - priors.CREDIBLE_ODDS if rated else 0.0
    return [r for r in rated if r.log_odds > least and r.score.gain < BEYOND_BIAS][:MOST_CONTENDERS]
