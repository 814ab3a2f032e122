"""Evidence of terms, beside the marginal likelihood that scipy computes from the whole covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from fitting.regression.solving import inverse_root
from fitting.selection import priors
from fitting.selection.evidence import (
    DEAD,
    curve_evidence,
    curve_roots,
    formula_gains,
    joint_evidence,
    least_gain,
    log_mean,
    log_sum,
    named_evidence,
)

ROWS = 60


def problem(seed: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Whitened columns with a base projected out, the residual, and their Gram quantities."""
    rng = np.random.default_rng(seed)
    base, _ = np.linalg.qr(rng.normal(size=(ROWS, 3)))
    columns = rng.normal(size=(ROWS, width)) * rng.uniform(0.1, 3.0, width)
    columns -= base @ (base.T @ columns)
    residual = columns @ rng.normal(size=width) + rng.normal(size=ROWS)
    residual -= base @ (base.T @ residual)
    return columns, residual, columns.T @ columns, columns.T @ residual


def log_bayes(columns: np.ndarray, residual: np.ndarray, covariance: np.ndarray) -> float:
    """Log Bayes factor from the densities of the rows themselves, with and without the term."""
    with_term = np.eye(ROWS) + columns @ covariance @ columns.T
    zero = np.zeros(ROWS)
    first = multivariate_normal(zero, with_term).logpdf(residual)
    return float(first - multivariate_normal(zero, np.eye(ROWS)).logpdf(residual))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), width=st.integers(1, 4), amplitude=st.floats(0.5, 100.0))
def test_a_named_effect_has_the_marginal_likelihood_of_zellners_prior(seed: int, width: int, amplitude: float) -> None:
    columns, residual, gram, products = problem(seed, width)
    gain = float(products @ np.linalg.solve(gram, products))
    found = named_evidence(np.array([gain]), np.array([float(width)]), np.array([amplitude]))
    prior = amplitude**2 / width * np.linalg.inv(gram)
    assert found[0, 0] == pytest.approx(log_bayes(columns, residual, prior), rel=1e-6, abs=1e-6)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), amplitude=st.floats(0.5, 50.0))
def test_a_curve_has_the_marginal_likelihood_of_its_coefficients_prior(seed: int, amplitude: float) -> None:
    columns, residual, gram, products = problem(seed, 8)
    roots = curve_roots(8, priors.LENGTHS)
    found = curve_evidence(gram[None], products[None], roots, np.array([amplitude]))[0, :, 0]
    for number, root in enumerate(roots):
        prior = root @ root.T
        prior = prior * amplitude**2 / np.trace(root.T @ gram @ root)
        assert found[number] == pytest.approx(log_bayes(columns, residual, prior), rel=1e-5, abs=1e-5)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_joint_evidence_with_independent_priors_is_the_log_bayes_factor(seed: int) -> None:
    columns, residual, gram, products = problem(seed, 5)
    scales = np.random.default_rng(seed).uniform(0.1, 5.0, size=(3, 5))
    for own, found in zip(scales, joint_evidence(gram, products, scales)[0], strict=True):
        assert found == pytest.approx(log_bayes(columns, residual, np.diag(own**2)), rel=1e-6, abs=1e-6)


def test_what_the_base_takes_whole_says_nothing() -> None:
    """A dead direction holds rounding only, whatever its prior."""
    gram = np.diag([4.0, 1e-13])
    found = joint_evidence(gram, np.array([3.0, 1e-7]), np.array([[1.0, 1e4], [1.0, 0.0]]))[0]
    assert found[0] == pytest.approx(found[1], abs=1e-4)
    assert inverse_root(np.array([[4.0, 0.0], [0.0, 9.0]])).shape == (2, 2)


@pytest.mark.parametrize("rounding", [-3e-13, 0.0, -1e-290])
def test_rounding_of_either_sign_is_no_direction(rounding: float) -> None:
    """Beside others it may be larger than its own square, whatever that is."""
    gram = np.array([[4.0, 2e-13], [2e-13, rounding]])
    assert inverse_root(gram, DEAD) == pytest.approx(np.array([[0.5], [0.0]]))
    both = np.eye(2)[None, None]
    gains, live = formula_gains(gram[None], np.array([[6.0, 1e-7]]), both)
    assert gains[0, 0] == pytest.approx(9.0) and live[0, 0] == 1


def test_a_wider_prior_pays_by_its_width() -> None:
    """Noise alone speaks against a term, and the more so the larger it could be."""
    found = named_evidence(np.array([1.0]), np.array([1.0]), np.array([3.0, 30.0, 300.0]))[0]
    assert np.all(np.diff(found) < -2.0) and found[0] < 0


def test_sums_of_exponentials_neither_overflow_nor_vanish() -> None:
    values = np.array([[1000.0, 1000.0], [-1000.0, -1001.0]])
    assert log_sum(values) == pytest.approx([1000.0 + np.log(2.0), -1000.0 + np.log1p(np.exp(-1.0))])
    assert log_mean(values) == pytest.approx(log_sum(values) - np.log(2.0))
    assert log_sum([0.0, 5.0], weights=[1.0, 0.0]) == pytest.approx(0.0)


def test_what_it_takes_to_be_said_grows_with_parameters_and_choices() -> None:
    assert 20.0 < least_gain(1) < 35.0
    assert least_gain(1) < least_gain(2) < least_gain(4)
    assert least_gain(1, 100) == pytest.approx(least_gain(1) + 2.0 * np.log(100), rel=0.1)


def test_the_mean_of_a_curve_is_as_uncertain_as_its_course() -> None:
    for root in curve_roots(16, priors.LENGTHS):
        covariance = root @ root.T
        mean = np.full(16, 1.0 / 16)
        course = np.trace(covariance) / 16 - mean @ covariance @ mean
        assert mean @ covariance @ mean == pytest.approx(course, rel=0.1)


def test_what_a_part_of_the_parameters_contributes_is_measured_where_it_shows() -> None:
    """With a wide prior the posterior mean is the least-squares fit."""
    columns, residual, gram, products = problem(3, 4)
    (_, shown, _) = joint_evidence(gram, products, np.full((1, 4), 1e4), 2)
    fit = np.linalg.lstsq(columns, residual, rcond=None)[0]
    assert shown[0] == pytest.approx(np.linalg.norm(columns[:, 2:] @ fit[2:]), rel=1e-4)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_formula_gains_what_a_least_squares_fit_of_its_curve_takes(seed: int) -> None:
    columns, residual, gram, products = problem(seed, 8)
    rng = np.random.default_rng(seed)
    curves = rng.normal(size=(3, 8, 2))
    curves[0, :, 1] = 0.0  # one amplitude
    curves[2, :, 1] = 2.0 * curves[2, :, 0]  # twice the same one
    gains, live = formula_gains(gram[None], products[None], curves[None])
    assert live.tolist() == [[1, 2, 1]]
    for curve, gain in zip(curves, gains[0], strict=True):
        shown = columns @ curve
        left = residual - shown @ np.linalg.lstsq(shown, residual, rcond=None)[0]
        assert gain == pytest.approx(residual @ residual - left @ left, rel=1e-6, abs=1e-6)
