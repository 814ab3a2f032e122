"""The generalised least squares behind both stages, against dense matrices with the covariance written out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg, signal
from synthetic_arm import clean_session, exact_design, force, make_motion, planar_machine, truth

from fitting.regression.design import (
    REST_SHARE,
    Extra,
    NoiseModel,
    effort_errors,
    full_residual,
    moving_rows,
    predicted_effort,
    white_noise_model,
    whitened,
)
from fitting.regression.solving import WhiteRows, solve
from fitting.signals.filters import filter_bank
from fitting.signals.spectrum import Whitening

PHI, SIGMA = 0.7, 2.5


def ar1(rng: np.random.Generator, rows: int) -> np.ndarray:
    """Stationary first-order noise with innovation SIGMA."""
    start = rng.normal() * SIGMA / np.sqrt(1 - PHI**2)
    return signal.lfilter([1.0], [1.0, -PHI], rng.normal(size=rows) * SIGMA, zi=[PHI * start])[0]


def model() -> NoiseModel:
    whole = SIGMA / np.sqrt(1 - PHI**2)
    return NoiseModel((Whitening(np.array([1.0, -PHI]), np.array([[SIGMA / whole]]), SIGMA, whole),), True)


def test_whitened_least_squares_is_the_dense_generalised_solution() -> None:
    rng = np.random.default_rng(1)
    A, theta = rng.normal(size=(300, 4)), np.array([1.0, -2.0, 0.5, 3.0])
    b = A @ theta + ar1(rng, 300)
    fit = solve([WhiteRows(model().whitenings[0](A), model().whitenings[0](b), ())])
    # Every row counts, the first ones too: the stationary covariance of all of them.
    C = linalg.toeplitz(SIGMA**2 / (1 - PHI**2) * PHI ** np.arange(300))
    information = A.T @ np.linalg.solve(C, A)
    assert np.allclose(fit.theta, np.linalg.solve(information, A.T @ np.linalg.solve(C, b)), rtol=1e-9)
    assert np.allclose(fit.covariance, np.linalg.inv(information), rtol=1e-9)
    residual = b - A @ fit.theta
    assert fit.chi_square == pytest.approx(residual @ np.linalg.solve(C, residual), rel=1e-9)
    W = np.linalg.inv(np.linalg.cholesky(C)) @ A
    assert fit.condition_number == pytest.approx(np.linalg.cond(W / np.linalg.norm(W, axis=0)), rel=1e-9)


def test_whitening_a_first_order_noise_gives_white_unit_noise() -> None:
    noise = ar1(np.random.default_rng(3), 20_000)
    white = model().whitenings[0](noise)
    assert np.std(white) == pytest.approx(1.0, abs=4 / np.sqrt(2 * len(white)))
    for lag in (1, 2, 5):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 4 / np.sqrt(len(white))


def test_standard_deviations_cover_the_truth() -> None:
    rng = np.random.default_rng(5)
    A, theta = rng.normal(size=(200, 3)), np.array([1.0, 2.0, 3.0])
    distances = []
    for _ in range(200):
        b = A @ theta + ar1(rng, 200)
        fit = solve([WhiteRows(model().whitenings[0](A), model().whitenings[0](b), ())])
        error = fit.theta - theta
        distances.append(error @ np.linalg.solve(fit.covariance, error))
    # Chi-square with 3 degrees of freedom: mean 3, standard error sqrt(6 / 200).
    assert np.mean(distances) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 200))


def test_columns_that_the_rows_cannot_tell_are_reported_not_guessed() -> None:
    rng = np.random.default_rng(6)
    A = rng.normal(size=(100, 3))
    wide = np.column_stack([A, A[:, 0] - 2 * A[:, 1], np.zeros(100)])
    b = A @ [1.0, 2.0, 3.0]
    fit = solve([WhiteRows(wide, b, ())])
    assert fit.determined.sum() == 3 and not fit.determined[4] and fit.determined[2]
    assert np.all(fit.theta[~fit.determined] == 0)
    assert fit.theta[2] == pytest.approx(3.0)
    assert np.allclose(wide @ fit.theta, b)
    assert fit.chi_square < 1e-18


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_units_of_columns_do_not_decide_the_rank(scale: float) -> None:
    rng = np.random.default_rng(7)
    A = rng.normal(size=(50, 2)) * [1.0, scale]
    fit = solve([WhiteRows(A, A @ [2.0, 3.0], ())])
    assert fit.determined.all()
    assert fit.theta == pytest.approx([2.0, 3.0])


def test_residuals_come_back_joint_by_joint() -> None:
    rng = np.random.default_rng(8)
    rows = [WhiteRows(rng.normal(size=(k, 2)), rng.normal(size=k), ()) for k in (30, 50)]
    fit = solve(rows)
    for own, residual, Q in zip(rows, fit.residual, fit.orthonormal, strict=True):
        assert np.allclose(residual, own.b - own.A @ fit.theta)
        assert len(Q) == len(own.b)
    assert np.allclose(sum(Q.T @ r for Q, r in zip(fit.orthonormal, fit.residual, strict=True)), 0, atol=1e-12)


def test_the_design_reproduces_exact_efforts_at_the_true_parameters() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm)
    theta = arm.theta(machine)
    for index, (role, seed) in enumerate((("unloaded", 1), ("train", 2))):
        effort = force(machine, arm, make_motion(machine, role, seed))
        for joint in range(2):
            assert np.allclose(full_residual(design, theta, joint, index), 0, atol=1e-7)
            assert np.allclose(predicted_effort(design, theta, joint, index), effort[:, joint], atol=1e-7)
    # Unloaded rods feel no body, and a joint's rows no other joint's friction.
    assert not np.any(design.blocks[0][0].columns[:, design.parameters.base_slice])
    assert not np.any(design.blocks[0][1].columns[:, design.parameters.drive_slice(1)])
    assert np.any(design.blocks[0][1].columns[:, design.parameters.drive_slice(0)])


def test_efforts_are_judged_in_the_joints_unit_and_not_where_nothing_is_carried() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm)
    theta = arm.theta(machine)
    wrong = theta.copy()
    wrong[design.parameters.names.index("joint2.f_v")] += 10.0
    errors = effort_errors(design, wrong, design.indices("unloaded", "train"))
    motion = make_motion(machine, "train", 2)
    expected = design.bank.reduce(-10.0 * motion.v[:, 1] * motion.r[:, 1])
    assert np.allclose(errors[1], expected, atol=1e-7)
    assert np.allclose(errors[0], 0, atol=1e-6)


def test_extra_columns_are_whitened_like_the_others() -> None:
    machine, arm = planar_machine(2), truth(2)
    design = exact_design(machine, arm)
    own = [np.random.default_rng(i).normal(size=(len(s), 1)) for i, s in enumerate(design.segments)]
    extra = Extra(("e",), (tuple(own), (None,) * len(own)))
    fitted = design.indices("unloaded", "train")
    rows = whitened(design, white_noise_model(2), fitted, extra)
    assert np.allclose(rows[0].A[:, -1], np.concatenate([design.bank.reduce(own[i])[:, 0] for i in fitted]))
    assert not np.any(rows[1].A[:, -1])


def test_whitened_residuals_of_a_noisy_arm_are_standard_normal() -> None:
    fit = clean_session(2).base_model.fit
    freedom = sum(map(len, fit.residual)) - len(fit.theta)
    # The noise model is estimated from one pair of 40 s: its variance is known to some ten per cent.
    assert fit.chi_square / freedom == pytest.approx(1.0, abs=0.25)
    for residual in fit.residual:
        # Above the identification band there is nothing to whiten: four coefficients leave some correlation.
        assert abs(np.mean(residual[1:] * residual[:-1])) < 0.3


@given(st.integers(60, 400), st.integers(20, 300), st.floats(-1.0, 1.0))
def test_friction_at_rest_is_not_in_the_rows_that_are_kept(begin: int, length: int, friction: float) -> None:
    bank = filter_bank(50.0, 3.0)
    rest = np.zeros(800, dtype=bool)
    rest[begin : begin + length] = True
    kept = moving_rows(bank, rest)
    assert np.max(np.abs(bank.reduce(friction * rest))[kept], initial=0.0) <= REST_SHARE
    assert not kept[bank.reduce(rest.astype(float)) > 0.5].any()
    # What is lost beside the rest is shorter than two filters.
    assert np.count_nonzero(~kept) <= (length + 4 * bank.half) / bank.decimation + 1
