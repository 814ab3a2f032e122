"""From residual to named effect: forward selection with a joint refit, one at a time, each confirmed on `validate`.

Decisions and where their numbers come from (``docs/decisions/0003-attribution.md``):

accuse
    A candidate has to gain :data:`ACCUSE` beyond the price of its parameters. One parameter then needs a chi-square
    of 20 (p = 8e-6), which pays for some hundred independent looks per joint at one per cent.
name or law
    A named effect that leaves a spline of one signal clearly better off is not the explanation; the law is said.
set
    Two candidates with one parameter differ by ``lambda^2 (1 - rho^2)`` on average, with twice its root as
    standard deviation; a rival within :data:`SET_WIDTH` could be the truth with a chance of more than half a per cent.
hold
    It has to hold on blocks of the fitted recordings that were left out of the fit.
confirm
    What does not lower the whitened error of `validate` is refused, whatever it gained in training.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fitting.effects.base import Effect
from fitting.prior import Prior
from fitting.residual.change_points import ChangePoint
from fitting.residual.confirmation import Misfit, validate_gain, worse_joint
from fitting.residual.cross_validation import HeldOut, held_out_gain
from fitting.residual.laws import Law
from fitting.residual.lines import Line
from fitting.residual.null import Null
from fitting.residual.refinement import finer, refined
from fitting.residual.scoring import (
    PARAMETER_PRICE,
    Candidates,
    Score,
    catalogue_terms,
    law_terms,
    score_terms,
    white_columns,
)
from fitting.residual.terms import Model, Term
from fitting.residual.witness import Witness, objection, witness

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[float, str], None]
#: Effect id (``law``) and joint.
Family = tuple[str, int | None]

ACCUSE = 14.0
SET_WIDTH = 7.0
SET_SHARE = 0.02
LAW_WINS = 6.0
LAW_WINS_SHARE = 0.05
MOST_EFFECTS = 4
MOST_RIVALS = 2
#: A name that leaves this share of its own gain, significantly, in what two runs of one motion share, was wrong.
#: What is left of many times its gain is another matter.
DOUBT_SHARE, UNRELATED_SHARE, MISFIT_Z = 0.33, 3.0, 4.0
#: Contenders whose null is drawn, and replicas that are drawn before the decision is looked at again.
MOST_CONTENDERS = 24
LEAST_DRAWS = 3
#: Standard errors by which the gain on held-out blocks has to be above zero; more where no validation motion is there.
LEAST_Z, LEAST_Z_ALONE = 1.5, 3.0
#: What keeps this share of its gain on held-out blocks holds, even if a few of them brought it all: a resonance rings
#: where it was hit, a load is overrun in one place.
HELD_SHARE = 0.5
#: What is left of an effect's own gain on its own joint is the difference between its formula and nature's.
MISFIT_SHARE = 0.1
#: The same for a spline's limited resolution, in the signal that it is a law of.
LAW_MISFIT_SHARE = 0.25
#: The same on other joints, where only the coupling through the rigid body shows.
SPILL_SHARE = 0.01
#: The same of what nothing explains: a model that is known to be wrong spills more.
UNEXPLAINED_SPILL = 0.05
#: A law that still gains this share of a named effect's gain on the same joint says that the name was wrong.
REFUTED_SHARE = 0.25
#: The same where the law, alone, takes :data:`OVERLAP` of the name's gain: both explain one thing, and one of them is
#: not its formula. Right formulas leave less than a hundredth as a rule; those that are short series, some more.
OUTDONE_SHARE, SERIES_SHARE, OVERLAP = 0.02, 0.06, 1 / 3


@dataclass(frozen=True)
class Accepted:
    """One effect or law that was added.

    Attributes
    ----------
    score : as it was chosen
    rivals : the other members of its set, at most two, best first
    held_out : its gain on held-out blocks of the fitted recordings
    validate_gain : chi-square that it takes off the whitened residual of `validate`; None without one
    witness : what unloaded and loaded recordings say of it, in words; empty where only one kind is there
    cutoffs : its leading parameter at several cut-offs of the filter: (Hz, value, standard deviation)
    """

    score: Score
    rivals: tuple[Score, ...]
    held_out: HeldOut
    validate_gain: float | None
    witness: str = ""
    cutoffs: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class Unconfirmed:
    """A law of what is certainly there in the fitted motions, but does not hold on others: it is not added.

    Attributes
    ----------
    score : as it was chosen
    held_out : its gain on held-out blocks of the fitted recordings
    validate_gain : what it would have done to the chi-square of `validate`: nothing good
    """

    score: Score
    held_out: HeldOut
    validate_gain: float


@dataclass(frozen=True)
class Candidate:
    """One line of the report's table of candidates."""

    id: str
    joint: int | None
    score: float
    status: str
    reason: str


