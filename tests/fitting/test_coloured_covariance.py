"""Deviations of parameters when residuals hang together in time: what they promise is what happens."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from coloured import hac_covariance
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from fitting.estimators import OrdinaryLeastSquares, covariance
from fitting.estimators.covariance import Colour, autoregression, block_length, residual_draws

Array = npt.NDArray[np.float64]


def ar1(rng: np.random.Generator, n: int, rho: float) -> Array:
    """First-order autoregression of unit variance, stationary from the first sample."""
    w = rng.standard_normal(n) * np.sqrt(1 - rho**2)
    w[0] /= np.sqrt(1 - rho**2)
    return np.asarray(signal.lfilter([1.0], [1.0, -rho], w))


def motion_columns(rng: np.random.Generator, n: int) -> Array:
    """A constant, something slow, a swing and its sign: what a joint's columns look like at 8 Hz."""
    t = np.arange(n) / 8.0
    return np.column_stack([np.ones(n), ar1(rng, n, 0.9), np.sin(0.2 * np.pi * t), np.sign(np.sin(0.46 * np.pi * t))])


def coverage(colour: Colour, rho: float, n: int, draws: int = 300, seed: int = 1) -> Array:
    """Share of 95 % intervals that hold the truth, per column."""
    rng = np.random.default_rng(seed)
    A = motion_columns(rng, n)
    inverse = np.linalg.pinv(A)
    hits = []
    for _ in range(draws):
        e = ar1(rng, n, rho)
        theta = inverse @ e  # the truth is zero
        std = np.sqrt(np.diag(hac_covariance(A, e - A @ theta, colour)))
        hits.append(np.abs(theta) < 1.96 * std)
    return np.asarray(np.mean(hits, axis=0))


