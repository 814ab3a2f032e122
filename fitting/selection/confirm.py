"""The gate: what is found in the fitted rows has to hold where it was not looked for.

Nothing is selected here. A term that the criterion chose is refused where blocks that were left out of the fit, the
validation motion, the unloaded recordings or the sense of its friction speak against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from daq.messages import Sentence
from fitting.effects.base import Effect
from fitting.residual.confirmation.confirmation import Misfit, OnValidate, on_validate, worse_joint
from fitting.residual.confirmation.cross_validation import CONFIRMED, HeldOut, held_out_gain
from fitting.residual.confirmation.robustness import Leftover
from fitting.residual.confirmation.witness import Witness, witness
from fitting.residual.confirmation.witness import objection as of_the_load
from fitting.residual.findings import Accepted
from fitting.residual.friction_power import CERTAIN, driving, friction_power, rubs
from fitting.residual.null import Null
from fitting.residual.scoring import Score, white_columns
from fitting.residual.terms import Model, Term
from fitting.selection.evidence import least_gain


class Signals(Protocol):
    """Corrections of the signals themselves, for effects that a column cannot correct when they are large."""

    def nulls(self, model: Model, terms: Sequence[Term], draws: int, first: int = 0) -> list[Null | None]:
        """Compute terms' gains on replicas of the recordings in which the model is the whole truth."""

    def misfit(self, model: Model, joint: int) -> Misfit:
        """Compute what the model leaves of a joint that two runs of one motion share."""

    def rebuilt(self, model: Model) -> Model:
        """Move the model's last term into the signals as far as it can be."""

    def mirrored(self, model: Model, trial: Model) -> tuple[Model, Model]:
        """Return the model with its effort moved against that delay and, as far, with it; in one noise."""

    def refit(self, terms: Sequence[Term]) -> Model:
        """Refit afresh with these terms on signals corrected by them."""


@dataclass(frozen=True)
class Answer:
    """Answer of the gate on a term.

    Attributes
    ----------
    reason : why it is rejected; empty if nothing is against it
    found : the term, with what held-out blocks, `validate` and unloaded recordings show of it
    validate : what the validation motion shows of it; None without one
    faint : it is insignificant against the noise of just the rows that show it
    worse : it makes another joint worse on `validate`
    """

    reason: str
    found: Accepted
    validate: OnValidate | None
    faint: bool
    worse: bool = False

    def left_of(self, odds: float) -> float:
        """Compute what is left of the log odds of a refused term: more likely than nothing, it is something unknown.

        Blocks that were left out were fitted to find it: what they state is all that is left. The validation motion was
        not, and its density counts beside the odds.
        """
        if self.found.held_out.confirmed <= CONFIRMED:
            return 0.5 * self.found.held_out.confirmed
        if self.validate is not None and self.validate.refutes:
            return odds + 0.5 * min(self.validate.predicted, self.validate.gain, 0.0)
        return odds


class Gate:
    """Asks held-out blocks, the validation motion, and unloaded recordings of a model with one term more.

    Parameters
    ----------
    signals : refits
    validate : segments of the `validate` recordings; empty where there are none
    """

    def __init__(self, signals: Signals, validate: Sequence[int]) -> None:
        self._signals, self._validate = signals, validate
        self._last: tuple[Model, Term, Model, Model] | None = None

    def asked(self, choice: Score, before: Model, trial: Model) -> Answer:
        """Return the objections to the last term of ``trial``."""
        held_out, seen = self.judged(before, trial)
        reason = objection(held_out, seen)
        load = _witness(before, choice.term)
        if not reason and isinstance(choice.term.content, Effect) and load is not None:
            against = of_the_load(choice.term.content.level, load)
            if against:
                reason = Sentence("fitting.effect_drive_itself_without", against=against)
        worse = None if reason or seen is None else worse_joint(before, trial, self._validate)
        if worse is not None:
            name = before.design.parameters.joints[worse[0]]
            reason = Sentence("fitting.makes_worse_validation_motion", joint=name, change=100 * worse[1])
        gain, words = None if seen is None else seen.gain, "" if load is None else load.words
        return Answer(
            reason or _driving(choice.term, before, trial),
            Accepted(choice, (), held_out, gain, words, silence=silence(seen)),
            seen,
            choice.gain / held_out.inflation <= least_gain(choice.live),
            worse is not None and worse[0] != choice.term.joint,
        )

    def with_term(self, model: Model, term: Term) -> Model:
        """Add one term to the model, moved into the signals as far as it can be; the last model is cached."""
        if self._last is None or self._last[0] is not model or self._last[1] != term:
            plain = self._signals.refit([*model.terms, term])
            self._last = model, term, plain, self._signals.rebuilt(plain)
        return self._last[3]

    def judged(self, before: Model, trial: Model) -> tuple[HeldOut, OnValidate | None]:
        """Compute the gains of a trial's last term on held-out blocks and on the validation motion."""
        # A column of what was moved holds what is left of it: the signals before show more.
        plain = self._last[2] if self._last is not None and trial is self._last[3] else trial
        expected = trial.terms[-1].expected is not None
        held_out = held_out_gain(before.rows(), plain.rows(), trial.design.bank.reduced_rate_hz, expected)
        mirrored = self._signals.mirrored(before, trial) if trial.terms[-1].rebuilt else None
        held_out = replace(held_out, inflation=_inflation(before, plain, trial))
        if not self._validate:
            return held_out, None
        if mirrored is None:
            return held_out, on_validate(before, trial, self._validate)
        # Samples between samples have less noise, and a noise model of their own: beside efforts that were not moved,
        # that is what a chi-square shows first. The parabola of the delay is four times as high at the other one.
        seen = on_validate(*mirrored, self._validate)
        quarter = [value / 4.0 for value in (seen.gain, seen.expected, seen.spread, seen.predicted)]
        return held_out, OnValidate(quarter[0], quarter[1], quarter[2], quarter[3], seen.entered, seen.rise)


