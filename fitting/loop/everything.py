"""What was found on pieces of long recordings, held against everything.

The loop names effects on pieces (:attr:`fitting.loop.session.Session.search`). Here they are fitted jointly with the
base on all samples, streamed, with their shapes searched there once more (:mod:`fitting.loop.sharper`). Each has to
stand there too: it has to gain on all fitted rows what is said of so many parameters, and no joint may get worse on all
of `validate`. What does not stand is dropped, one at a time, the weakest first. Sets become smaller: all samples may
tell rivals apart that the pieces could not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fitting.effects.base import Effect
from fitting.loop.residual_loop import SessionSignals
from fitting.loop.session import Search, Session
from fitting.loop.sharper import sharpened
from fitting.residual.confirmation.confirmation import validate_gain, worse_joint
from fitting.residual.findings import Accepted, Attribution, Candidate, Family
from fitting.residual.refinement import refined
from fitting.residual.scoring import Score
from fitting.residual.terms import Model, Term
from fitting.selection import priors
from fitting.selection.evidence import least_gain
from fitting.signals.corrections import Corrections

Progress = Callable[[float, str], None]


def on_the_whole(term: Term, search: Search) -> Term:
    """A term of the search with recordings numbered as in the whole."""
    recording = term.shape.get("recording", -1.0)
    if recording < 0:
        return term
    return replace(term, shape={**term.shape, "recording": float(search.numbers[int(recording)])})


def held_against_everything(
    session: Session,
    corrections: Corrections,
    search: Search,
    found: Attribution,
    progress: Progress = lambda fraction, text: None,
) -> Attribution:
    """The attribution with what everything says of each accepted term.

    Parameters
    ----------
    session : of all recordings
    corrections : what kinematics found
    search : where it was found
    found : result of the search; its models and detection limits stay those of the pieces

    Returns
    -------
    Attribution
        Accepted terms that stand on everything, with the gain on all of `validate`; candidates and changes with
        recordings numbered as in the whole.
    """
    accepted = [
        replace(item, score=replace(item.score, term=on_the_whole(item.score.term, search))) for item in found.accepted
    ]
    table = list(found.candidates)
    signals = SessionSignals(session, corrections)
    validate = signals.prepared(()).validate
    base = signals.refit([])
    if accepted:
        progress(0.85, "searching shapes on all samples")
        first = signals.refit([item.score.term for item in accepted])
        terms = sharpened(first, session.prior, search.gap)
        accepted = [
            replace(item, score=replace(item.score, term=term)) for item, term in zip(accepted, terms, strict=True)
        ]
    dropped = set[Family]()
    while accepted:
        progress(0.86, "refitting what was found on all samples")
        model = signals.refit([item.score.term for item in accepted])
        refused = _refused(base, model, accepted, validate)
        if refused is None:
            accepted, apart = _with_rivals(signals, search, corrections, model, accepted)
            for place, line in enumerate(table):
                status, reason = apart.get((line.id, line.joint), (line.status, line.reason))
                table[place] = replace(line, status=status, reason=reason)
            if tuple(item.score.term for item in accepted) != model.terms:
                model = signals.refit([item.score.term for item in accepted])
            accepted = _with_gains(signals, model, accepted, validate)
            break
        number, reason = refused
        family = accepted.pop(number).score.term.family
        dropped.add(family)
        table = [
            Candidate(c.id, c.joint, c.score, "rejected", reason) if (c.id, c.joint) == family else c for c in table
        ]
    changes = tuple(
        c if c.recording is None else replace(c, recording=search.numbers[c.recording]) for c in found.changes
    )
    return replace(found.refusing(dropped), accepted=tuple(accepted), candidates=tuple(table), changes=changes)


def _refused(
    base: Model, model: Model, accepted: Sequence[Accepted], validate: Sequence[int]
) -> tuple[int, str] | None:
    """Number of the term to drop, and why; None where all stand."""
    worths = [worth(model, number) for number in range(len(accepted))]
    weakest = int(np.argmin(worths))
    if worths[weakest] < 0:
        return weakest, f"found on pieces, but gains only {model.wald(weakest):.1f} of chi-square on all samples"
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
        f"it makes {name} worse on the whole of the validation motion (error {100 * rise:+.1f} %)",
    )


def worth(model: Model, number: int) -> float:
    """Chi-square that dropping a term would cost (Wald's), beyond the least that is said of so many parameters."""
    count = _count(model, number)
    return model.wald(number) - least_gain(count) if count else -np.inf


def _with_rivals(
    signals: SessionSignals, search: Search, corrections: Corrections, model: Model, accepted: Sequence[Accepted]
) -> tuple[list[Accepted], dict[Family, tuple[str, str]]]:
    """Accepted terms with the rivals that all samples leave them, and status and reason of those that changed.

    A rival takes the term's place in the joint fit, with its shape refined on the pieces as the term's was. It stays in
    the set where the two differ by less than a set is wide; where it is better by more, it is the term. The width is
    that of the search, with the doubt of a bias in proportion to the gain.
    """
    result, apart = list(accepted), dict[Family, tuple[str, str]]()
    pieces = SessionSignals(search.session, corrections)
    for number, item in enumerate(accepted):
        if not item.rivals or any(term.rebuilt for term in model.terms):
            continue
        others = [other.score.term for n, other in enumerate(result) if n != number]
        # The search's own numbers of recordings: shapes are refined there.
        beside = pieces.refit([on_the_pieces(term, search) for term in others])
        best, best_chi, best_item = item.score.term, _priced(model), item
        gain = model.wald(number)
        width = max(priors.CLOSE, priors.EPSILONS[1] ** 2 * gain) + _doubt(item.score, gain)
        values = {item.score.term.family: best_chi}
        terms = {item.score.term.family: item.score}
        for rival in item.rivals:
            score = refined(beside, rival) if isinstance(rival.term.content, Effect) else rival
            score = replace(score, term=on_the_whole(score.term, search))
            trial = signals.refit([*others[:number], score.term, *others[number:]])
            values[score.term.family], terms[score.term.family] = _priced(trial), score
        family = min(values, key=lambda own: values[own])
        if values[family] < best_chi - width:
            best, best_chi = terms[family].term, values[family]
            best_item = replace(item, score=terms[family])
            apart[family] = "accepted", "the best of its set on all samples"
        near = [own for own in values if own != best.family and values[own] - best_chi < width]
        for own in values:
            if own != best.family and own not in near:
                reason = f"fits all samples worse than {best.id}: chi-square higher by {values[own] - best_chi:.1f}"
                apart[own] = "rejected", reason
        result[number] = replace(best_item, rivals=tuple(terms[own] for own in near))
    return result, apart


def on_the_pieces(term: Term, search: Search) -> Term:
    """Inverse of :func:`on_the_whole`."""
    recording = term.shape.get("recording", -1.0)
    if recording < 0:
        return term
    return replace(term, shape={**term.shape, "recording": float(search.numbers.index(int(recording)))})


def _priced(model: Model) -> float:
    """Chi-square of a model and the least that is said of each of its terms."""
    counts = [_count(model, n) for n in range(len(model.terms))]
    return model.fit.chi_square + sum(least_gain(count) for count in counts if count)


def _count(model: Model, number: int) -> int:
    return int(np.count_nonzero(model.fit.told[model.term_slice(number)]))


def _doubt(score: Score, gain: float) -> float:
    """Doubt of a term's gain from the bias that noisy regressors have, grown as the gain has."""
    if score.null is None or score.gain <= 0:
        return 0.0
    return score.null.doubt(score.information, score.gain) * gain / score.gain


def _with_gains(
    signals: SessionSignals, model: Model, accepted: Sequence[Accepted], validate: Sequence[int]
) -> list[Accepted]:
    """Accepted terms with what each takes off the chi-square of all of `validate` beside the others."""
    result = []
    for number, item in enumerate(accepted):
        gain = None
        if validate:
            others = [other.score.term for n, other in enumerate(accepted) if n != number]
            gain = validate_gain(signals.refit(others), model, validate)
        result.append(replace(item, validate_gain=gain))
    return result


def said(search: Search) -> str:
    """One sentence on where was searched."""
    return (
        f"effects were searched for on {search.pieces} pieces of {_minutes(search.seconds)} in all, of "
        f"{_minutes(search.of_seconds)} recorded; what was found was fitted to, and its errors are of, everything; "
        "detection limits and changes in time are those of the pieces"
    )


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.1f} minutes" if seconds < 36_000 else f"{seconds / 3600:.1f} hours"
