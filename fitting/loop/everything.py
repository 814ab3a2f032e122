"""What was found on pieces of long recordings, held against everything.

The loop names effects on pieces (:attr:`fitting.loop.session.Session.search`). Here they are fitted jointly with the
base on all samples, streamed, with their shapes searched there once more (:func:`with_best_shapes`). Each has to
stand there too: it has to gain on all fitted rows what is said of so many parameters, and no joint may get worse on all
of `validate`. What does not stand is dropped, one at a time, the weakest first. Sets become smaller: all samples may
tell rivals apart that the pieces could not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.loop.refits import SessionSignals
from fitting.loop.session import Search, Session
from fitting.regression.prior import Prior, with_prior
from fitting.regression.streamed import folded
from fitting.residual.confirmation.confirmation import validate_gain, worse_joint
from fitting.residual.findings import Accepted, Attribution, Family
from fitting.residual.refinement import refined
from fitting.residual.scoring import Score
from fitting.residual.terms import Model, Term, extra_columns, late_terms
from fitting.selection import priors
from fitting.selection.evidence import least_gain
from fitting.signals.corrections import Corrections

Progress = Callable[[float, str], None]

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
    progress: Progress = lambda fraction, text: None,
) -> Attribution:
    """Check each accepted term against all samples.

    Parameters
    ----------
    session : of all recordings
    corrections : what kinematics found
    search : where it was found
    found : result of the search; its models and detection limits remain those of the pieces

    Returns
    -------
    Attribution
        Accepted terms that hold on everything, with the gain on all of `validate`; candidates and changes with
        recordings numbered as in the whole.
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
    found = found.refusing(reasons).with_status(apart)
    return replace(found, accepted=tuple(accepted), changes=changes)


def _of(item: Accepted, term: Term) -> Accepted:
    """Return the same finding with another shape or recording number."""
    return replace(item, score=replace(item.score, term=term))


def _refused(
    base: Model, model: Model, accepted: Sequence[Accepted], validate: Sequence[int]
) -> tuple[int, str] | None:
    """Return the number of the term to drop, and why; None where all hold."""
    worths = [worth(model, number) for number in range(len(accepted))]
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


def worth(model: Model, number: int) -> float:
    """Compute the chi-square cost of dropping a term (Wald's), beyond the least to report so many parameters."""
    count = _count(model, number)
    return model.wald(number) - least_gain(count) if count else -np.inf


def _with_rivals(
    signals: SessionSignals, search: Search, corrections: Corrections, model: Model, accepted: Sequence[Accepted]
) -> tuple[list[Accepted], dict[Family, tuple[str, str]]]:
    """Return accepted terms with their rivals by all samples, and status and reason of the changed ones.

    A rival takes the term's place in the joint fit, with its shape refined on the pieces as the term's was. It stays in
    the set where the two differ by less than a set is wide; where it is better by more, it is the term. The width is
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
        best, best_chi, best_item = item.score.term, _priced(model), item
        gain = model.wald(number)
        width = max(priors.CLOSE, priors.EPSILONS[1] ** 2 * gain) + _gain_uncertainty(item.score, gain)
        values = {item.score.term.family: best_chi}
        terms = {item.score.term.family: item.score}
        for rival in item.rivals:
            score = refined(beside, rival) if isinstance(rival.term.content, Effect) else rival
            score = replace(score, term=renumbered(score.term, whole))
            trial = signals.refit([*others[:number], score.term, *others[number:]])
            values[score.term.family], terms[score.term.family] = _priced(trial), score
        family = min(values, key=lambda own: values[own])
        if values[family] < best_chi - width:
            best, best_chi = terms[family].term, values[family]
            best_item = replace(item, score=terms[family])
            apart[family] = "accepted", Sentence("fitting.best_set_all_samples")
        near = [own for own in values if own != best.family and values[own] - best_chi < width]
        for own in values:
            if own != best.family and own not in near:
                reason = Sentence("fitting.fits_all_samples_worse", best=best.id, excess=values[own] - best_chi)
                apart[own] = "rejected", reason
        result[number] = replace(best_item, rivals=tuple(terms[own] for own in near))
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
    result = []
    for number, item in enumerate(accepted):
        gain = None
        if validate:
            others = [other.score.term for n, other in enumerate(accepted) if n != number]
            gain = validate_gain(signals.refit(others), model, validate)
        result.append(replace(item, validate_gain=gain))
    return result


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
                found = chi_squares(model, prior, others, candidates)
                terms[number] = candidates[int(np.argmin(found))]
    return tuple(terms)


def chi_squares(model: Model, prior: Prior, others: Sequence[Term], candidates: Sequence[Term]) -> list[float]:
    """Compute the chi-square of a joint fit of base, ``others`` and each of the candidates.

    Candidates are put beside each other behind the base and the other terms, all rows folded into one triangle
    (:mod:`fitting.regression.streamed`), and each one's chi-square is read off its columns there: one walk through the
    data for as many values as wanted. Columns hold the present model's force; every candidate has as many.
    """
    design = model.design
    extra = extra_columns(design, model.views, [*others, *candidates])
    late = late_terms(others, design.parameters)
    R = folded(design, model.noise, model.fitted, extra, lambda rows: with_prior(rows, design.parameters, prior, late))
    width = len(candidates[0].names(design.parameters.joints))
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


def search_note(search: Search) -> str:
    """Word in one sentence where effects were searched for."""
    return Sentence(
        "fitting.effects_searched_pieces_all",
        pieces=search.pieces,
        seconds=_minutes(search.seconds),
        of_seconds=_minutes(search.of_seconds),
    )


def _minutes(seconds: float) -> str:
    return (
        Sentence("fitting.in_minutes", minutes=seconds / 60)
        if seconds < 36_000
        else Sentence("fitting.in_hours", hours=seconds / 3600)
    )