@dataclass(frozen=True)
class Attribution:
    """Result of the loop.

    Attributes
    ----------
    base, model : the base model and the final one
    accepted : what was added
    candidates : every family with what was said of it
    limits : the first round's scores, for detection limits
    warnings : lines for people
    unconfirmed : laws of what is there but does not hold on another motion
    lines : spectral lines of the residual (those inside the band are in ``accepted`` as well)
    changes : moments from which on a joint behaves otherwise
    """

    base: Model
    model: Model
    accepted: tuple[Accepted, ...]
    candidates: tuple[Candidate, ...]
    limits: tuple[Score, ...]
    warnings: tuple[str, ...]
    unconfirmed: tuple[Unconfirmed, ...] = ()
    lines: tuple[Line, ...] = ()
    changes: tuple[ChangePoint, ...] = ()

    @property
    def verdict(self) -> str:
        """Verdict of the report."""
        if not self.accepted:
            return "unexplained" if self.unconfirmed else "effect_added" if self.lines else "nothing_missing"
        if any(isinstance(a.score.term.content, Law) for a in self.accepted):
            return "unexplained"
        return "ambiguous" if any(a.rivals for a in self.accepted) else "effect_added"


class Signals(Protocol):
    """What can correct the signals themselves, for effects that a column cannot correct when they are large."""

    @property
    def prior(self) -> Prior:
        """What is known before any measurement."""
        ...

    def nulls(self, model: Model, terms: Sequence[Term], draws: int, first: int = 0) -> list[Null | None]:
        """What terms gain on replicas of the recordings in which the model is the whole truth."""
        ...

    def misfit(self, model: Model, joint: int) -> Misfit:
        """What the model leaves of a joint that two runs of one motion share."""
        ...

    def rebuilt(self, model: Model) -> Model:
        """The model with its last term moved into the signals as far as that term can be."""
        ...

    def refit(self, terms: Sequence[Term]) -> Model:
        """A fresh fit with these terms, on signals corrected as they say."""
        ...


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
        self.bootstrap = bootstrap
        self.model = base
        self.accepted: list[Accepted] = list(known)
        self.refused: set[Family] = set()
        self.refuted_joints: set[int | None] = set()
        self.table: dict[Family, Candidate] = {}
        for item in known:
            family = item.score.term.family
            self.table[family] = Candidate(*family, item.score.score, "accepted", _why(item.score))
        self.limits: tuple[Score, ...] = ()
        self.scored: Model | None = None
        self.unconfirmed: list[Unconfirmed] = []
        self.nulls: dict[tuple[object, ...], Null] = {}
        self.named: dict[Family, Score] = {}
        self.laws: dict[int | None, Score] = {}

    def step(self) -> bool:
        """One round: score everything, add, refuse or take back one thing. False when there is nothing left to do."""
        self._score()
        if not self.limits:
            self.limits = tuple(self.named.values())
        _record(self.table, self.named, self.accepted)
        self._unbias()
        names, laws = (
            [s for s in scores if not _is_fragment(s, self.unconfirmed, self.accepted)]
            for scores in (self._open_names(), self._open_laws())
        )
        if self._outdone(names, laws):
            return True
        choice = _choose(names, laws, self.accepted)
        if choice is None or len(self.accepted) >= MOST_EFFECTS:
            return self._doubt()
        wrong = _refutes(choice, self.accepted) if isinstance(choice.term.content, Law) else None
        if wrong is not None:
            self._take_back(wrong, "a law of one signal explains much more on this joint")
        else:
            self._try(choice)
        return True

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
            rest = [a.score.term for n, a in enumerate(self.accepted) if n != number]
            again = score_terms(self.signals.refit([*rest, law.term]), [item.score.term], [1])
            outdone = (again[0].gain if again else 0.0) < (1 - OVERLAP) * item.score.gain
            if outdone or law.gain >= MISFIT_SHARE * item.score.gain:
                self._take_back(number, "a law of one signal explains the same and more")
                return True
        return False

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
        if self.scored is None or self.scored.design is not self.model.design:
            terms, grid = catalogue_terms(self.model, self.effects)
            spline_terms, spline_grid = law_terms(self.model)
            self.candidates = Candidates(self.model, [*terms, *spline_terms], [*grid, *spline_grid])
            scores = self.candidates.scores(self.model)
        else:
            # Columns with the force of an earlier model show who matters; those are made anew.
            scores = self.candidates.scores(self.model)
            near = {n for n, score in scores.items() if score.score > ACCUSE - PARAMETER_PRICE}
            self.candidates.refresh(self.model, near)
            scores = self.candidates.scores(self.model)
        self.named = best_by_family([s for s in scores.values() if isinstance(s.term.content, Effect)])
        self.laws = best_by_joint([s for s in scores.values() if isinstance(s.term.content, Law)])
        self.scored = self.model

    def _unbias(self) -> None:
        """Take off the contenders what they would be worth where there is nothing to find.

        Noise in accelerations pushes some candidates to impossible values and hides them where they are real, so all
        joints of an effect that contends are looked at. A null that was drawn stays: it is noise, not structure.
        """
        if not self.bootstrap:
            return
        there = {item.score.term.family for item in self.accepted} | self.refused
        names = [s for s in self.named.values() if s.term.family not in there and not _is_misfit(s, self.accepted)]
        laws = [
            s for s in self._open_laws() if not _is_misfit(s, self.accepted) or self._alone(s.term.joint) is not None
        ]
        contending = {s.term.id for s in names if s.score > ACCUSE and s.term.uses_model}
        chosen = [s for s in (*names, *laws) if s.score > ACCUSE or s.term.id in contending]
        chosen = sorted(chosen, key=lambda s: -s.score)[:MOST_CONTENDERS]
        for score in self._with_nulls(chosen):
            if isinstance(score.term.content, Effect):
                self.named[score.term.family] = score
            else:
                self.laws[score.term.joint] = score

    def _with_nulls(self, scores: Sequence[Score]) -> list[Score]:
        """The scores with the bias of noisy regressors taken off, by as many replicas as the decision takes."""
        fresh = [s for s in scores if s.term.label not in self.nulls]
        drawn = 0
        while fresh and drawn < self.bootstrap:
            draws = min(LEAST_DRAWS, self.bootstrap - drawn)
            more = self.signals.nulls(self.model, [s.term for s in fresh], draws, drawn)
            for score, null in zip(fresh, more, strict=True):
                known = self.nulls.get(score.term.label)
                if null is not None:
                    self.nulls[score.term.label] = null if known is None else known.joined(null)
            drawn += draws
            best = max((self._against(s).calibrated for s in fresh if self._against(s).plausible), default=-np.inf)
            if not ACCUSE / 2 < best < 3 * ACCUSE:
                break  # more draws would not change the decision
        return [self._against(s) for s in scores]

    def _against(self, score: Score) -> Score:
        null = self.nulls.get(score.term.label)
        return score if null is None else score.against(null)

    def _open_names(self) -> list[Score]:
        return [
            score
            for score in self.named.values()
            if score.plausible
            and score.term.id != "supply_ripple"  # found as a line, or not at all
            and score.term.family not in self.refused
            and score.term.joint not in self.refuted_joints
            and not _there(self.accepted, score)
        ]

    def _open_laws(self) -> list[Score]:
        return [
            score
            for score in self.laws.values()
            if score.term.family not in self.refused and not _law_there(self.accepted, score)
        ]

    def _take_back(self, number: int, reason: str) -> None:
        """An accepted name was wrong; its joint gets a law, not another name."""
        family = self.accepted.pop(number).score.term.family
        self.refuted_joints.add(family[1])
        self.table[family] = replace(
            self.table[family],
            status="rejected",
            reason=f"{reason}: it is not this effect",
        )
        self.model = self.signals.refit([item.score.term for item in self.accepted])

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
        """Add the choice if it helps on the validation motion."""
        choice = (refined if isinstance(choice.term.content, Effect) else finer)(self.model, choice)
        seen = self._witness(choice)
        if isinstance(choice.term.content, Effect) and seen is not None:
            against = objection(choice.term.content.level, seen)
            if against:
                self.refused.add(choice.term.family)
                reason = f"an effect of the cylinder itself has to be there without a load: {against}"
                self.table[choice.term.family] = Candidate(*choice.term.family, choice.score, "rejected", reason)
                return
        terms = [*(item.score.term for item in self.accepted), choice.term]
        trial = self.signals.rebuilt(self.signals.refit(terms))
        choice = replace(choice, term=trial.terms[-1])
        family = choice.term.family
        held_out = self._held_out(trial)
        confirming = self.validate and not choice.term.confined
        gain = validate_gain(self.model, trial, self.validate) if confirming else None
        reason = _objection(choice, held_out, gain)
        worse = worse_joint(self.model, trial, self.validate) if confirming else None
        if worse is not None and not reason:
            name = self.base.design.parameters.joints[worse[0]]
            reason = f"it makes {name} worse on the validation motion (error {100 * worse[1]:+.1f} %)"
        if reason:
            if isinstance(choice.term.content, Law):
                self.unconfirmed.append(Unconfirmed(choice, held_out, float(gain or 0.0)))
            self.refused.add(family)
            self.table[family] = Candidate(*family, choice.score, "rejected", reason)
            return
        rivals = () if isinstance(choice.term.content, Law) else _rivals(choice, self.named, self.refused)
        self.accepted.append(Accepted(choice, rivals, held_out, gain, "" if seen is None else seen.words))
        self.table[family] = Candidate(*family, choice.score, "accepted", _why(choice))
        for rival in rivals:
            reason = f"within {choice.score - rival.score:.1f} of {choice.term.id}: this data cannot tell them apart"
            self.table[rival.term.family] = Candidate(*rival.term.family, rival.score, "indistinguishable", reason)
        self.model = trial

    def _witness(self, choice: Score) -> Witness | None:
        """What unloaded and loaded recordings say of a candidate; None where one of the two is not there."""
        joint, design = choice.term.joint, self.model.design
        loaded = {design.segments[i].loaded for i in self.model.fitted}
        if joint is None or choice.term.everywhere or len(loaded) < 2:
            return None
        columns, unloaded = white_columns(self.model, choice.term)
        return witness(columns, self.model.fit.residual[joint], self.model.fit.orthonormal[joint], unloaded)

    def _held_out(self, trial: Model) -> HeldOut:
        """Gain of the trial's last term on held-out blocks of the fitted recordings."""
        rows = trial.rows(self.signals.prior)
        part = trial.term_slice(len(trial.terms) - 1)
        if trial.terms[-1].rebuilt:  # its column holds what is left of it only: judge it on the signals before
            whole = trial.terms[-1]
            plain = self.signals.refit([*trial.terms[:-1], replace(whole, rebuilt=())])
            rows = plain.rows(self.signals.prior)
        return held_out_gain(rows, part.stop - part.start, trial.design.bank.reduced_rate_hz)

    def prune(self) -> None:
        """Backward: drop what no longer earns its place beside the others."""
        while len(self.accepted) > 1:
            worth = [self._worth(number) for number in range(len(self.accepted))]
            weakest = int(np.argmin(worth))
            if worth[weakest] >= ACCUSE / 2:
                break
            family = self.accepted.pop(weakest).score.term.family
            reason = "not needed any more beside the effects added later"
            self.table[family] = replace(self.table[family], status="rejected", reason=reason)
            self.model = self.signals.refit([item.score.term for item in self.accepted])

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
                        f"(chi-square {score.gain:.0f}); the added effect's formula is not exactly nature's"
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


