"""The residual loop on a session of any length: searched, held against all samples, confirmed in the efforts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fitting.loop.effort_confirmation import confirmed_in_effort
from fitting.loop.everything import held_against_everything
from fitting.loop.residual_loop import run_attribution
from fitting.loop.session import Session
from fitting.residual.findings import Attribution
from fitting.signals.corrections import Corrections

Progress = Callable[[float, str], None]


def attributed(
    session: Session, corrections: Corrections, progress: Progress = lambda fraction, text: None
) -> Attribution:
    """What the residual of a session is traced to.

    Parameters
    ----------
    session : of all recordings; effects are searched for on its pieces (:attr:`Session.search`)
    corrections : of the positions, as kinematics found
    progress : called with a fraction and plain words
    """
    search = session.search
    found = run_attribution(search.session, corrections, progress)
    if not search.whole:
        found = held_against_everything(session, corrections, search, found, progress)
    found = confirmed_in_effort(session, corrections, found)
    names = [joint.name for joint in session.machine.joints]
    silent = [
        f"{'machine' if item.score.term.joint is None else names[item.score.term.joint]}: of {item.score.term.id} "
        f"{item.silence}; record one that shows it"
        for item in found.accepted
        if item.silence
    ]
    return replace(found, warnings=(*found.warnings, *silent))
