"""Replicas of the recordings: what a candidate is worth where there is nothing to find."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import clean_session

from fitting.effects import effect
from fitting.loop.refits import SessionSignals
from fitting.residual.confirmation.confirmation import misfit
from fitting.residual.null import BIAS_SHARE, PRIOR_DRAWS, USUAL_INFLATION, Null, resampled
from fitting.residual.scoring import score_terms
from fitting.residual.terms import Term
from fitting.signals.corrections import Corrections


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), length=st.integers(50, 4000))
def test_resampled_noise_keeps_its_variance_and_what_joints_share(seed: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    stretch = rng.standard_normal((3000, 1)) * np.array([[1.0, -2.0]])
    noise = resampled([stretch], length, 50.0, rng)
    assert noise.shape == (length, 2)
    assert np.allclose(noise[:, 1], -2.0 * noise[:, 0])
    if length > 1000:
        assert np.std(noise[:, 0]) == pytest.approx(1.0, abs=0.15)


def test_a_bias_that_draws_agree_on_is_taken_off_and_scatter_is_not() -> None:
    rng = np.random.default_rng(0)
    information = np.array([[4.0]])  # a standard deviation of one half
    scatter = Null(0.5 * rng.standard_normal((6, 1)), information, 1)
    assert abs(scatter.bias[0]) < 0.2  # shrunk towards nothing
    biased = Null(-5.0 + 0.5 * rng.standard_normal((6, 1)), information, 1)
    assert biased.bias[0] == pytest.approx(-5.0, abs=0.5)
    # Any share of a bias of ten standard deviations may be there: values up to it weigh little.
    for inside in (-1.0, -3.0, -4.5):
        assert biased.weight(np.array([inside]), information) < 6.0
    # Beyond either end: the distance squared, and what little of the prior is as near as that end.
    assert 16.0 < biased.weight(np.array([2.0]), information) < 16.0 + 2 * np.log(10 * 4) + 1.0
    assert biased.weight(biased.bias - 3.0, information) == pytest.approx(36.0 + 2 * np.log(10 * 6), rel=0.2)
    assert scatter.weight(np.array([2.0]), information) > 2.0**2 * 4.0 / 2


def test_inflation_is_that_of_the_draws_joined_with_what_is_usual() -> None:
    def scattered(variance: float, draws: int) -> float:
        values = np.resize([1.0, -1.0], draws) * np.sqrt(variance * (draws - 1) / draws)
        return Null(values[:, None], np.array([[1.0]]), 1).inflation

    assert scattered(2.0, 4) == pytest.approx((6.0 + PRIOR_DRAWS * USUAL_INFLATION) / (3 + PRIOR_DRAWS), rel=0.05)
    assert scattered(0.01, 100) == 1.0
    assert scattered(4.0, 4) < 1.7 and scattered(4.0, 1000) == pytest.approx(4.0, rel=0.01)
    assert scattered(15.0, 18) == pytest.approx(15.0, rel=0.01)  # nothing usual makes so much
    null = Null(np.array([[3.0], [-3.0]]), np.array([[1.0]]), 1)
    assert null.joined(null).draws == 4


def test_noise_along_what_was_found_is_that_of_a_single_parameter_in_any_number_of_columns() -> None:
    rng = np.random.default_rng(1)
    slow, white = 3.0 * rng.standard_normal(96), rng.standard_normal((96, 7))
    slow, white = slow - slow.mean(), white - white.mean(axis=0)
    information = np.eye(8)
    many = Null(np.column_stack([slow, white]), information, 8)
    one = Null(slow[:, None], np.eye(1), 1)
    along = np.r_[5.0, np.zeros(7)]
    assert many.inflation < 0.6 * one.inflation  # seven quiet directions hide the loud one
    assert many.inflation_along(along) == pytest.approx(one.inflation_along(np.array([2.0])))
    assert one.inflation_along(np.array([-7.0])) == pytest.approx(one.inflation)
    # So a curve whose constant is all that it shows weighs no more than the constant itself.
    assert many.weight(along, information) <= one.weight(np.array([5.0]), np.eye(1)) * (1 + 1e-9)
    assert many.inflation_along(np.zeros(8)) == many.inflation


def test_a_score_against_its_null_has_the_bias_taken_off() -> None:
    model = clean_session(2).base_model  # an offset may have either sign: no bound holds it at zero
    (score,) = score_terms(model, [Term(effect("pressure_offset"), 1)], [1])
    off = 3.0 * score.stds[0]
    bias = score.values[0] - off if abs(score.values[0] - off) > off else score.values[0] + off
    null = Null(np.full((5, 1), bias), score.information, 1)
    unbiased = score.against(null)
    assert unbiased.values[0] == pytest.approx(score.values[0] - BIAS_SHARE * null.bias[0])
    assert unbiased.fitted[0] == pytest.approx(score.values[0])
    assert unbiased.gain == pytest.approx((unbiased.values[0] / score.stds[0]) ** 2, rel=1e-6)
    # More replicas replace what the first ones took off, also where they show less than would be taken off.
    for more in (null, Null(np.zeros((18, 1)), score.information, 1)):
        once, twice = score.against(more), unbiased.against(more)
        assert twice.taken == once.taken and twice.gain == pytest.approx(once.gain)
        assert twice.fitted == pytest.approx(score.values)


@pytest.mark.slow
def test_replicas_of_a_clean_arm_scatter_as_the_theory_says() -> None:
    """Values of a friction term on replicas: mean near zero, spread near its standard deviation; repeatable."""
    session = clean_session(2)
    signals = SessionSignals(session, Corrections(session.machine))
    model = session.base_model
    term = Term(effect("position_dependent_friction"), 1)
    (score,) = score_terms(model, [term], [1])
    (null,) = signals.nulls(model, [term], 5)
    assert null is not None and null.values.shape == (5, len(score.values))
    assert null.inflation < 3.0
    assert np.all(np.abs(null.values.mean(axis=0)) < 3.0 * np.asarray(score.stds))
    (again,) = signals.nulls(model, [term], 2, first=3)
    assert again is not None
    assert np.allclose(again.values, null.values[3:], rtol=1e-9)


def test_two_runs_share_nothing_where_nothing_is_missing() -> None:
    session = clean_session(2)
    for joint in range(2):
        assert abs(misfit(session.base_model, session.plain.pairs, joint).z) < 4.0
        assert misfit(session.base_model, (), joint).z == 0.0


@pytest.mark.slow
def test_replicas_of_the_next_model_have_the_same_motion_and_are_drawn_as_by_themselves() -> None:
    session = clean_session(2)
    plain, late = Term(effect("load_dependent_friction"), 1), Term(effect("sensor_latency"), 0)
    asked = [Term(effect("hose_stiffness"), 1), Term(effect("structural_flexibility"), 0)]
    in_turn = SessionSignals(session, Corrections(session.machine))
    for terms in ((), (plain,), (plain, late)):
        alone = SessionSignals(session, Corrections(session.machine))
        model = in_turn.refit(terms)
        for one, two in zip(in_turn.nulls(model, asked, 2), alone.nulls(alone.refit(terms), asked, 2), strict=True):
            assert one is not None
            assert two is not None
            # A filter over one column and one over many differ by rounding.
            np.testing.assert_allclose(one.values, two.values, rtol=1e-5, atol=1e-7 * np.abs(two.values).max())
            np.testing.assert_allclose(one.information, two.information, rtol=1e-5)
