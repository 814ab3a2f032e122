"""Which share of a gain is believed: of what is alike, the same, whichever of it replicas were drawn of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import clean_session

from fitting.effects import effect
from fitting.loop.refits import SessionSignals
from fitting.residual.null import Null
from fitting.residual.scoring import Candidates, Score, white_columns
from fitting.residual.terms import Model, Term
from fitting.selection.decision import Rated
from fitting.selection.trust import OPEN, Draws, Trust
from fitting.signals.corrections import Corrections

pytestmark = pytest.mark.slow

#: Of as many draws as say how much more than in theory a parameter scatters.
SCATTERED = np.array([[-40.0], [40.0], [-35.0], [35.0], [30.0], [-30.0]])


def trust_and_scores(*terms: Term, gain: float = 200.0) -> tuple[Trust, dict[int, Score]]:
    """Terms beside the base of an arm that lacks nothing, each as if it gained so much."""
    session = clean_session(2)
    model = SessionSignals(session, Corrections(session.machine)).refit(())
    candidates = Candidates(model, terms, [1] * len(terms))
    scores = candidates.scores(model)
    for number, score in scores.items():
        size = np.sqrt(gain / score.information[0, 0])
        scores[number] = replace(score, gain=gain, values=(size,), free=(size,))
    return Trust(candidates, model), scores


def drawn(score: Score) -> Score:
    """The score with replicas in which it scatters three times as far as in theory, without a bias."""
    values = 3.0 * SCATTERED / np.sqrt(np.mean(SCATTERED**2)) / np.sqrt(score.information[0, 0])
    return replace(score, null=Null(values, score.information, 1))


@pytest.mark.parametrize("which", [0, 1])
def test_two_that_are_the_same_are_believed_alike_whichever_was_drawn(which: int) -> None:
    """Else noise in the regressors, which both have, would decide for the one of which nobody asked."""
    term = Term(effect("velocity_root_friction"), 1, {"n": 0.5})
    trust, scores = trust_and_scores(term, term)
    scores[which] = drawn(scores[which])
    trust.weigh([[0], [1]], [], scores)
    assert trust.of(which) < 0.5
    assert trust.of(1 - which) == pytest.approx(trust.of(which))


@pytest.mark.parametrize("first", ["base_tilt", "velocity_root_friction"])
def test_what_acts_everywhere_is_held_against_what_acts_at_a_joint_in_that_joints_rows(first: str) -> None:
    session = clean_session(2)
    model = SessionSignals(session, Corrections(session.machine)).refit(())
    tilt, friction = Term(effect("base_tilt"), None, {}), Term(effect("velocity_root_friction"), 1, {"n": 0.5})
    candidates = Candidates(model, [tilt, friction], [1, 1])
    count = len(candidates.scores(model)[0].values)
    shown = [candidates.shown(model, 0, np.eye(count)[k])[1] for k in range(count)]
    expected = np.array(shown) @ white_columns(model, friction)[0]
    order = ([0], [1]) if first == "base_tilt" else ([1], [0])
    found = candidates.cross_products(model, *order)
    assert (found if first == "base_tilt" else found.T) == pytest.approx(expected, rel=1e-9)


def test_what_is_not_alike_is_believed_as_it_is() -> None:
    friction = Term(effect("velocity_root_friction"), 1, {"n": 0.5})
    constant = Term(effect("pressure_offset"), 1, {})
    trust, scores = trust_and_scores(friction, constant)
    scores[0] = drawn(scores[0])
    trust.weigh([[0], [1]], [], scores)
    assert trust.of(0) < 0.5
    assert trust.of(1) > 0.9


def test_of_two_what_both_take_counts_alike_and_the_rest_by_its_own_replicas() -> None:
    """Two friction laws that gain as much alone: what the second takes beside the first is least squares' answer."""
    terms = [Term(effect("velocity_root_friction"), 1, {"n": 0.15}), Term(effect("quadratic_loss"), 1, {})]
    trust, scores = trust_and_scores(*terms)
    shown = np.column_stack([trust.candidates.shown(trust.model, n, scores[n].values)[1] for n in (0, 1)])
    shown /= np.linalg.norm(shown, axis=0)
    target = np.linalg.pinv(shown.T) @ np.full(2, np.sqrt(200.0))  # either takes 200 of it alone, both together all
    beside = float(target @ target) - 200.0
    assert 10.0 < beside < 190.0
    scores[0] = drawn(scores[0])
    trust.weigh([[0], [1]], [], scores)
    assert trust.of(0) < 0.5
    assert 200.0 * trust.of(1) == pytest.approx((200.0 - beside) * trust.of(0) + beside, rel=1e-3)


@pytest.mark.parametrize(("odds", "expected"), [(OPEN + 1.0, [(3, 0)]), (OPEN - 1.0, [(3, 0), (15, 3)])])
def test_all_replicas_are_drawn_of_what_they_may_still_decide(odds: float, expected: list[tuple[int, int]]) -> None:
    trust, scores = trust_and_scores(Term(effect("velocity_root_friction"), 1, {"n": 0.5}))
    asked = []

    class Replicas(SessionSignals):
        def nulls(self, model: Model, terms: Sequence[Term], draws: int, first: int = 0) -> list[Null | None]:
            asked.append((draws, first))
            return [drawn(scores[0]).null for _ in terms]

    session = clean_session(2)
    draws = Draws(Replicas(session, Corrections(session.machine)), 18)
    rated = Rated(scores[0], odds, odds, odds, 0.0)
    while draws.open(rated):
        rated = replace(rated, score=draws.unbiased(trust.model, [rated])[0])
    assert asked == expected and rated.score.null is not None
    again = replace(
        rated, score=scores[0]
    )  # beside another model: what is known of its noise is taken off, no more drawn
    assert draws.open(again)
    assert draws.unbiased(trust.model, [again])[0].gain == pytest.approx(rated.score.gain) and asked == expected