def _objection(choice: Score, held_out: HeldOut, validate: float | None) -> str:
    """Why a term is not to be added; empty if there is nothing against it."""
    if choice.term.confined:  # most blocks know nothing of it, and no other recording does: it has to be plain
        if held_out.gain >= HELD_SHARE * choice.gain and choice.score > 2 * ACCUSE:
            return ""
        return "it acts in one recording only, and is not significant enough to be believed without another"
    alone = validate is None
    if not (held_out.gain > 0 and held_out.z >= LEAST_Z_ALONE if alone else _holds(choice.gain, held_out, LEAST_Z)):
        return (
            f"it does not hold on blocks that were left out of the fit (chi-square {held_out.gain:+.1f}, "
            f"{held_out.z:.1f} standard errors)"
        )
    if validate is not None and validate <= 0:
        return f"it does not help on the validation motion (chi-square {validate:+.1f})"
    return ""


def _holds(gain: float, held_out: HeldOut, least_z: float) -> bool:
    return held_out.gain > 0 and (held_out.z >= least_z or held_out.gain >= HELD_SHARE * gain)


def best_by_family(scores: Sequence[Score]) -> dict[Family, Score]:
    """Best shape of each effect on each joint; plausible ones come before implausible ones."""
    best: dict[Family, Score] = {}
    for score in scores:
        present = best.get(score.term.family)
        if present is None or (score.plausible, score.score) > (present.plausible, present.score):
            best[score.term.family] = score
    return best


