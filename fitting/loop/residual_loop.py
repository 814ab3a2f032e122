"""The residual loop on one page: which effects are missing to the base model.

A candidate is an effect on a joint with a shape, or a law of one signal. For a set ``S`` of candidates beside the base,
with whitened rows, columns ``C``, residual ``e`` of the base and ``P`` the projector off the base::

    log odds(S) = sum over c in S of log prior(c)  +  h' (I + H)^-1 h / 2  -  log det(I + H) / 2,
    H = L' C' P C L,  h = L' C' P e,

``L`` the root of the prior of sizes, averaged over a grid of amplitudes (:mod:`fitting.selection.evidence`,
:mod:`fitting.selection.priors`). In order:

1. *Base.* Spectral lines inside the band are in the model from the start (:func:`_ripples`).
2. *Neighbours* (:meth:`fitting.selection.search.Search.run`). One more: ``step`` adds the most probable candidate, at
   its best shape, until nothing more has the odds of :data:`fitting.selection.priors.CREDIBLE`. One less, or one
   exchanged: ``exchange`` holds each term against all others in its place, beside the rest. Both again until nothing
   changes.
3. *Three questions* to each that is added (:meth:`fitting.selection.confirm.Gate.asked`): whether rows that were left
   out of the fit are more probable with it; whether `validate` and the unloaded recordings are; whether it is
   physical, and no joint gets worse. A refusal removes the candidate and is in the table.
4. *Other cut-offs* of the filter may refuse a name (:func:`_screened`).
5. *All samples*, where pieces of long recordings were searched, and *efforts*, where the final fit has equal weights,
   may refuse once more (:mod:`fitting.loop.everything`).
6. *Answer.* What may be in each place, with probabilities (``Search.result``): explanations and the verdict are read
   from that alone (:class:`fitting.residual.findings.Attribution`).

The same at length is in ``docs/explanation/evidence.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from daq.messages import Sentence
from fitting.effects import line_effect
from fitting.effects.base import Effect
from fitting.loop.everything import confirmed_in_effort, held_against_everything
from fitting.loop.refits import SessionSignals
from fitting.loop.session import Session
from fitting.loop.weighting import weighed
from fitting.progress import Progress, quiet
from fitting.residual.change_points import changes
from fitting.residual.confirmation.confirmation import validate_gain
from fitting.residual.confirmation.cross_validation import held_out_gain
from fitting.residual.confirmation.uncertainty import with_uncertainties
from fitting.residual.findings import Accepted, Attribution, Family
from fitting.residual.levelling import residual_parts
from fitting.residual.lines import Line, is_ripple, machine_lines
from fitting.residual.scoring import score_terms
from fitting.residual.terms import Model, Term
from fitting.selection.decision import nothing_more
from fitting.selection.gains import margin
from fitting.selection.rating import Ratings
from fitting.selection.search import Search
from fitting.selection.trust import Draws
from fitting.signals.corrections import Corrections
from fitting.signals.preparation import stretches

#: Factors of the filter's cut-off at which a named effect has to hold as well, and how far it may move.
SCREEN = (0.7, 1.3)
SCREEN_RATIO, SCREEN_Z = 3.0, 4.0


def attributed(session: Session, corrections: Corrections, progress: Progress = quiet) -> Attribution:
    """Attribute a session's residual to its causes; effects are searched for on its pieces (:attr:`Session.search`)."""
    search = session.search
    found = run_attribution(search.session, corrections, progress)
    if not search.whole:
        found = held_against_everything(session, corrections, search, found, progress)
    found = confirmed_in_effort(session, corrections, found)
    names = [joint.name for joint in session.machine.joints]
    silent = [
        Sentence(
            "fitting.record_one_that_shows",
            place="machine" if item.score.term.joint is None else names[item.score.term.joint],
            effect=item.score.term.id,
            silence=item.silence,
        )
        for item in found.accepted
        if item.silence
    ]
    return replace(found, warnings=(*found.warnings, *silent))


def run_attribution(session: Session, corrections: Corrections, progress: Progress = quiet) -> Attribution:
    """Search on signals with rebuilt kinematic corrections, and compare the result at other cut-offs of the filter."""
    signals = SessionSignals(session, corrections)
    lines, ripples = _ripples(signals)
    base = signals.refit([item.score.term for item in ripples])
    validate = signals.prepared(()).validate
    found = Search(base, validate, signals, session.options.bootstrap, ripples).run(progress)
    found = _screened(session, corrections, signals, found)
    explained = weighed(found.model, session.prior).weights == "whitened"
    moments = changes(found.model, signals.prepared(found.model.terms).pairs, explained)
    return replace(found, model=with_uncertainties(found.model), lines=lines, changes=moments)


