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
from fitting.residual.confirmation import validate_gain
from fitting.residual.cross_validation import HeldOut, held_out_gain
from fitting.residual.laws import Law
from fitting.residual.refinement import finer, refined
from fitting.residual.scoring import PARAMETER_PRICE, Candidates, Score, catalogue_terms, law_terms
from fitting.residual.terms import Model, Term

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
#: Standard errors by which the gain on held-out blocks has to be above zero; more where no validation motion is there.
LEAST_Z, LEAST_Z_ALONE = 1.5, 3.0
#: What is left of an effect's own gain on its own joint is the difference between its formula and nature's.
MISFIT_SHARE = 0.1
#: The same for a spline's limited resolution, in the signal that it is a law of.
LAW_MISFIT_SHARE = 0.25
#: The same on other joints, where only the coupling through the rigid body shows.
SPILL_SHARE = 0.01
#: A law that still gains this share of a named effect's gain on the same joint says that the name was wrong.
REFUTED_SHARE = 0.25


@dataclass(frozen=True)
class Accepted:
    """One effect or law that was added.

    Attributes
    ----------
    score : as it was chosen
    rivals : the other members of its set, at most two, best first
    held_out : its gain on held-out blocks of the fitted recordings
    validate_gain : chi-square that it takes off the whitened residual of `validate`; None without one
    """

    score: Score
    rivals: tuple[Score, ...]
    held_out: HeldOut
    validate_gain: float | None


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
    """Result of the loop: the base model, the final model, what was accepted, and all candidates."""

    base: Model
    model: Model
    accepted: tuple[Accepted, ...]
    candidates: tuple[Candidate, ...]
    limits: tuple[Score, ...]
    warnings: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """Verdict of the report."""
        if not self.accepted:
            return "nothing_missing"
        if any(isinstance(a.score.term.content, Law) for a in self.accepted):
            return "unexplained"
        return "ambiguous" if any(a.rivals for a in self.accepted) else "effect_added"


class Signals(Protocol):
    """What can correct the signals themselves, for effects that a column cannot correct when they are large."""

    @property
    def prior(self) -> Prior:
        """What is known before any measurement."""
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
    progress: Progress = lambda fraction, text: None,
) -> Attribution:
    """Run the loop on a fitted base model.

    Parameters
    ----------
    base : joint fit of the base model
    effects : the catalogue
    validate : segments of the `validate` recordings; nothing is selected on them, they only confirm or refuse
    signals : refits, with delays and the like corrected in the signals themselves
    progress : called with a fraction and plain words
    """
    selection = _Selection(base, effects, validate, signals)
    for number in range(MOST_EFFECTS + 3):
        progress(min(0.9, number / 4), f"looking for what is missing, round {number + 1}")
        if not selection.step():
            break
    selection.prune()
    return selection.result()


class _Selection:
    """State of the forward selection: the model so far, what was accepted or refused, and the table of candidates."""

    def __init__(self, base: Model, effects: Sequence[Effect], validate: Sequence[int], signals: Signals) -> None:
        self.base, self.effects, self.validate, self.signals = base, effects, validate, signals
        self.model = base
        self.accepted: list[Accepted] = []
        self.refused: set[Family] = set()
        self.refuted_joints: set[int | None] = set()
        self.table: dict[Family, Candidate] = {}
        self.limits: tuple[Score, ...] = ()
        self.scored: Model | None = None
        self.named: dict[Family, Score] = {}
        self.laws: dict[int | None, Score] = {}

    def step(self) -> bool:
        """One round: score everything, add, refuse or take back one thing. False when there is nothing left to do."""
        self._score()
        if not self.limits:
            self.limits = tuple(self.named.values())
        _record(self.table, self.named, self.accepted)
        choice = _choose(self._open_names(), self._open_laws(), self.accepted)
        if choice is None or len(self.accepted) >= MOST_EFFECTS:
            return False
        wrong = _refutes(choice, self.accepted) if isinstance(choice.term.content, Law) else None
        if wrong is not None:
            self._take_back(wrong)
        else:
            self._try(choice)
        return True

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

    def _open_names(self) -> list[Score]:
        return [
            score
            for score in self.named.values()
            if score.plausible
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

    def _take_back(self, number: int) -> None:
        """An accepted name was wrong: a law of one signal explains far more on its joint."""
        family = self.accepted.pop(number).score.term.family
        self.refuted_joints.add(family[1])
        self.table[family] = replace(
            self.table[family],
            status="rejected",
            reason="a law of one signal explains much more on this joint: it is not this effect",
        )
        self.model = self.signals.refit([item.score.term for item in self.accepted])

    def _try(self, choice: Score) -> None:
        """Add the choice if it helps on the validation motion."""
        choice = (refined if isinstance(choice.term.content, Effect) else finer)(self.model, choice)
        terms = [*(item.score.term for item in self.accepted), choice.term]
        trial = self.signals.rebuilt(self.signals.refit(terms))
        choice = replace(choice, term=trial.terms[-1])
        family = choice.term.family
        held_out = self._held_out(trial)
        gain = validate_gain(self.model, trial, self.validate) if self.validate else None
        reason = _objection(held_out, gain)
        if reason:
            self.refused.add(family)
            self.table[family] = Candidate(*family, choice.score, "rejected", reason)
            return
        rivals = () if isinstance(choice.term.content, Law) else _rivals(choice, self.named, self.refused)
        self.accepted.append(Accepted(choice, rivals, held_out, gain))
        self.table[family] = Candidate(*family, choice.score, "accepted", _why(choice))
        for rival in rivals:
            reason = f"within {choice.score - rival.score:.1f} of {choice.term.id}: this data cannot tell them apart"
            self.table[rival.term.family] = Candidate(*rival.term.family, rival.score, "indistinguishable", reason)
        self.model = trial

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
        return Attribution(self.base, self.model, tuple(self.accepted), ordered, self.limits, tuple(warnings))


def _objection(held_out: HeldOut, validate: float | None) -> str:
    """Why a term is not to be added; empty if there is nothing against it."""
    if held_out.gain <= 0 or held_out.z < (LEAST_Z if validate is not None else LEAST_Z_ALONE):
        return (
            f"it does not hold on blocks that were left out of the fit (chi-square {held_out.gain:+.1f}, "
            f"{held_out.z:.1f} standard errors)"
        )
    if validate is not None and validate <= 0:
        return f"it does not help on the validation motion (chi-square {validate:+.1f})"
    return ""


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
    names = [s for s in names if s.score > ACCUSE and not _is_misfit(s, accepted)]
    laws = [s for s in laws if s.score > ACCUSE and (not _is_misfit(s, accepted) or _refutes(s, accepted) is not None)]
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
        named_here = isinstance(term.content, Effect) and term.joint == score.term.joint
        if named_here and score.gain > REFUTED_SHARE * item.score.gain:
            return number
    return None


def _rivals(choice: Score, named: dict[Family, Score], refused: set[Family]) -> tuple[Score, ...]:
    width = max(SET_WIDTH, SET_SHARE * choice.gain)
    near = [
        s
        for s in named.values()
        if s.plausible
        and s.term.family != choice.term.family
        and s.term.family not in refused
        and choice.score - s.score < width
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
