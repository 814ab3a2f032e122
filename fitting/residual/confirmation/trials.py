"""Trials: the model with one term more, and what held-out blocks and `validate` say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from fitting.arrays import FloatArray
from fitting.regression.prior import Prior
from fitting.regression.solving import WhiteRows
from fitting.residual.confirmation.confirmation import Misfit, OnValidate, on_validate
from fitting.residual.confirmation.cross_validation import HeldOut, held_out_gain
from fitting.residual.confirmation.robustness import inflation
from fitting.residual.null import Null
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

    def mirrored(self, model: Model, trial: Model) -> tuple[Model, Model]:
        """The model with its effort moved as far the other way as that delay says, and as it says; in one noise."""
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

    def judged(
        self, before: Model, trial: Model, precision: FloatArray | None = None
    ) -> tuple[HeldOut, OnValidate | None]:
        """What held-out blocks and the validation motion say of a trial's last term.

        ``precision`` (k, k) is of what is expected of its parameters before any data.
        """
        rows, columns = self._last_rows(trial)
        held_out = held_out_gain(rows, columns, trial.design.bank.reduced_rate_hz, precision)
        mirrored = self._signals.mirrored(before, trial) if trial.terms[-1].rebuilt else None
        held_out = replace(held_out, inflation=inflation(rows, columns, trial.fit.residual))
        if not self._validate:
            return held_out, None
        if mirrored is None:
            return held_out, on_validate(before, trial, self._validate)
        # Samples between samples have less noise, and a noise model of their own: beside efforts that were not moved,
        # that is what a chi-square shows first. The parabola of the delay is four times as high at the other one.
        seen = on_validate(*mirrored, self._validate)
        quarter = [value / 4.0 for value in (seen.gain, seen.expected, seen.spread, seen.predicted)]
        return held_out, OnValidate(quarter[0], quarter[1], quarter[2], quarter[3], seen.entered)

    def _last_rows(self, trial: Model) -> tuple[tuple[WhiteRows, ...], int]:
        """Whitened rows with the trial's last term in the last columns, and how many those are."""
        part = trial.term_slice(len(trial.terms) - 1)
        if self._last is not None and trial is self._last[3]:
            trial = self._last[2]  # a column of what was moved holds what is left of it: the signals before tell more
        return trial.rows(), part.stop - part.start
