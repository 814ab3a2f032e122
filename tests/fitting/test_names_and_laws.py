"""Where a name ends and a law begins: series stand for the formulas of their signal, and for its constant."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from synthetic_arm import USUAL, Motion, force, make_motion, make_recordings, planar_machine, truth

from fitting.effects import effects
from fitting.effects.base import Effect
from fitting.loop.refits import SessionSignals
from fitting.loop.residual_loop import run_attribution
from fitting.loop.session import Options, Session
from fitting.residual.confirmation.confirmation import OnValidate
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.findings import Accepted, Attribution, Family
from fitting.residual.scoring import catalogue_terms
from fitting.selection.confirm import Answer
from fitting.selection.decision import Rated
from fitting.selection.search import Search
from fitting.signals.corrections import Corrections

pytestmark = pytest.mark.slow


def session_with(force_on: Callable[[Motion], np.ndarray], only_loaded: bool = False) -> Session:
    """Recordings where joint 2 of two has a further force on its piston, N (N,)."""
    machine, arm = planar_machine(2), truth(2)
    added = []
    for role, seed in USUAL:
        motion = make_motion(machine, role, seed, 60.0)
        extra = np.zeros_like(force(machine, arm, motion))
        if role != "unloaded" or not only_loaded:
            extra[:, 1] = force_on(motion)
        added.append(extra)
    return Session(machine, make_recordings(machine, arm, added=added, seconds=60.0), Options(bootstrap=0))


def found_with(force_on: Callable[[Motion], np.ndarray], only_loaded: bool = False) -> Attribution:
    """What is found in them."""
    session = session_with(force_on, only_loaded)
    return run_attribution(session, Corrections(session.machine))


def place(motion: Motion) -> np.ndarray:
    """Where the piston of joint 2 is, in parts of its travel under load, 0.05 to 0.17 m (N,)."""
    return np.asarray((motion.x[:, 1] - 0.05) / 0.12)


def test_friction_from_some_position_on_is_friction_that_depends_on_the_position() -> None:
    found = found_with(lambda motion: 60.0 * np.maximum(0.0, place(motion) - 0.55) * np.sign(motion.v[:, 1]))
    assert [item.score.term.family for item in found.accepted] == [("position_dependent_friction", 1)]


@cache
def worn_session() -> Session:
    """A bore that is worn where the piston works most."""
    return session_with(lambda motion: -250.0 * np.exp(-(((place(motion) - 0.5) / 0.4) ** 2)) * np.sign(motion.v[:, 1]))


def test_a_bore_that_is_worn_where_the_piston_works_most_has_friction_that_depends_on_the_position() -> None:
    """Flat in the middle and steep on both sides, in full sight of the noise: a cubic leaves a fifth of it."""
    found = run_attribution(worn_session(), Corrections(worn_session().machine))
    (item,) = found.accepted
    assert item.score.term.family == ("position_dependent_friction", 1)
    assert item.probability > 0.9


def test_hoses_that_rest_beyond_the_motion_are_hoses() -> None:
    """Then most of what they do is a constant, and only with a load: no transducer's zero, no law of the position."""

    def pull(motion: Motion) -> np.ndarray:
        return np.asarray(12.0 * (motion.q[:, 1] - 2.5) / motion.r[:, 1])

    found = found_with(pull, only_loaded=True)
    (item,) = found.accepted
    assert item.score.term.family == ("hose_stiffness", 1)
    assert item.probability is not None and item.probability > 0.5


def test_what_pushes_farther_the_farther_it_is_bent_is_a_law_for_certain() -> None:
    """A smooth law of the position, with the sign that no spring has: a curve does not make a name of it."""

    def push(motion: Motion) -> np.ndarray:
        return np.asarray(-15.0 * (motion.q[:, 1] - motion.q[:, 1].mean()) / motion.r[:, 1])

    found = found_with(push, only_loaded=True)
    assert found.verdict == "unexplained"
    assert not [h for h in found.hypotheses if h.probability > 0.05 and any(t.id != "law" for t in h.terms)]


def test_a_name_that_fails_closes_those_that_are_not_more_probable_than_what_is_left_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Another motion takes as much off its odds as its rows are less probable with it; a law is open in any case."""
    session = worn_session()
    signals = SessionSignals(session, Corrections(session.machine))
    base = signals.refit(())

    def open_then(density: float) -> tuple[Rated, dict[Family, float], dict[Family, float]]:
        search = Search(base, (), signals)
        before = search.beside(base, ())
        choice = next(r for r in before if isinstance(r.term.content, Effect) and r.term.joint == 1)
        seen = OnValidate(gain=2.0 * density, expected=np.inf, spread=1.0, predicted=2.0 * density)
        found = Accepted(choice.score, (), HeldOut(50.0, 5.0, 9), 2.0 * density)
        answer = Answer("it does not help on the validation motion", found, seen, faint=False)
        monkeypatch.setattr(search.gate, "asked", lambda *_: answer)
        search.attempt(choice)
        after = {r.term.family for r in search.beside(base, ())}
        others = {
            r.term.family: r.log_odds for r in before if r.term.joint == 1 and r.term.family != choice.term.family
        }
        assert choice.term.family not in after
        assert ("law", 1) in after
        return choice, {f: o for f, o in others.items() if f in after}, others

    choice, there, others = open_then(density=-1.0)
    assert set(there) == {("law", 1)}
    near = np.sort([odds for (name, _), odds in others.items() if name != "law"])[-1]
    _, there, _ = open_then(density=near - choice.log_odds - 10.0)
    named = {f: odds for f, odds in others.items() if f[0] != "law" and odds > near - 7.0}
    assert set(there) - {("law", 1)} == set(named)
    _, there, _ = open_then(density=-choice.log_odds - 10.0)
    assert there == others


def test_what_makes_another_joint_worse_is_asked_again_beside_other_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters that joints share are bent by what another joint lacks: that refutes nothing of this one's name."""
    session = session_with(lambda motion: 150.0 * np.sign(motion.v[:, 1]) * place(motion))
    signals = SessionSignals(session, Corrections(session.machine))
    search = Search(signals.refit(()), (), signals)
    before = search.beside(search.model, ())
    choice = next(r for r in before if r.term.joint == 1 and isinstance(r.term.content, Effect) and r.log_odds > 3.0)
    worse = Answer(
        "it makes joint1 worse", Accepted(choice.score, (), HeldOut(50.0, 50.0, 9), 20.0), None, faint=False, worse=True
    )
    monkeypatch.setattr(search.gate, "asked", lambda *_: worse)
    search.attempt(choice)
    open_then = {r.term.family: r.log_odds for r in search.beside(search.model, ())}
    assert choice.term.family not in open_then
    others = {r.term.family: r.log_odds for r in before if r.term.family in open_then}
    assert open_then == pytest.approx(others)  # nothing else is doubted for it
    other = next(term for term in catalogue_terms(search.base, effects())[0] if term.joint == 0)
    with_other = search.gate.with_term(search.model, other)
    assert choice.term.family in {r.term.family for r in search.beside(with_other, ())}