def objection(held_out: HeldOut, validate: OnValidate | None) -> str:
    """Return why a term is not to be added; empty if there is no objection.

    One rule for all terms: the rows that were left out have to be :data:`CONFIRMED` times as probable with it, against
    the noise of the rows that show it. The validation motion is one more block; where a right term need not show itself
    it may reject only what its rows contradict as clearly.
    """
    if held_out.confirmed <= CONFIRMED:
        size = Sentence("fitting.log_density", log_density=0.5 * held_out.confirmed)
        if held_out.confirmed * held_out.inflation > CONFIRMED:
            return Sentence("fitting.rows_show_times_noisy", inflation=held_out.inflation, size=size)
        if held_out.gain > CONFIRMED:
            return Sentence("fitting.blocks_left_out_fit", size=size)
        return Sentence("fitting.not_hold_blocks_left", size=size)
    if validate is not None and validate.refutes:
        size = Sentence("fitting.log_density", log_density=0.5 * min(validate.predicted, validate.gain))
        return Sentence("fitting.not_help_validation_motion", size=size)
    return ""


def _inflation(before: Model, plain: Model, trial: Model) -> float:
    """Return how much noisier the rows are where the last term changes what is fitted, in what ``trial`` leaves."""
    sections = {joint: [part for _, part in plain.sections(joint)] for joint in range(len(plain.fit.residual))}
    shown = {}
    for joint, parts in sections.items():
        rows = slice(parts[-1].stop if parts else 0)
        shown[joint] = before.fit.residual[joint][rows] - plain.fit.residual[joint][rows]
    return Leftover(dict(enumerate(trial.fit.residual)), sections).inflation(shown)


def silence(validate: OnValidate | None) -> str:
    """Return why the validation motion confirms nothing of a term that it does not reject; else empty."""
    if validate is None:
        return ""
    if not validate.entered:  # what it changes of the base may help there: that is no witness of this effect
        return Sentence("fitting.validation_motion_never_enters")
    return "" if validate.predicted > CONFIRMED else Sentence("fitting.validation_motion_hardly_shows")


def _driving(term: Term, before: Model, trial: Model) -> str:
    """Return why a friction turns a joint's whole friction into a drive; signs of single parts are free."""
    joint = term.joint
    if joint is None or not rubs(term, joint):
        return ""
    found = driving(friction_power(trial, joint), trial.fit, CERTAIN)
    if found is None or driving(friction_power(before, joint), before.fit, CERTAIN) is not None:
        return ""
    name = before.design.parameters.joints[joint]
    return Sentence(
        "fitting.friction_would_drive_motion", joint=name, speed=found.speed, force=found.force, std=found.std
    )


def _witness(model: Model, term: Term) -> Witness | None:
    """Compare a candidate on unloaded and loaded recordings; None where one of the two is missing."""
    joint, design = term.joint, model.design
    loaded = {design.segments[i].loaded for i in model.fitted}
    if joint is None or term.everywhere or len(loaded) < 2:
        return None
    columns, unloaded = white_columns(model, term)
    return witness(columns, model.fit.residual[joint], model.fit.orthonormal[joint], unloaded)
