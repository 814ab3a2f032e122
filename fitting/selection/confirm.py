"""The gate: what is found in the fitted rows has to hold where it was not looked for.

Nothing is selected here. A term that the criterion chose is refused where blocks that were left out of the fit, the
validation motion, the unloaded recordings or the sense of its friction speak against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.effects.base import Effect
from fitting.residual.confirmation.confirmation import OnValidate, worse_joint
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.confirmation.trials import Trials
from fitting.residual.confirmation.witness import Witness, witness
from fitting.residual.confirmation.witness import objection as of_the_load
from fitting.residual.friction_power import CERTAIN, driving, friction_power, rubs
from fitting.residual.laws import Law
from fitting.residual.scoring import Score, white_columns
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model, Term
from fitting.selection import priors
from fitting.selection.evidence import curve_precision, least_gain

FloatArray = npt.NDArray[np.float64]

#: Standard errors by which the gain on held-out blocks has to be above zero; more where no validation motion has a say
#: and most of the gain is lost there.
LEAST_Z, LEAST_Z_ALONE = 1.5, 3.0
#: What keeps this share of its gain on held-out blocks holds, even if a few of them brought it: a resonance rings where
#: it was hit, a load is overrun in one place, a drift shows at both ends.
HELD_SHARE = 0.5


@dataclass(frozen=True)
class Answer:
    """What the gate says of a term: ``reason`` is empty if nothing is against it.

    Attributes
    ----------
    held_out, validate_gain, witness : what held-out blocks, `validate` and unloaded recordings say of it
    faint : it may be noise of just the rows that show it
    worse : number of a joint that it makes worse on `validate`, if that is what is against it
    """

    reason: str
    held_out: HeldOut
    validate_gain: float | None
    witness: str
    faint: bool
    worse: int | None = None


class Gate:
    """Asks held-out blocks, the validation motion, and unloaded recordings."""

    def __init__(self, trials: Trials, validate: Sequence[int]) -> None:
        self._trials, self._validate = trials, validate

    def with_term(self, model: Model, term: Term) -> Model:
        """The model with one term more, moved into the signals as far as it can be."""
        return self._trials.with_term(model, term)

    def asked(self, choice: Score, before: Model, trial: Model) -> Answer:
        """What is against the last term of ``trial``."""
        held_out, seen = self._trials.judged(choice, before, trial, _expected(choice))
        reason = objection(choice, held_out, seen)
        heard = _heard(before, choice.term)
        if not reason and isinstance(choice.term.content, Effect) and heard is not None:
            against = of_the_load(choice.term.content.level, heard)
            if against:
                reason = f"an effect of the drive itself has to be there without a load: {against}"
        worse = None
        if not reason and seen is not None:
            found = worse_joint(before, trial, self._validate)
            if found is not None:
                worse = found[0]
                name = before.design.parameters.joints[worse]
                reason = f"it makes {name} worse on the validation motion (error {100 * found[1]:+.1f} %)"
        reason = reason or _driving(choice.term, before, trial)
        return Answer(
            reason,
            held_out,
            None if seen is None else seen.gain,
            "" if heard is None else heard.words,
            too_faint(choice, held_out),
            worse,
        )


def objection(choice: Score, held_out: HeldOut, validate: OnValidate | None) -> str:
    """Why a term is not to be added; empty if there is nothing against it.

    A validation motion that could not show a right effect is as good as none, unless it shows that this one is wrong.
    """
    if too_faint(choice, held_out):
        return (
            f"the rows that show it are {held_out.own_noise:.1f} times as noisy as the motion as a whole; against that "
            f"it gains {held_out.own_gain:.1f} of chi-square, less than the noise and its price ask for"
        )
    if choice.term.confined:  # most blocks know nothing of it, and no other recording does: it has to be plain
        if held_out.gain >= HELD_SHARE * choice.gain and plain(choice):
            return ""
        return "it acts in one recording only, and is not significant enough to be believed without another"
    blind = is_blind(choice, validate)
    alone = validate is None or blind
    kept = held_out.gain >= HELD_SHARE * choice.gain
    if alone:  # what keeps its gain still has to be more than a few blocks' luck
        holds = held_out.z >= (LEAST_Z if kept else LEAST_Z_ALONE)
    else:
        holds = kept or held_out.z >= LEAST_Z
    if not (held_out.gain > 0 and holds):
        return (
            f"it does not hold on blocks that were left out of the fit (chi-square {held_out.gain:+.1f}, "
            f"{held_out.z:.1f} standard errors)"
        )
    if validate is not None and validate.gain <= 0 and not blind:
        return f"it does not help on the validation motion (chi-square {validate.gain:+.1f})"
    return ""


def too_faint(choice: Score, held_out: HeldOut) -> bool:
    """Whether a gain is not significant against the noise of just the rows that show it."""
    return held_out.own_gain <= least_gain(choice.live)


def plain(choice: Score) -> bool:
    """Whether a gain is twice what it takes."""
    return choice.gain > 2.0 * least_gain(choice.live)


def is_blind(choice: Score, validate: OnValidate | None) -> bool:
    """Whether the validation motion has nothing to say of a plain effect: no gain, and none to be expected."""
    if validate is None or validate.gain > 0 or validate.tells or validate.refutes:
        return False
    return plain(choice)


def _expected(choice: Score) -> FloatArray | None:
    """Precision of what is expected of a law's coefficients; None for what is no curve.

    The same curves are expected where a block is left out as where the law was chosen.
    """
    law = choice.term.content
    if not isinstance(law, Law) or isinstance(law, Surface):
        return None
    sizes = priors.amplitudes(float(np.sqrt(max(choice.gain, 0.0))))
    return curve_precision(choice.information, choice.information @ np.asarray(choice.values), priors.LENGTHS, sizes)


def _driving(term: Term, before: Model, trial: Model) -> str:
    """Whether a friction turns the whole friction of its joint into a drive; signs of single parts say nothing."""
    joint = term.joint
    if joint is None or not rubs(term, joint):
        return ""
    found = driving(friction_power(trial, joint), trial.fit, CERTAIN)
    if found is None or driving(friction_power(before, joint), before.fit, CERTAIN) is not None:
        return ""
    name = before.design.parameters.joints[joint]
    return (
        f"with it the friction of {name} would drive the motion at {found.speed:.3g} of speed "
        f"({found.force:.3g} ± {found.std:.2g})"
    )


def _heard(model: Model, term: Term) -> Witness | None:
    """What unloaded and loaded recordings say of a candidate; None where one of the two is not there."""
    joint, design = term.joint, model.design
    loaded = {design.segments[i].loaded for i in model.fitted}
    if joint is None or term.everywhere or len(loaded) < 2:
        return None
    columns, unloaded = white_columns(model, term)
    return witness(columns, model.fit.residual[joint], model.fit.orthonormal[joint], unloaded)