def _screened(session: Session, corrections: Corrections, signals: SessionSignals, found: Attribution) -> Attribution:
    """Refit at other cut-offs of the identification filter: a real coefficient is constant, an artefact moves.

    A named effect is dropped if a refit turns its sign, or makes it several times larger or smaller, significantly.
    """
    terms = [item.score.term for item in found.accepted]
    named = [n for n, term in enumerate(terms) if isinstance(term.content, Effect) and not term.is_line]
    if not named:
        return found
    bandwidth = session.bank.bandwidth_hz
    leading = {n: _leading(found.model, n) for n in named}
    values = {n: [(bandwidth, *_value(found.model, n, leading[n]))] for n in named}
    for other in _at_others(session):
        model = SessionSignals(other, corrections).refit(found.model.terms)
        for n, own in values.items():
            own.append((other.bank.bandwidth_hz, *_value(model, n, leading[n])))
        del model, other  # before the next, which are as large
    moved = {
        found.accepted[n].score.term.family: Sentence(
            "fitting.changes_with_filter",
            values=[Sentence("fitting.at_cutoff", value=value, cutoff=cutoff) for cutoff, value, _ in own],
        )
        for n, own in values.items()
        if moves(own)
    }
    accepted = tuple(replace(item, cutoffs=tuple(values.get(n, ()))) for n, item in enumerate(found.accepted))
    found = replace(found, accepted=accepted).refusing(moved, "artefact")
    return replace(found, model=signals.refit([item.score.term for item in found.accepted])) if moved else found


def other_bands(
    session: Session, corrections: Corrections, progress: Progress = quiet
) -> tuple[tuple[float, tuple[Family, ...]], ...]:
    """Find what is more probable than nothing at other cut-offs of the identification filter: (Hz, families).

    Only asked where nothing was found: a name has its values at these cut-offs (:func:`_screened`).
    """
    result = []
    for number, other in enumerate(_at_others(session)):
        progress(0.86 + 0.03 * number, Sentence("fitting.looking_again_another_bandwidth"))
        result.append((other.bank.bandwidth_hz, _found_at(other, corrections)))
    return tuple(result)


def _at_others(session: Session) -> Iterator[Session]:
    """Yield the session at other cut-offs, those whose filters every recording is long enough for."""
    for factor in SCREEN:
        other = session.at_bandwidth(min(factor * session.bank.bandwidth_hz, session.machine.rate_hz / 5))
        if all(stretches(other.machine, own, other.bank) for own in other.recordings):
            yield other


def _found_at(session: Session, corrections: Corrections) -> tuple[Family, ...]:
    """Find the most probable family at another cut-off where nothing is improbable there."""
    signals = SessionSignals(session, corrections)
    base, unseen = signals.refit(()), np.zeros(len(session.machine.joints))
    ratings = Ratings(base, Draws(signals, 0), once=True)
    rated = ratings.rated(base, unseen, settled=True)
    if nothing_more(rated) < 0.5:
        # Replicas take off what noise makes of the candidates: only drawn where something is probable at all.
        ratings.draws = Draws(signals, session.options.bootstrap)
        rated = ratings.rated(base, unseen, settled=True)
    return () if nothing_more(rated) >= 0.5 else (rated[0].term.family,)


def _leading(model: Model, number: int) -> int:
    """Return the place of a term's most significant parameter."""
    part = model.term_slice(number)
    return int(np.argmax(np.abs(model.values(number)) / np.maximum(model.fit.std[part], 1e-300)))


def _value(model: Model, number: int, place: int) -> tuple[float, float]:
    """Return value and standard deviation of one parameter of a term."""
    return float(model.values(number)[place]), float(model.fit.std[model.term_slice(number)][place])


def moves(values: Sequence[tuple[float, float, float]]) -> bool:
    """Return whether a coefficient depends on the filter beyond its uncertainty and a factor :data:`SCREEN_RATIO`."""
    _, first, first_std = values[0]
    for _, value, std in values[1:]:
        apart = abs(value - first) > SCREEN_Z * float(np.hypot(std, first_std))
        ratio = abs(value) / max(abs(first), 1e-300)
        if apart and (value * first < 0 or not 1 / SCREEN_RATIO < ratio < SCREEN_RATIO):
            return True
    return False


def _ripples(signals: SessionSignals) -> tuple[tuple[Line, ...], tuple[Accepted, ...]]:
    """Find spectral lines of the raw residual; those in band are terms of the model from the start.

    Above the band a line does the fit no harm: it is named, and nothing is added. A pump's phase is of no recording but
    its own, so that of `validate` is taken from there. A joint without a cylinder has no pump: its lines are given as
    they are, and represent no effect.
    """
    prepared, model = signals.prepared(()), signals.refit(())
    design, theta = prepared.design, model.fit.theta
    lines = machine_lines(design, theta, prepared.fitted, prepared.pairs)
    accepted: list[Accepted] = []
    for line in lines:
        if line.frequency_hz > design.bank.bandwidth_hz or not is_ripple(design.machine, line):
            continue
        parts = residual_parts(design, theta, line.joint, prepared.validate) if prepared.validate else ()
        term = Term(line_effect(), line.joint, (line.on(parts) if parts else line).shape)
        before = signals.refit([item.score.term for item in accepted])
        for score in score_terms(before, [term], [1]):
            if margin(score) <= 0:
                continue
            trial = signals.refit([*(item.score.term for item in accepted), term])
            held_out = held_out_gain(before.rows(), trial.rows(), design.bank.reduced_rate_hz)
            gain = validate_gain(before, trial, prepared.validate) if prepared.validate else None
            accepted.append(Accepted(score, (), held_out, gain))
    return lines, tuple(accepted)
