"""What was found, confirmed once more where the final fit has equal weights.

Where the model explains the recordings down to their noise, the loop's own confirmation on whitened rows stands. Where
it does not (:mod:`fitting.loop.weighting`), whitened rows all but ignore slow errors, and what lowers them on the
validation motion may raise the error of the effort there. So each finding is added again, in the order in which it was
found, to least squares of joint efforts, and stays if the error of the efforts on ``validate`` falls: its
block-bootstrap interval excludes zero, and no joint gets worse by more than
:data:`~fitting.residual.confirmation.confirmation.MOST_WORSE` and its interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.loop.refits import SessionSignals
from fitting.loop.session import Session
from fitting.loop.weighting import Weighed, weighed
from fitting.regression.design import effort_errors
from fitting.residual.confirmation.confirmation import MOST_WORSE, error_change
from fitting.residual.findings import Accepted, Attribution, Family
from fitting.residual.terms import Model
from fitting.signals.corrections import Corrections

Errors = tuple[FloatArray, ...]


def confirmed_in_effort(session: Session, corrections: Corrections, found: Attribution) -> Attribution:
    """Return the findings confirmed where the final fit has equal weights; all where it is whitened.

    Parameters
    ----------
    session : of all recordings
    corrections : what kinematics found
    found : what the loop accepted
    """
    signals = SessionSignals(session, corrections)
    validate = session.plain.validate
    items = [item for item in found.accepted if not item.score.term.confined]
    if not items or not validate:
        return found
    if weighed(signals.refit([item.score.term for item in found.accepted]), session.prior).weights == "whitened":
        return found
    kept: list[Accepted] = [item for item in found.accepted if item.score.term.confined]
    reasons = dict[Family, str]()

    def errors() -> Errors:
        return _errors(weighed(signals.refit([k.score.term for k in kept]), session.prior), validate)

    before = errors()
    for item in items:
        kept.append(item)
        after = errors()
        refused = _refused(session, before, after)
        if refused is None:
            before = after
            continue
        reasons[kept.pop().score.term.family] = refused
    if not reasons:
        return found
    model = signals.refit([item.score.term for item in kept])
    # What was said of joints whose findings are gone goes with them.
    places = {item.score.term.joint for item in kept}
    names = [session.machine.joints[joint].name for joint in places if joint is not None]
    warnings = tuple(w for w in found.warnings if w.partition(":")[0] in names)
    left = replace(found.refusing(reasons), accepted=tuple(kept), model=model, warnings=warnings)
    return left.with_status(_demoted(left, found))


def _errors(final: Weighed, validate: Sequence[int]) -> Errors:
    model: Model = final.model
    return effort_errors(model.design, model.fit.theta, validate, model.extra)


def _refused(session: Session, before: Errors, after: Errors) -> str | None:
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