def best_by_joint(scores: Sequence[Score]) -> dict[int | None, Score]:
    """Best law of each joint."""
    best: dict[int | None, Score] = {}
    for score in scores:
        if score.term.joint not in best or score.score > best[score.term.joint].score:
            best[score.term.joint] = score
    return best


def _choose(names: Sequence[Score], laws: Sequence[Score], accepted: Sequence[Accepted]) -> Score | None:
    """The next thing to add: the best name, or a law that leaves the best name behind."""
    names = [s for s in names if s.calibrated > ACCUSE and not _is_misfit(s, accepted)]
    laws = [s for s in laws if s.calibrated > ACCUSE]
    laws = [s for s in laws if not _is_misfit(s, accepted) or _refutes(s, accepted) is not None]
    name = max(names, key=lambda s: s.score, default=None)
    law = max(laws, key=lambda s: s.score, default=None)
    if law is None or name is None:
        return law if name is None else name
    return law if law.score - name.score > max(LAW_WINS, LAW_WINS_SHARE * law.gain) else name


def _is_misfit(score: Score, accepted: Sequence[Accepted]) -> bool:
    """Whether a gain is small enough to be what an accepted effect's formula leaves of nature's."""
    for item in accepted:
        term = item.score.term
        own = term.everywhere or term.joint == score.term.joint or score.term.everywhere
        share = MISFIT_SHARE if own else SPILL_SHARE
        if isinstance(term.content, Law) and own and _same_signal(score, term.content):
            content = score.term.content
            # The odd part of a law is no misfit of its even part: one signal may have both.
            other_part = isinstance(content, Law) and content.signed != term.content.signed
            share = SPILL_SHARE if other_part else LAW_MISFIT_SHARE
        if score.gain < share * item.score.gain:
            return True
    return False


