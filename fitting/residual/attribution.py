"""From residual to named effect: forward selection with a joint refit, one at a time, each confirmed on `validate`.

The rules by which it decides are in :mod:`fitting.residual.rules`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fitting.effects.base import Effect
from fitting.friction_power import CERTAIN, driving, friction_power, rubs
from fitting.residual import rules
from fitting.residual.confirmation import worse_joint
from fitting.residual.draws import Draws
from fitting.residual.findings import Accepted, Attribution, Candidate, Family, Unconfirmed
from fitting.residual.laws import Law
from fitting.residual.look_ahead import first_of_two
from fitting.residual.refinement import finer, refined
from fitting.residual.rules import (
    ACCUSE,
    DOUBT_SHARE,
    LAW_WINS,
    LAW_WINS_SHARE,
    LEAST_Z_ALONE,
    MISFIT_SHARE,
    MISFIT_Z,
    MOST_CONTENDERS,
    MOST_EFFECTS,
    MOST_RIVALS,
    MOST_SHARPENED,
    NEAR_SHARE,
    OUTDONE_SHARE,
    OVERLAP,
    RIVAL_SHARE,
    SERIES_SHARE,
    UNRELATED_SHARE,
)
from fitting.residual.scoring import (
    PARAMETER_PRICE,
    Candidates,
    Score,
    catalogue_terms,
    law_terms,
    score_terms,
    white_columns,
)
from fitting.residual.surfaces import Surface, best_surface, best_twist
from fitting.residual.terms import Model, Term
from fitting.residual.trials import Signals, Trials, without_gain_beside
from fitting.residual.witness import Witness, objection, witness

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[float, str], None]


def attribute(
    base: Model,
    effects: Sequence[Effect],
    validate: Sequence[int],
    signals: Signals,
    bootstrap: int = 0,
    known: Sequence[Accepted] = (),
    progress: Progress = lambda fraction, text: None,
) -> Attribution:
    """Run the loop on a fitted base model.

    Parameters
    ----------
    base : joint fit of the base model
    effects : the catalogue
    validate : segments of the `validate` recordings; nothing is selected on them, they only confirm or refuse
    signals : refits, with delays and the like corrected in the signals themselves
    known : what was found before, in the order of the base's terms (spectral lines)
    bootstrap : most replicas that a null distribution is drawn from; 0 trusts the chi-square
    progress : called with a fraction and plain words
    """
    selection = _Selection(base, effects, validate, signals, bootstrap, known)
    for number in range(MOST_EFFECTS + 3):
        progress(min(0.9, number / 4), f"looking for what is missing, round {number + 1}")
        if not selection.step():
            break
    selection.prune()
    return selection.result()


class _Selection:
    """State of the forward selection: the model so far, what was accepted or refused, and the table of candidates."""

    def __init__(
        self,
        base: Model,
        effects: Sequence[Effect],
        validate: Sequence[int],
        signals: Signals,
        bootstrap: int,
        known: Sequence[Accepted],
    ) -> None:
        self.base, self.effects, self.validate, self.signals = base, effects, validate, signals
        self.trials, self.draws = Trials(signals, validate), Draws(signals, bootstrap)
        self.model = base
        self.accepted: list[Accepted] = list(known)
        self.refused: set[Family] = set()
        self.refuted_joints: set[int | None] = set()
        self.waiting: set[Family] = set()
        self.table: dict[Family, Candidate] = {}
        for item in known:
            family = item.score.term.family
            self.table[family] = Candidate(*family, item.score.score, "accepted", rules.why(item.score, None))
        self.limits: tuple[Score, ...] = ()
        self.scored: Model | None = None
        self.unconfirmed: list[Unconfirmed] = []
        self.failed: list[Score] = []
        self.named: dict[Family, Score] = {}
        self.laws: dict[int | None, Score] = {}

    def step(self) -> bool:
        """One round: score everything, add, refuse or take back one thing. False when there is nothing left to do."""
        self._score()
        if not self.limits:
            self.limits = tuple(self.named.values())
        rules.record(self.table, self.named, self.accepted)
        self._unbias()
        names, laws = self._whole(self._open_names()), self._whole(self._open_laws())
        if self._outdone(names, laws):
            return True
        names = self._with_moved_efforts(names)
        choice = rules.choose(self._sharpened(names, laws), laws, self.accepted)
        if choice is None and len(self.accepted) < MOST_EFFECTS:
            choice = self._twist()
        if choice is None or len(self.accepted) >= MOST_EFFECTS:
            return self._doubt()
        choice = self._ahead(choice, names)
        wrong = rules.refutes(choice, self.accepted) if isinstance(choice.term.content, Law) else None
        if wrong is not None and self.trials.stands(choice, self._without(wrong)):
            self._take_back(wrong, "a law of one signal explains much more on this joint")
        else:
            self._try(choice)
        return True

    def _twist(self) -> Score | None:
        """A product of two signals on a joint that has no finding, where no law of one signal sees anything."""
        taken = {item.score.term.joint for item in self.accepted} | {joint for id, joint in self.refused if id == "law"}
        joints = [joint for joint in range(len(self.base.design.machine.joints)) if joint not in taken]
        found = best_twist(self.model, joints)
        if found is None or found.score <= ACCUSE or rules.is_misfit(found, self.accepted):
            return None
        return next((s for s in self._whole(self.draws.unbiased(self.model, [found])) if s.calibrated > ACCUSE), None)

    def _with_moved_efforts(self, names: Sequence[Score]) -> list[Score]:
        """The names; a delay that comes near the best of its joint with what moving the effort gains.

        Its column is its beginning only, and what resembles that has the whole of its formula.
        """
        best = max((s for s in names if s.calibrated > ACCUSE), key=lambda s: s.score, default=None)
        if best is None:
            return list(names)
        late = next((s for s in names if s.term.family == ("sensor_latency", best.term.joint)), None)
        if late is None or late is best or late.gain <= RIVAL_SHARE * best.gain:
            return list(names)
        trial = self.trials.with_term(self.model, late.term)
        more = self.model.fit.chi_square - trial.fit.chi_square - late.gain
        if more <= 0:
            return list(names)
        moved = replace(late, gain=late.gain + more, score=late.score + more, null=None)
        self.named[late.term.family] = moved
        return [moved if score is late else score for score in names]

    def _sharpened(self, names: Sequence[Score], laws: Sequence[Score]) -> list[Score]:
        """The names, those that a law would beat for want of a finer grid with their shapes searched.

        A spline adapts itself; a name of the same joint that reaches :data:`NEAR_SHARE` of its gain is given the same.
        """
        choice = rules.choose(names, laws, self.accepted)
        if choice is None or not isinstance(choice.term.content, Law):
            return list(names)
        near = self._near(names, choice)
        return [*(s for s in names if s not in near), *(refined(self.model, s) for s in near)]

    def _near(self, names: Sequence[Score], law: Score) -> list[Score]:
        """The best names of a law's joint that reach a share of its gain."""
        near = [s for s in names if s.term.joint == law.term.joint and s.gain > NEAR_SHARE * law.gain]
        return sorted(near, key=lambda s: -s.score)[:MOST_SHARPENED]

    def _ahead(self, choice: Score, names: Sequence[Score]) -> Score:
        """The choice, or for a law the first of two names that explain as much as it does."""
        if isinstance(choice.term.content, Effect) or self.model.design is not self.base.design:
            return choice
        name = first_of_two(
            self.model,
            choice,
            self._near([s for s in names if s.calibrated > ACCUSE], choice),
            lambda term: self.signals.refit([*self.model.terms, term]),
            self.candidates,
        )
        return choice if name is None else name

    def _outdone(self, names: Sequence[Score], laws: Sequence[Score]) -> bool:
        """Take back a lone name whose formula is not nature's: a law of one signal explains the same, and more.

        So it is where a law takes what no right formula leaves, whatever its signal. What is left must be no other
        name's as well: then it may be a second effect.
        """
        for law in sorted(laws, key=lambda s: -s.score):
            joint = law.term.joint
            others = [s for s in names if s.term.joint == joint and s.calibrated > ACCUSE]
            best = max((s.score for s in others), default=-np.inf)
            if law.calibrated <= LAW_WINS or law.score - best < LAW_WINS:
                continue
            number = self._alone(joint)
            if number is None:
                continue
            item = self.accepted[number]
            content = item.score.term.content
            share = SERIES_SHARE if isinstance(content, Effect) and content.series else OUTDONE_SHARE
            if law.gain < share * item.score.gain:
                continue
            rest = self._without(number)
            trial = self.signals.refit([*rest, law.term])
            again = score_terms(trial, [item.score.term], [1])
            outdone = (again[0].gain if again else 0.0) < (1 - OVERLAP) * item.score.gain
            if (outdone or law.gain >= MISFIT_SHARE * item.score.gain) and self.trials.stands(law, rest, trial):
                self._take_back(number, "a law of one signal explains the same and more")
                return True
        return False

    def _without(self, number: int) -> list[Term]:
        """The accepted terms but one."""
        return [item.score.term for n, item in enumerate(self.accepted) if n != number]

    def _alone(self, joint: int | None) -> int | None:
        """Number of the accepted name that stands alone on a joint; None where there is none, or something else too."""
        there = [n for n, item in enumerate(self.accepted) if item.score.term.joint == joint]
        if joint is None or len(there) != 1:
            return None
        term = self.accepted[there[0]].score.term
        # A line in the spectrum was found on its own; what acts everywhere is no matter of one joint.
        named = isinstance(term.content, Effect) and term.id != "supply_ripple" and not term.everywhere
        return there[0] if named else None

    def _score(self) -> None:
        if self.scored is self.model:
            return
        if self.scored is None:
            terms, grid = catalogue_terms(self.model, self.effects)
            spline_terms, spline_grid = law_terms(self.model)
            self.candidates = Candidates(self.model, [*terms, *spline_terms], [*grid, *spline_grid])
            scores = self.candidates.scores(self.model)
        else:
            self.candidates.follow(self.scored, self.model)
            # Columns with the force of an earlier model show who matters; those are made anew.
            scores = self.candidates.scores(self.model)
            near = {n for n, score in scores.items() if score.score > ACCUSE - PARAMETER_PRICE}
            self.candidates.refresh(self.model, near)
            scores = self.candidates.scores(self.model)
        self.named = rules.best_by_family([s for s in scores.values() if isinstance(s.term.content, Effect)])
        self.laws = rules.best_by_joint([s for s in scores.values() if isinstance(s.term.content, Law)])
        self.scored = self.model

    def _unbias(self) -> None:
        """Take off the contenders what they would be worth where there is nothing to find.

        Noise in accelerations pushes some candidates to impossible values and hides them where they are real, so all
        joints of an effect that contends are looked at. A null that was drawn stays: it is noise, not structure.
        """
        there = {item.score.term.family for item in self.accepted} | self.refused
        names = [s for s in self.named.values() if s.term.family not in there and not rules.is_misfit(s, self.accepted)]
        laws = [
            s
            for s in self._open_laws()
            if not rules.is_misfit(s, self.accepted) or self._alone(s.term.joint) is not None
        ]
        contending = {s.term.id for s in names if s.score > ACCUSE and s.term.uses_model}
        chosen = [s for s in (*names, *laws) if s.score > ACCUSE or s.term.id in contending]
        chosen = sorted(chosen, key=lambda s: -s.score)[:MOST_CONTENDERS]
        for score in self.draws.unbiased(self.model, chosen):
            if isinstance(score.term.content, Effect):
                self.named[score.term.family] = score
            else:
                self.laws[score.term.joint] = score

    def _open_names(self) -> list[Score]:
        return [
            score
            for score in self.named.values()
            if score.plausible
            and score.term.id != "supply_ripple"  # found as a line, or not at all
            and score.term.family not in self.refused
            and score.term.joint not in self.refuted_joints
            and not rules.there(self.accepted, score)
        ]

    def _open_laws(self) -> list[Score]:
        return [
            score
            for score in self.laws.values()
            if score.term.family not in self.refused and not rules.law_there(self.accepted, score)
        ]

    def _whole(self, scores: Sequence[Score]) -> list[Score]:
        """Those scores that are no fragments of what is certainly there, and unexplained."""
        return [s for s in scores if not rules.is_fragment(s, self.failed, self.accepted)]

    def _take_back(self, number: int, reason: str) -> None:
        """An accepted name was wrong; its joint gets a law, not another name."""
        self.refuted_joints.add(self.accepted[number].score.term.joint)
        self._drop(number, f"{reason}: it is not this effect")

    def _drop(self, number: int, reason: str) -> None:
        """Refit without an accepted term; those that stood in a set with it fall with it."""
        self.model = self.signals.refit(self._without(number))
        item = self.accepted.pop(number)
        for score in (item.score, *item.rivals):
            family = score.term.family
            self.table[family] = replace(self.table[family], status="rejected", reason=reason)

    def _doubt(self) -> bool:
        """Take back a lone name on a joint where much is left that no further candidate explains."""
        for number, item in enumerate(self.accepted):
            term = item.score.term
            alone = sum(other.score.term.joint == term.joint for other in self.accepted) == 1
            if isinstance(term.content, Law) or term.everywhere or term.joint is None or not alone:
                continue
            left = self.signals.misfit(self.model, term.joint)
            if left.z > MISFIT_Z and DOUBT_SHARE < left.excess / item.score.gain < UNRELATED_SHARE:
                self._take_back(number, f"it leaves too much (chi-square {left.excess:.0f}) of what two runs share")
                return True
        return False

    def _try(self, choice: Score) -> None:
        """Add the choice if it helps on the validation motion; of a law, first what a second signal adds to it."""
        if isinstance(choice.term.content, Law):
            if not isinstance(choice.term.content, Surface):
                choice = finer(self.model, choice)
            surface = self._surface(choice)
            if surface is not None and not self._added(surface, ""):
                return
        else:
            choice = refined(self.model, choice)
        seen = self._witness(choice)
        reason = ""
        if isinstance(choice.term.content, Effect) and seen is not None:
            against = objection(choice.term.content.level, seen)
            if against:
                reason = f"an effect of the drive itself has to be there without a load: {against}"
        reason = reason or self._added(choice, "" if seen is None else seen.words)
        if reason:
            family = choice.term.family
            self.refused.add(family)
            self.table[family] = Candidate(*family, choice.score, "rejected", reason)

    def _surface(self, law: Score) -> Score | None:
        """A law of two signals, where it is clearly better than the law of one that is about to be said."""
        assert law.term.joint is not None and isinstance(law.term.content, Law)
        found = best_surface(self.model, law.term.joint, law.term.content.signals[0])
        if found is None or found.score - law.score < max(LAW_WINS, LAW_WINS_SHARE * found.gain):
            return None
        return found

    def _waits_for(self, joint: int, family: Family) -> bool:
        """Whether what a joint lacks itself was added first; a choice that made that joint worse is judged anew then.

        Parameters that two joints share are bent by both effects: the right one of two may lay bare what the other
        had hidden.
        """
        if len(self.accepted) + 1 >= MOST_EFFECTS or family in self.waiting or family[1] == joint:
            return False
        names, laws = (
            [s for s in self._whole(scores) if s.term.joint == joint]
            for scores in (self._open_names(), self._open_laws())
        )
        first = rules.choose(self._sharpened(names, laws), laws, self.accepted)
        if first is None:
            return False
        self.waiting.add(family)
        before = self.model
        self._try(first)
        return self.model is not before

    def _added(self, choice: Score, witnessed: str) -> str:
        """Add the choice to the model, or say why not; nothing is against one that waits for another."""
        trial = self.trials.with_term(self.model, choice.term)
        choice = replace(choice, term=trial.terms[-1])
        family = choice.term.family
        held_out, seen, reason = self.trials.judged(choice, self.model, trial)
        gain = None if seen is None else seen.gain
        worse = None if seen is None else worse_joint(self.model, trial, self.validate)
        if worse is not None and not reason:
            if self._waits_for(worse[0], family):
                return ""
            name = self.base.design.parameters.joints[worse[0]]
            reason = f"it makes {name} worse on the validation motion (error {100 * worse[1]:+.1f} %)"
        reason = reason or self._driving(choice, trial)
        if reason:
            if rules.too_faint(choice, held_out):
                return reason
            self.failed.append(choice)
            if isinstance(choice.term.content, Law):
                self.unconfirmed.append(Unconfirmed(choice, held_out, float(gain or 0.0)))
            return reason
        rivals: Sequence[Score] = ()
        if not isinstance(choice.term.content, Law):
            near = rules.rivals(choice, self.named, self.refused)
            rivals = without_gain_beside(self.model, trial, near)[:MOST_RIVALS]
        # What is in the model itself is no other name any more for what was added before.
        self.accepted = [
            replace(item, rivals=tuple(rival for rival in item.rivals if rival.term.family != family))
            for item in self.accepted
        ]
        self.accepted.append(Accepted(choice, tuple(rivals), held_out, gain, witnessed))
        self.table[family] = Candidate(*family, choice.score, "accepted", rules.why(choice, seen))
        for rival in rivals:
            words = f"within {choice.score - rival.score:.1f} of {choice.term.id}: this data cannot tell them apart"
            self.table[rival.term.family] = Candidate(*rival.term.family, rival.score, "indistinguishable", words)
        self.model = trial
        return ""

    def _driving(self, choice: Score, trial: Model) -> str:
        """Whether a friction turns the whole friction of its joint into a drive; signs of single parts say nothing."""
        joint = choice.term.joint
        if joint is None or not rubs(choice.term, joint):
            return ""
        found = driving(friction_power(trial, joint), trial.fit, CERTAIN)
        if found is None or driving(friction_power(self.model, joint), self.model.fit, CERTAIN) is not None:
            return ""
        name = self.base.design.parameters.joints[joint]
        return (
            f"with it the friction of {name} would drive the motion at {found.speed:.3g} of speed "
            f"({found.force:.3g} ± {found.std:.2g})"
        )

    def _witness(self, choice: Score) -> Witness | None:
        """What unloaded and loaded recordings say of a candidate; None where one of the two is not there."""
        joint, design = choice.term.joint, self.model.design
        loaded = {design.segments[i].loaded for i in self.model.fitted}
        if joint is None or choice.term.everywhere or len(loaded) < 2:
            return None
        columns, unloaded = white_columns(self.model, choice.term)
        return witness(columns, self.model.fit.residual[joint], self.model.fit.orthonormal[joint], unloaded)

    def prune(self) -> None:
        """Backward: drop what no longer earns its place beside the others."""
        while len(self.accepted) > 1:
            worth = [self._worth(number) for number in range(len(self.accepted))]
            weakest = int(np.argmin(worth))
            if worth[weakest] >= ACCUSE / 2:
                break
            self._drop(weakest, "not needed any more beside the effects added later")

    def _worth(self, number: int) -> float:
        """Chi-square that dropping an accepted term would cost, less the price of its parameters (Wald's)."""
        fit, part = self.model.fit, self.model.term_slice(number)
        told = fit.told[part]
        values = fit.theta[part][told]
        if self.model.terms[number].rebuilt:  # what was moved into the signals counts as well
            values = values + np.asarray(self.model.terms[number].rebuilt)[told]
        covariance = fit.covariance[part, part][np.ix_(told, told)]
        wald = float(values @ np.linalg.pinv(covariance) @ values) if told.any() else 0.0
        return wald - PARAMETER_PRICE * int(told.sum())

    def _open_questions(self) -> tuple[Unconfirmed, ...]:
        """Unconfirmed laws of joints where nothing else was found, and something certainly is.

        It holds on blocks that were left out of the fit, or two runs of one motion leave the same.
        """
        found = {item.score.term.joint for item in self.accepted}
        best: dict[int | None, Unconfirmed] = {}
        for item in self.unconfirmed:
            joint = item.score.term.joint
            if joint is None or joint in found:
                continue
            left = self.signals.misfit(self.model, joint)
            shared = left.z > MISFIT_Z and left.excess > DOUBT_SHARE * item.score.gain
            certain = shared or item.held_out.z >= LEAST_Z_ALONE
            if certain and (joint not in best or item.score.score > best[joint].score.score):
                best[joint] = item
        return tuple(best.values())

    def result(self) -> Attribution:
        """What was found, with a warning for every joint on which a law still gains something."""
        joints = self.base.design.parameters.joints
        warnings = []
        if self.accepted:
            self._score()
            for score in self.laws.values():
                law = score.term.content
                if score.score > ACCUSE and isinstance(law, Law):
                    warnings.append(
                        f"{joints[score.term.joint or 0]}: a small structure in {law.variable(joints)} is left "
                        f"(chi-square {score.gain:.0f}); the added effect does not describe it completely"
                    )
        ordered = tuple(sorted(self.table.values(), key=lambda c: -c.score))
        return Attribution(
            self.base,
            self.model,
            tuple(self.accepted),
            ordered,
            self.limits,
            tuple(warnings),
            self._open_questions(),
        )
