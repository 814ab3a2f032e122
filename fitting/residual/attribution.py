"""From residual to named effect: forward selection with a joint refit, one at a time, each confirmed on `validate`.

Decisions and where their numbers come from (``docs/decisions/0003-attribution.md``):

accuse
    A candidate has to gain :data:`ACCUSE` beyond the price of its parameters. One parameter then needs a chi-square of 20
    (p = 8e-6), which pays for some hundred independent looks per joint at one per cent.
name or law
    A named effect that leaves a spline of one signal clearly better off is not the explanation; the law is said instead.
set
    Two candidates with one parameter differ by ``lambda^2 (1 - rho^2)`` on average, with twice its root as
    standard deviation; a rival within :data:`SET_WIDTH` could be the truth with a chance of more than half a per cent.
confirm
    What does not lower the whitened error of `validate` is refused, whatever it gained in training.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fitting.effects.base import Effect
from fitting.prior import Prior
from fitting.regression import full_residual
from fitting.residual.laws import Law
from fitting.residual.scoring import ColumnCache, Score, catalogue_terms, law_terms, score_terms
from fitting.residual.terms import Model, Term, fit_model

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[float, str], None]

ACCUSE = 14.0
SET_WIDTH = 7.0
SET_SHARE = 0.02
LAW_WINS = 6.0
LAW_WINS_SHARE = 0.05
MOST_EFFECTS = 4
MOST_RIVALS = 2
#: What is left of an effect's own gain on its own joint is the difference between its formula and nature's.
MISFIT_SHARE = 0.05
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
    validate_gain : chi-square that it takes off the whitened residual of `validate`; None without one
    """

    score: Score
    rivals: tuple[Score, ...]
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


def attribute(
    base: Model,
    effects: Sequence[Effect],
    validate: Sequence[int],
    prior: Prior,
    rebuild: Callable[[Model, Term], Model] | None = None,
    progress: Progress = lambda fraction, text: None,
) -> Attribution:
    """Run the loop on a fitted base model.

    Parameters
    ----------
    base : joint fit of the base model
    effects : the catalogue
    validate : segments of the `validate` recordings; nothing is selected on them, they only confirm or refuse
    prior : prior of the fits
    rebuild : turns a model and a term into a model whose *signals* were corrected (for effects like latency that a
        column cannot correct when they are large); None if the term is no such effect
    progress : called with a fraction and plain words
    """
    joints = base.design.parameters.joints
    model, accepted = base, []
    refused: set[tuple[str, int | None]] = set()
    table: dict[tuple[str, int | None], Candidate] = {}
    warnings: list[str] = []
    limits: list[Score] = []
    names_refuted: set[int | None] = set()
    cache: ColumnCache = {}
    joints_open: list[int] | None = None
    for step in range(MOST_EFFECTS + 3):
        progress(min(0.9, step / 4), f"looking for what is missing, round {step + 1}")
        named = best_by_family(score_terms(model, *catalogue_terms(model, effects, joints_open), cache))
        best_laws = best_by_joint(score_terms(model, *law_terms(model, joints_open), cache))
        if step == 0:
            limits = list(named.values())
        _record(table, named, accepted)
        open_names = [
            s
            for s in named.values()
            if s.plausible
            and s.term.family not in refused
            and s.term.joint not in names_refuted
            and not _there(accepted, s)
        ]
        open_laws = [s for s in best_laws.values() if s.term.family not in refused and not _law_there(accepted, s)]
        choice = _choose(open_names, open_laws, accepted)
        if choice is None or len(accepted) >= MOST_EFFECTS:
            break
        if isinstance(choice.term.content, Law):
            wrong = _refutes(choice, accepted)
            if wrong is not None:
                name = accepted.pop(wrong).score.term
                names_refuted.add(name.joint)
                table[name.family] = replace(
                    table[name.family],
                    status="rejected",
                    reason="a law of one signal explains much more on this joint: it is not this effect",
                )
                model = fit_model(base.design, base.noise, base.fitted, [a.score.term for a in accepted], prior, base)
                continue
        else:
            choice = _refined(model, choice)
        trial = fit_model(
            model.design, model.noise, model.fitted, [*(a.score.term for a in accepted), choice.term], prior, model
        )
        if rebuild is not None:
            trial = rebuild(trial, choice.term)
            choice = replace(choice, term=trial.terms[-1])
            if trial.design is not model.design:
                cache.clear()
        gain = validate_gain(model, trial, validate) if validate else None
        if gain is not None and gain <= 0:
            refused.add(choice.term.family)
            table[choice.term.family] = Candidate(
                choice.term.id,
                choice.term.joint,
                choice.score,
                "rejected",
                f"it does not help on the validation motion (chi-square {gain:+.1f})",
            )
            continue
        rivals = () if isinstance(choice.term.content, Law) else _rivals(choice, named, refused)
        accepted.append(Accepted(choice, rivals, gain))
        table[choice.term.family] = Candidate(choice.term.id, choice.term.joint, choice.score, "accepted", _why(choice))
        for rival in rivals:
            table[rival.term.family] = Candidate(
                rival.term.id,
                rival.term.joint,
                rival.score,
                "indistinguishable",
                f"within {choice.score - rival.score:.1f} of {choice.term.id}: this data cannot tell them apart",
            )
        model = trial
    model, accepted = _pruned(model, accepted, prior, table)
    left = (
        [s for s in best_by_joint(score_terms(model, *law_terms(model))).values() if s.score > ACCUSE]
        if accepted
        else []
    )
    for score in left:
        where = joints[score.term.joint or 0]
        law = score.term.content
        assert isinstance(law, Law)
        warnings.append(
            f"{where}: a small structure in {law.variable(joints)} is left (chi-square {score.gain:.0f}); "
            "the added effect's formula is not exactly nature's"
        )
    ordered = tuple(sorted(table.values(), key=lambda c: -c.score))
    return Attribution(base, model, tuple(accepted), ordered, tuple(limits), tuple(warnings))