def _is_fragment(score: Score, unconfirmed: Sequence[Unconfirmed], accepted: Sequence[Accepted]) -> bool:
    """Whether a gain is a small part only of what is certainly there, on its joint or another, and yet unexplained."""
    explained = {item.score.term.joint for item in accepted}
    for item in unconfirmed:
        joint = item.score.term.joint
        here = score.term.everywhere or score.term.joint == joint
        share = REFUTED_SHARE if here else UNEXPLAINED_SPILL
        if joint not in explained and score.gain < share * item.score.gain:
            return True
    return False


def _same_signal(score: Score, law: Law) -> bool:
    content = score.term.content
    if isinstance(content, Law):
        return (content.signal, content.other) == (law.signal, law.other)
    return law.other is None and content.variable in (
        law.signal,
        "joint_position" if law.signal == "piston_position" else "",
    )


def _refutes(score: Score, accepted: Sequence[Accepted]) -> int | None:
    """Number of an accepted *name* on the same joint that this law shows to be wrong."""
    for number, item in enumerate(accepted):
        term = item.score.term
        # A line in the spectrum was found on its own; no law of a signal can stand for it.
        named = isinstance(term.content, Effect) and term.id != "supply_ripple"
        named_here = named and term.joint == score.term.joint
        if named_here and score.gain > REFUTED_SHARE * item.score.gain:
            return number
    return None