@pytest.mark.parametrize("colour", ["hac", "bootstrap"])
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 0.93])
@pytest.mark.slow
def test_ninety_five_percent_intervals_cover_ninety_two_to_ninety_eight(
    colour: Colour, rho: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A quarter of the draws outside tests: intervals that are less certain themselves cover no more.
    monkeypatch.setattr(covariance, "_DRAWS", 100)
    # 300 draws and four columns: the mean is known to 1 %, a single column to 1.3 %.
    shares = coverage(colour, rho, 1500)
    assert 0.92 <= shares.mean() <= 0.98
    assert shares.min() > 0.90


def test_the_textbook_formula_promises_far_too_much() -> None:
    assert coverage("white", 0.8, 600, draws=100).mean() < 0.7


def test_deviations_of_white_residuals_agree_with_the_textbook() -> None:
    rng = np.random.default_rng(2)
    A, e = motion_columns(rng, 4000), rng.standard_normal(4000)
    white, hac, drawn = (np.sqrt(np.diag(hac_covariance(A, e, c))) for c in ("white", "hac", "bootstrap"))
    assert hac == pytest.approx(white, rel=0.1)
    assert drawn == pytest.approx(white, rel=0.15)  # 400 draws leave 3.5 % of chance by themselves


@pytest.mark.slow
def test_the_deviation_of_a_mean_is_the_spectrum_at_zero() -> None:
    # var(mean) = sigma^2 / n (1 + rho) / (1 - rho) for a first-order autoregression of variance sigma^2.
    rho, n = 0.9, 20_000
    e = ar1(np.random.default_rng(3), n, rho)
    theory = np.sqrt((1 + rho) / (1 - rho) / n)
    for colour in ("hac", "bootstrap"):
        assert np.sqrt(hac_covariance(np.ones((n, 1)), e, colour)[0, 0]) == pytest.approx(theory, rel=0.15)


@pytest.mark.slow
def test_hac_knows_residuals_that_grow_with_the_motion_and_the_bootstrap_does_not() -> None:
    rng = np.random.default_rng(4)
    x = rng.standard_normal(4000)
    errors, hac, drawn = [], [], []
    for _ in range(60):
        e = np.abs(x) * rng.standard_normal(4000)
        theta = x @ e / (x @ x)
        errors.append(theta)
        hac.append(np.sqrt(hac_covariance(x[:, None], e - x * theta, "hac")[0, 0]))
        drawn.append(np.sqrt(hac_covariance(x[:, None], e - x * theta, "bootstrap")[0, 0]))
    # E x^4 / (E x^2)^2 = 3: the deviation is sqrt(3) times that of residuals that do not know x.
    assert np.std(errors) / np.mean(hac) == pytest.approx(1.0, abs=0.25)
    assert np.mean(hac) / np.mean(drawn) == pytest.approx(np.sqrt(3), rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_deviations_do_not_depend_on_the_order_of_columns_nor_on_their_basis(seed: int) -> None:
    """Columns of one size are pivoted in an order that rounding decides, another on each processor."""
    rng = np.random.default_rng(seed)
    A = np.column_stack([motion_columns(rng, 300), rng.standard_normal((300, 3))])
    e = ar1(rng, 300, 0.8)
    found = hac_covariance(A, e, "hac")
    order, turn = rng.permutation(A.shape[1]), rng.standard_normal((A.shape[1],) * 2)
    assert hac_covariance(A[:, order], e, "hac") == pytest.approx(found[np.ix_(order, order)], rel=1e-6)
    assert turn @ hac_covariance(A @ turn, e, "hac") @ turn.T == pytest.approx(found, rel=1e-6, abs=1e-9 * found.max())


def test_series_of_several_joints_are_independent_of_one_another() -> None:
    rng = np.random.default_rng(5)
    A, e = rng.standard_normal((200, 2)), ar1(rng, 200, 0.8)
    groups = np.repeat([0, 1], 100)
    order = rng.permutation(2)[groups]  # the same two series under other labels
    assert hac_covariance(A, e, "hac", groups) == pytest.approx(hac_covariance(A, e, "hac", order), rel=1e-9)


@given(st.integers(0, 1000), st.sampled_from(["hac", "bootstrap"]), st.integers(6, 60))
@settings(max_examples=40, deadline=None)
def test_covariances_are_symmetric_and_not_negative(seed: int, colour: Colour, n: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, 3))
    C = hac_covariance(A, rng.standard_normal(n), colour)
    assert np.allclose(C, C.T)
    assert np.linalg.eigvalsh(C).min() >= -1e-12 * np.trace(C)


def test_the_same_rows_give_the_same_deviations() -> None:
    rng = np.random.default_rng(6)
    A, b = rng.standard_normal((80, 2)), rng.standard_normal(80)
    first, second = (OrdinaryLeastSquares(colour="bootstrap").fit(A, b).covariance for _ in range(2))
    assert np.array_equal(first, second)


@pytest.mark.parametrize("colour", ["grey", -3])
def test_what_is_no_colour_is_refused(colour: Colour) -> None:
    with pytest.raises(ValueError, match=r"grey|negative"):
        hac_covariance(np.ones((30, 1)), np.arange(30.0), colour)


# --- parts --------------------------------------------------------------------------------------------------------


def test_burgs_filter_is_the_autoregression_that_made_the_series() -> None:
    rng = np.random.default_rng(7)
    taps = np.array([1.0, -1.2, 0.5])  # roots of modulus 0.71
    e = signal.lfilter([1.0], taps, rng.standard_normal(20_000))
    found = autoregression(e)
    assert found[:3] == pytest.approx(taps, abs=0.03)
    assert np.abs(found[3:]).max(initial=0.0) < 0.03


@given(st.integers(0, 1000), st.integers(20, 200))
@settings(max_examples=40, deadline=None)
def test_the_inverse_of_burgs_filter_never_grows(seed: int, n: int) -> None:
    e = np.cumsum(np.random.default_rng(seed).standard_normal(n))  # a random walk is the hardest
    assert np.abs(np.roots(autoregression(e))).max(initial=0.0) < 1.0


def test_drawn_series_have_the_residuals_colour_and_size() -> None:
    rng = np.random.default_rng(8)
    e = 3.0 * ar1(rng, 3000, 0.8)
    draws = residual_draws(e, 40, rng)
    assert draws.shape == (40, 3000)
    assert draws.std() == pytest.approx(e.std(), rel=0.05)
    neighbours = np.mean(draws[:, 1:] * draws[:, :-1]) / draws.var()
    assert neighbours == pytest.approx(0.8, abs=0.03)
    # Different draws are different.
    assert abs(np.corrcoef(draws[0], draws[1])[0, 1]) < 0.2


def test_blocks_grow_with_the_colour_and_with_the_length() -> None:
    rng = np.random.default_rng(9)
    white, coloured = rng.standard_normal(4000), ar1(rng, 4000, 0.8)
    assert block_length(white) <= 17 < block_length(coloured)
    assert block_length(coloured[:300]) < block_length(coloured)
    assert block_length(np.zeros(27)) == 3
