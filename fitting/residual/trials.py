"""Trials: the model with one term more, what held-out blocks and `validate` say of it, and its other names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from fitting.prior import Prior
from fitting.regression import WhiteRows
from fitting.residual import rules
from fitting.residual.confirmation import Misfit, OnValidate, on_validate
from fitting.residual.cross_validation import HeldOut, held_out_gain
from fitting.residual.null import Null
from fitting.residual.robustness import inflation
from fitting.residual.rules import ANOTHER_SHARE
from fitting.residual.scoring import Score, score_terms
from fitting.residual.terms import Model, Term


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


class Trials:
    """Models that were tried on signals, and how they did.

    Parameters
    ----------
    signals : refits
    validate : segments of the `validate` recordings; empty where there are none
    """

    def __init__(self, signals: Signals, validate: Sequence[int]) -> None:
        self._signals, self._validate = signals, validate
        self._last: tuple[Model, Term, Model, Model] | None = None

    def with_term(self, model: Model, term: Term) -> Model:
        """The model with one term more, moved into the signals as far as that can be; the last one is kept."""
        if self._last is None or self._last[0] is not model or self._last[1] != term:
            plain = self._signals.refit([*model.terms, term])
            self._last = model, term, plain, self._signals.rebuilt(plain)
        return self._last[3]

    def stands(self, law: Score, rest: Sequence[Term], trial: Model | None = None) -> bool:
        """Whether a law would be added to ``rest``: what does not hold elsewhere cannot say more than a name.

        ``trial`` is the model of ``rest`` and the law, where there is one already.
        """
        before, trial = self._signals.refit(rest), trial or self._signals.refit([*rest, law.term])
        alone = score_terms(before, [law.term], [1])
        return bool(alone) and not self.judged(alone[0], before, trial)[2]

    def judged(self, choice: Score, before: Model, trial: Model) -> tuple[HeldOut, OnValidate | None, str]:
        """What held-out blocks and the validation motion say of a trial's last term, and what is against adding it."""
        rows, columns = self._last_rows(trial)
        held_out = held_out_gain(rows, columns, trial.design.bank.reduced_rate_hz)
        # What is moved into the signals explains more than its column, which is its beginning only.
        moved = before.fit.chi_square - trial.fit.chi_square if trial.terms[-1].rebuilt else 0.0
        own_noise = inflation(rows, columns, trial.fit.residual)
        held_out = replace(held_out, own_noise=own_noise, own_gain=max(choice.gain, moved) / own_noise)
        confirming = self._validate and not choice.term.confined
        seen = on_validate(before, trial, self._validate) if confirming else None
        return held_out, seen, rules.objection(choice, held_out, seen)

    def _last_rows(self, trial: Model) -> tuple[tuple[WhiteRows, ...], int]:
        """Whitened rows with the trial's last term in the last columns, and how many those are."""
        part = trial.term_slice(len(trial.terms) - 1)
        if self._last is not None and trial is self._last[3]:
            trial = self._last[2]  # a column of what was moved holds what is left of it: the signals before tell more
        return trial.rows(self._signals.prior), part.stop - part.start


def without_gain_beside(before: Model, trial: Model, scores: Sequence[Score]) -> list[Score]:
    """Of these scores those whose gain is gone in ``trial``: the others explain something else than its last term."""
    terms = [score.term for score in scores]
    alone, beside = (
        {score.term.family: score.gain for score in score_terms(model, terms, [1] * len(terms))}
        for model in (before, trial)
    )
    return [s for s in scores if beside.get(s.term.family, 0.0) < ANOTHER_SHARE * alone.get(s.term.family, 0.0)]