def _rivals(choice: Score, named: dict[Family, Score], refused: set[Family]) -> tuple[Score, ...]:
    """Candidates that could be the truth as well; where a bias was taken off, as far as its doubt reaches."""

    def width(rival: Score) -> float:
        doubts = [s.null.doubt(s.information, s.gain) for s in (choice, rival) if s.null is not None]
        return max(SET_WIDTH, SET_SHARE * choice.gain) + max(doubts, default=0.0)

    near = [
        s
        for s in named.values()
        if s.plausible
        and s.term.family != choice.term.family
        and s.term.family not in refused
        and abs(choice.score - s.score) < width(s)
    ]
    return tuple(sorted(near, key=lambda s: -s.score)[:MOST_RIVALS])


def _there(accepted: Sequence[Accepted], score: Score) -> bool:
    return any(item.score.term.family == score.term.family for item in accepted)


def _law_there(accepted: Sequence[Accepted], score: Score) -> bool:
    law = score.term.content
    for item in accepted:
        present = item.score.term.content
        if not isinstance(present, Law) or not isinstance(law, Law) or item.score.term.joint != score.term.joint:
            continue
        if (present.signal, present.other, present.signed) == (law.signal, law.other, law.signed):
            return True
    return False


def _record(
    table: dict[Family, Candidate],
    named: dict[Family, Score],
    accepted: Sequence[Accepted],
) -> None:
    """Note what each family could do in this round, unless it already has its say."""
    for family, score in named.items():
        if (family in table and table[family].status != "rejected") or family in {
            a.score.term.family for a in accepted
        }:
            continue
        if not score.plausible and score.score > ACCUSE:
            values = ", ".join(f"{v:.3g}" for v in score.values)
            status, reason = "rejected", f"it would need an impossible parameter ({values})"
        elif score.score <= ACCUSE:
            status, reason = (
                "rejected",
                f"gains {score.gain:.1f} of chi-square, less than the noise and its price ask for",
            )
        else:
            status, reason = "rejected", "significant, but another effect explains the same better"
        if family not in table or score.score > table[family].score:
            table[family] = Candidate(score.term.id, score.term.joint, score.score, status, reason)


def _why(score: Score) -> str:
    return f"gains {score.gain:.0f} of chi-square for {score.live} parameter{'s' if score.live > 1 else ''}"
