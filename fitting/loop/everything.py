"""What was found, confirmed once more: on all samples of long recordings, and in efforts of equal weight.

*All samples.* The loop names effects on pieces (:attr:`fitting.loop.session.Session.search`). Here they are fitted
jointly with the base on all samples, streamed, with their shapes searched there once more (:func:`with_best_shapes`).
Each has to hold there too: it has to gain on all fitted rows what so many parameters have to, and no joint may get
worse on all of `validate`. What does not hold is dropped, one at a time, the weakest first. Sets become smaller: all
samples may separate rivals that the pieces could not.

*Efforts.* Where the model explains the recordings down to their noise, the confirmation on whitened rows is enough.
Where it does not (:mod:`fitting.loop.weighting`), whitened rows all but ignore slow errors, and what lowers them on the
validation motion may raise the error of the effort there. So each finding is added again, in the order in which it was
found, to least squares of joint efforts, and is kept if the error of the efforts on ``validate`` falls: its
block-bootstrap interval excludes zero, and no joint gets worse by more than
:data:`~fitting.residual.confirmation.confirmation.MOST_WORSE` and its interval.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.loop.refits import SessionSignals
from fitting.loop.session import Search, Session
from fitting.loop.weighting import weighed
from fitting.progress import Progress, quiet
from fitting.regression.design import effort_errors
from fitting.regression.prior import Prior, with_prior
from fitting.regression.streamed import folded
from fitting.residual.confirmation.confirmation import MOST_WORSE, error_change, validate_gain, worse_joint
from fitting.residual.findings import Accepted, Attribution, Family
from fitting.residual.refinement import refined
from fitting.residual.scoring import Score
from fitting.residual.terms import Model, Term, extra_columns, late_terms
from fitting.selection import priors
from fitting.selection.evidence import least_gain
from fitting.signals.corrections import Corrections

#: Shapes that are moments, s: searched by steps, not by factors.
_MOMENTS = frozenset({"t_0"})
#: Where the search of a moment ends, s, and how many values are tried at once.
_FINEST_MOMENT, _VALUES = 2.0, 17
#: Half widths of the rounds in which other shapes are searched, relative: they were refined on the pieces.
_SPANS = (0.08, 0.02)


def renumbered(term: Term, numbers: Mapping[int, int]) -> Term:
    """Renumber the recording of a term between the search and the whole."""
    recording = term.shape.get("recording", -1.0)
    return term if recording < 0 else replace(term, shape={**term.shape, "recording": float(numbers[int(recording)])})


def held_against_everything(
    session: Session,
    corrections: Corrections,
    search: Search,
    found: Attribution,
    progress: Progress = quiet,
) -> Attribution:
    """Check each accepted term that was found in a search against all samples of the whole session.

    Returns
    -------
    Attribution
        Accepted terms that hold on everything, with the gain on all of `validate`; candidates and changes with
        recordings numbered as in the whole. Models and detection limits remain those of the pieces.
    """
    whole = dict(enumerate(search.numbers))
    accepted = [_of(item, renumbered(item.score.term, whole)) for item in found.accepted]
    signals = SessionSignals(session, corrections)
    validate = signals.prepared(()).validate
    base = signals.refit([])
    if accepted:
        progress(0.85, Sentence("fitting.searching_shapes_all_samples"))
        first = signals.refit([item.score.term for item in accepted])
        terms = with_best_shapes(first, session.prior, search.gap)
        accepted = [_of(item, term) for item, term in zip(accepted, terms, strict=True)]
    reasons, apart = dict[Family, str](), dict[Family, tuple[str, str]]()
    while accepted:
        progress(0.86, Sentence("fitting.refitting_found_all_samples"))
        model = signals.refit([item.score.term for item in accepted])
        refused = _refused(base, model, accepted, validate)
        if refused is None:
            accepted, apart = _with_rivals(signals, search, corrections, model, accepted)
            if tuple(item.score.term for item in accepted) != model.terms:
                model = signals.refit([item.score.term for item in accepted])
            accepted = _with_gains(signals, model, accepted, validate)
            break
        number, reason = refused
        reasons[accepted.pop(number).score.term.family] = reason
    changes = tuple(c if c.recording is None else replace(c, recording=whole[c.recording]) for c in found.changes)
    found = found.refusing(reasons).narrowed({f: r for f, (status, r) in apart.items() if status == "rejected"})
    return replace(found.with_status(apart), accepted=tuple(accepted), changes=changes)


def _of(item: Accepted, term: Term) -> Accepted:
    """Return the same finding with another shape or recording number."""
    return replace(item, score=replace(item.score, term=term))


def _refused(
    base: Model, model: Model, accepted: Sequence[Accepted], validate: Sequence[int]
) -> tuple[int, str] | None:
    """Return the number of the term to drop, and why; None where all hold."""
    worths = [_worth(model, number) for number in range(len(accepted))]
    weakest = int(np.argmin(worths))
    if worths[weakest] < 0:
        return weakest, Sentence("fitting.found_pieces_but_gains", gain=model.wald(weakest))
    if not validate:
        return None
    worse = worse_joint(base, model, validate)
    if worse is None:
        return None
    joint, rise = worse
    there = [n for n, item in enumerate(accepted) if item.score.term.joint in (joint, None)] or range(len(accepted))
    name = model.design.parameters.joints[joint]
    return (
        min(there, key=lambda n: worths[n]),
        Sentence("fitting.makes_worse_whole_validation", joint=name, change=100 * rise),
    )


def _worth(model: Model, number: int) -> float:
    """Compute the chi-square cost of dropping a term (Wald's), beyond the least to report so many parameters."""
    count = _count(model, number)
    return model.wald(number) - least_gain(count) if count else -np.inf


def _with_rivals(
    signals: SessionSignals, search: Search, corrections: Corrections, model: Model, accepted: Sequence[Accepted]
) -> tuple[list[Accepted], dict[Family, tuple[str, str]]]:
    """Return accepted terms with their rivals by all samples, and status and reason of the changed ones.

    A rival takes the term's place in the joint fit, with its shape refined on the pieces as the term's was. It is kept
    in the set where the two differ by less than a set is wide; where it is better by more, it is the term. The width is
    that of the search, with the uncertainty of a bias in proportion to the gain.
    """
    result, apart = list(accepted), dict[Family, tuple[str, str]]()
    pieces, whole = SessionSignals(search.session, corrections), dict(enumerate(search.numbers))
    for number, item in enumerate(accepted):
        if not item.rivals or any(term.rebuilt for term in model.terms):
            continue
        others = [other.score.term for n, other in enumerate(result) if n != number]
        # The search's own numbers of recordings: shapes are refined there.
        beside = pieces.refit([renumbered(term, {n: k for k, n in whole.items()}) for term in others])
        gain, scores, values = model.wald(number), [item.score], [_priced(model)]
        for rival in item.rivals:
            score = refined(beside, rival) if isinstance(rival.term.content, Effect) else rival
            scores.append(replace(score, term=renumbered(score.term, whole)))
            values.append(_priced(signals.refit([*others[:number], scores[-1].term, *others[number:]])))
        width = max(priors.CLOSE, priors.EPSILONS[1] ** 2 * gain) + _gain_uncertainty(item.score, gain)
        best = int(np.argmin(values))
        if values[best] < values[0] - width:
            apart[scores[best].term.family] = "accepted", Sentence("fitting.best_set_all_samples")
        else:
            best = 0
        near, chances = list[int](), [item.probability, *item.rival_probabilities]
        for n, (score, value) in enumerate(zip(scores, values, strict=True)):
            if n != best and value - values[best] < width:
                near.append(n)
            elif n != best:
                excess = value - values[best]
                reason = Sentence("fitting.fits_all_samples_worse", best=scores[best].term.id, excess=excess)
                apart[score.term.family] = "rejected", reason
        left = 1.0 - sum(p for n, p in enumerate(chances) if n not in (best, *near))
        rivals, odds = tuple(scores[n] for n in near), tuple(chances[n] / left for n in near)
        result[number] = replace(
            item, score=scores[best], rivals=rivals, probability=chances[best] / left, rival_probabilities=odds
        )
    return result, apart


def _priced(model: Model) -> float:
    """Compute the chi-square of a model and the least to report each of its terms."""
    counts = [_count(model, n) for n in range(len(model.terms))]
    return model.fit.chi_square + sum(least_gain(count) for count in counts if count)


def _count(model: Model, number: int) -> int:
    return int(np.count_nonzero(model.fit.determined[model.term_slice(number)]))


def _gain_uncertainty(score: Score, gain: float) -> float:
    """Compute the uncertainty of a term's gain by the bias of noisy regressors, grown as the gain has."""
    if score.null is None or score.gain <= 0:
        return 0.0
    return score.null.uncertainty(score.information, score.gain) * gain / score.gain


def _with_gains(
    signals: SessionSignals, model: Model, accepted: Sequence[Accepted], validate: Sequence[int]
) -> list[Accepted]:
    """Return accepted terms with what each takes off the chi-square of all of `validate`."""
    if not validate:
        return [replace(item, validate_gain=None) for item in accepted]
    terms = [item.score.term for item in accepted]
    models = (signals.refit([*terms[:number], *terms[number + 1 :]]) for number in range(len(terms)))
    pairs = zip(accepted, models, strict=True)
    return [replace(item, validate_gain=validate_gain(own, model, validate)) for item, own in pairs]


def with_best_shapes(model: Model, prior: Prior, reach: float) -> tuple[Term, ...]:
    """Return the model's terms with their shapes at the best nearby value on all fitted rows.

    A moment is known from pieces to the next piece only, and any shape better from hours than from minutes.

    Parameters
    ----------
    model : fitted to a long design (:attr:`fitting.regression.design.Design.stored`)
    reach : s by which a moment may be off: the longest time between two pieces
    """
    terms = list(model.terms)
    for number, term in enumerate(terms):
        if not isinstance(term.content, Effect) or term.rebuilt:
            continue
        for key in (key for key in term.shape if key not in term.discrete):
            for steps in _rounds(key, reach):
                present = terms[number].shape[key]
                values = sorted({present, *(present + (steps if key in _MOMENTS else present * steps)).tolist()})
                candidates = [
                    replace(terms[number], shape={**terms[number].shape, key: value})
                    for value in values
                    if value >= 0 or key not in _MOMENTS
                ]
                others = [own for n, own in enumerate(terms) if n != number]
                found = _chi_squares(model, prior, others, candidates)
                terms[number] = candidates[int(np.argmin(found))]
    return tuple(terms)


def _chi_squares(model: Model, prior: Prior, others: Sequence[Term], candidates: Sequence[Term]) -> list[float]:
    """Compute the chi-square of a joint fit of base, ``others`` and each of the candidates.

    Candidates are put beside each other behind the base and the other terms, all rows folded into one triangle
    (:mod:`fitting.regression.streamed`), and each one's chi-square is read off its columns there: one walk through the
    data for as many values as wanted. Columns hold the present model's force; every candidate has as many.
    """
    design = model.design
    extra = extra_columns(design, model.views, [*others, *candidates])
    late = late_terms(others, design.parameters)
    R = folded(design, model.noise, model.fitted, extra, lambda rows: with_prior(rows, design.parameters, prior, late))
    width = candidates[0].width
    fixed = R.shape[1] - 1 - width * len(candidates)
    result = []
    for number in range(len(candidates)):
        own = fixed + width * number + np.arange(width)
        A = R[:, np.concatenate([np.arange(fixed), own])]
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        solution = np.linalg.lstsq(A / scale, R[:, -1], rcond=1e-9)[0]
        result.append(float(np.sum((R[:, -1] - (A / scale) @ solution) ** 2)))
    return result


def _rounds(key: str, reach: float) -> Iterator[FloatArray]:
    """Yield steps around the present value by round: of a moment in s, else relative."""
    for span in () if key in _MOMENTS else _SPANS:
        yield span * np.array([-1.0, -0.5, 0.5, 1.0])
    while key in _MOMENTS and reach > _FINEST_MOMENT:
        yield np.linspace(-reach, reach, _VALUES)
        reach *= 2.0 / (_VALUES - 1)


def confirmed_in_effort(session: Session, corrections: Corrections, found: Attribution) -> Attribution:
    """Return the findings confirmed where the final fit has equal weights; all where it is whitened."""
    signals = SessionSignals(session, corrections)
    validate = session.plain.validate
    items = [item for item in found.accepted if not item.score.term.confined]
    if not items or not validate:
        return found
    if weighed(signals.refit([item.score.term for item in found.accepted]), session.prior).weights == "whitened":
        return found
    kept: list[Accepted] = [item for item in found.accepted if item.score.term.confined]
    reasons = dict[Family, str]()

    def errors() -> tuple[FloatArray, ...]:
        model = weighed(signals.refit([k.score.term for k in kept]), session.prior).model
        return effort_errors(model.design, model.fit.theta, validate, model.extra)

    before = errors()
    for item in items:
        kept.append(item)
        after = errors()
        refused = _effort_refused(session, before, after)
        if refused is None:
            before = after
            continue
        reasons[kept.pop().score.term.family] = refused
    if not reasons:
        return found
    model = signals.refit([item.score.term for item in kept])
    # Warnings on joints whose findings are gone go with them.
    places = {item.score.term.joint for item in kept}
    names = [session.machine.joints[joint].name for joint in places if joint is not None]
    warnings = tuple(w for w in found.warnings if w.partition(":")[0] in names)
    left = replace(found.refusing(reasons), accepted=tuple(kept), model=model, warnings=warnings)
    return left.with_status(_demoted(left, found))


def _effort_refused(session: Session, before: Sequence[FloatArray], after: Sequence[FloatArray]) -> str | None:
    """Return why the validation efforts do not confirm a finding; None where they do."""
    rate = session.bank.reduced_rate_hz
    change, _, high = error_change(before, after, rate, np.random.default_rng(22))
    if not high < 0:
        return Sentence("fitting.validation_effort_not_better", change=change)
    for joint, (first, second) in enumerate(zip(before, after, strict=True)):
        if len(first) and len(first) == len(second):
            own, low, _ = error_change([first], [second], rate, np.random.default_rng(23))
            if own > 100 * MOST_WORSE and low > 0:
                name = session.machine.joints[joint].name
                return Sentence("fitting.validation_effort_worse", joint=name, change=own)
    return None


def _demoted(left: Attribution, found: Attribution) -> dict[Family, tuple[str, str]]:
    """Return status and reason of rivals of rejected findings: they are now distinguishable."""
    there = {rival.term.family for item in left.accepted for rival in item.rivals}
    fallen = {rival.term.family for item in found.accepted for rival in item.rivals} - there
    reason = Sentence("fitting.could_not_told_apart")
    return {
        (c.id, c.joint): ("rejected", reason)
        for c in left.candidates
        if (c.id, c.joint) in fallen and c.status == "indistinguishable"
    }


def search_note(search: Search) -> str:
    """Word in one sentence where effects were searched for."""
    times = {"seconds": _duration(search.seconds), "of_seconds": _duration(search.of_seconds)}
    return Sentence("fitting.effects_searched_pieces_all", pieces=search.pieces, **times)


def _duration(seconds: float) -> str:
    if seconds < 36_000:
        return Sentence("fitting.in_minutes", minutes=seconds / 60)
    return Sentence("fitting.in_hours", hours=seconds / 3600)