def best_by_family(scores: Sequence[Score]) -> dict[tuple[str, int | None], Score]:
    """Best shape of each effect on each joint; plausible ones come before implausible ones."""
    best: dict[tuple[str, int | None], Score] = {}
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


def validate_gain(before: Model, after: Model, validate: Sequence[int]) -> float:
    """Chi-square by which the whitened residual of the validation segments falls from one model to another."""
    return _validate_chi_square(before, validate) - _validate_chi_square(after, validate)


def _validate_chi_square(model: Model, validate: Sequence[int]) -> float:
    total = 0.0
    for joint in range(len(model.design.machine.joints)):
        for index in validate:
            block = model.design.blocks[joint][index]
            residual = model.design.bank.reduce(full_residual(model.design, model.fit.theta, joint, index, model.extra))
            white = model.noise.whiten(joint, residual)[model.noise.kept(joint, block.keep)]
            total += float(white @ white)
    return total


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
            share = LAW_MISFIT_SHARE
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
        if isinstance(term.content, Effect) and term.joint == score.term.joint:
            if score.gain > REFUTED_SHARE * item.score.gain:
                return number
    return None


def _rivals(
    choice: Score, named: dict[tuple[str, int | None], Score], refused: set[tuple[str, int | None]]
) -> tuple[Score, ...]:
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
        if isinstance(present, Law) and isinstance(law, Law) and item.score.term.joint == score.term.joint:
            if (present.signal, present.other, present.signed) == (law.signal, law.other, law.signed):
                return True
    return False


def _record(
    table: dict[tuple[str, int | None], Candidate],
    named: dict[tuple[str, int | None], Score],
    accepted: Sequence[Accepted],
) -> None:
    """Note what each family could do in this round, unless it already has its say."""
    for family, score in named.items():
        if family in table and table[family].status != "rejected" or family in {a.score.term.family for a in accepted}:
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


def _refined(model: Model, score: Score) -> Score:
    """The score at the best shape between the grid's neighbours (golden section in each continuous shape parameter)."""
    best = score
    for key in score.term.shape:
        if key in ("other", "side", "n", "odd", "law", "delta", "recording", "parameter", "chamber", "head", "rod"):
            continue
        span = 0.02 if key == "pitch" else 0.5
        for _ in range(3):
            centre = best.term.shape[key]
            trials = [
                replace(best.term, shape={**best.term.shape, key: centre * factor})
                for factor in (1 - span, 1 - span / 2, 1 + span / 2, 1 + span)
            ]
            scores = score_terms(model, trials, [1] * len(trials))
            better = max(scores, key=lambda s: s.gain, default=best)
            if better.plausible and better.gain > best.gain:
                best = replace(better, score=better.gain - (score.gain - score.score))
            span /= 2
    return best


def _pruned(
    model: Model, accepted: list[Accepted], prior: Prior, table: dict[tuple[str, int | None], Candidate]
) -> tuple[Model, list[Accepted]]:
    """Backward: drop what no longer earns its place beside the others."""
    while len(accepted) > 1:
        losses = []
        for number in range(len(accepted)):
            part = model.term_slice(number)
            told = model.fit.told[part]
            values = model.fit.theta[part][told]
            covariance = model.fit.covariance[part, part][np.ix_(told, told)]
            wald = float(values @ np.linalg.pinv(covariance) @ values) if told.any() else 0.0
            losses.append(wald - 6.0 * int(told.sum()))
        weakest = int(np.argmin(losses))
        if losses[weakest] >= ACCUSE / 2:
            break
        gone = accepted.pop(weakest).score.term
        table[gone.family] = replace(
            table[gone.family], status="rejected", reason="not needed any more beside the effects added later"
        )
        model = fit_model(model.design, model.noise, model.fitted, [a.score.term for a in accepted], prior, model)
    return model, accepted
