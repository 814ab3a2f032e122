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


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    "first", [Term(effect("base_tilt"), None, {}), Term(effect("hose_stiffness"), 0, {})], ids=["everywhere", "joint"]
)
def test_what_acts_elsewhere_has_in_common_what_least_squares_says(first: Term, turned: bool) -> None:
    """What acts at another joint as well: there by way of the base, which makes up for a part of either."""
    session = clean_session(2)
    model = SessionSignals(session, Corrections(session.machine)).refit(())
    terms = [first, Term(effect("gas_spring"), 1, {"side": 1.0, "rest": 0.2, "n": 1.2})]
    candidates = Candidates(model, terms, [1, 1])
    scores = candidates.scores(model)
    basis, ends = np.vstack(model.fit.orthonormal), np.cumsum([0, *map(len, model.fit.residual)])
    shown = []
    for number, term in enumerate(terms):
        values, whole = np.asarray(scores[number].values), np.zeros(ends[-1])
        if term.joint is None:
            whole = np.concatenate(list(candidates.shown(model, number, values).values()))
        else:
            whole[ends[term.joint] : ends[term.joint + 1]] = white_columns(model, term)[0] @ values
        shown.append(whole - basis @ (basis.T @ whole))
    order = (1, 0) if turned else (0, 1)
    u, v = (shown[n] / np.linalg.norm(shown[n]) for n in order)
    x, y = (np.sqrt(float(scores[n].fitted @ scores[n].information @ scores[n].fitted)) for n in order)
    both = np.column_stack([u, v])
    target = np.linalg.pinv(both.T) @ np.array([x, y])
    expected = 1.0 - (float(target @ target) - x**2) / y**2
    found = Trust(candidates, model).common([order[0]], [order[1]], scores)
    assert abs(float(u @ v)) > 1e-3
    assert found[0, 0] == pytest.approx(np.clip(expected, 0.0, 1.0), rel=1e-6, abs=1e-9)


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
