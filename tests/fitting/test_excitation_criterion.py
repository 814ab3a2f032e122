"""Series, criterion and gradients of the search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import driven_arm, random_chain

from fitting.arm.base_parameters import condition_number, reduce_parameters
from fitting.arm.dynamics import rigid_body_regressor
from fitting.excitation.cylinders import _band_value
from fitting.excitation.fourier import fourier_basis, spread_harmonics
from fitting.excitation.limits import HydraulicLimits
from fitting.excitation.objective import condition_of_information, probed_regressor, spectral_objective
from fitting.excitation.problem import ExcitationOptions, pose_problem, random_start
from fitting.excitation.search import STAGES, value_and_gradient

QUICK = ExcitationOptions(seconds=12.0, starts=1, iterations=15, samples=60, harmonics=5)


def error_order(value, gradient, at, direction, steps=(1e-3, 1e-4)):
    """Ratio of central-difference errors for steps a factor ten apart (100 if right), and the smaller error."""
    slope = float(gradient @ direction)
    errors = [
        abs((value(at + h * direction) - value(at - h * direction)) / (2 * h) - slope) / abs(slope) for h in steps
    ]
    return errors[0] / errors[1], errors[1]


def test_series_start_and_end_at_rest_and_derivatives_fit():
    time = np.linspace(0, 10, 5001)
    basis = fourier_basis((1, 3, 4, 7), 10.0, time)
    assert basis.size == 6
    for values in (basis.position, basis.speed, basis.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-10)
    np.testing.assert_allclose(np.gradient(basis.position, time, axis=0)[5:-5], basis.speed[5:-5], atol=1e-4)
    np.testing.assert_allclose(np.gradient(basis.speed, time, axis=0)[5:-5], basis.acceleration[5:-5], atol=1e-3)
    assert np.linalg.matrix_rank(basis.position) == 6


def test_harmonics_stay_in_the_band_and_differ_between_joints():
    sets = [spread_harmonics(6, joint, 4, 30.0, 0.6) for joint in range(4)]
    assert all(1 <= k <= 18 for harmonics in sets for k in harmonics)
    assert sets[:3] == [(1, 4, 7, 10, 13, 16), (1, 4, 7, 10, 13, 16), (2, 5, 8, 11, 14, 17)]
    assert len({spread_harmonics(4, joint, 4, 30.0, 0.6) for joint in range(4)}) == 4
    assert spread_harmonics(6, 0, 4, 4.0, 0.5) == (1, 2)  # where there is no choice, they share


@pytest.mark.parametrize("criterion", ["condition", "determinant"])
def test_spectral_gradient_by_order_of_convergence(criterion):
    rng = np.random.default_rng(0)
    half = rng.normal(size=(30, 6)) @ np.diag([1, 10, 0.1, 1, 1, 1])
    G, direction = half.T @ half, (lambda s: s + s.T)(rng.normal(size=(6, 6))) * 0.01
    _, M = spectral_objective(G, criterion, 6, 0.2)
    ratio, last = error_order(
        lambda g: spectral_objective(g.reshape(6, 6), criterion, 6, 0.2)[0],
        M.ravel(),
        G.ravel(),
        direction.ravel(),
        (1.0, 0.1),
    )
    assert 80 < ratio < 120
    assert last < 1e-3


def test_smooth_condition_number_bounds_the_true_one_and_approaches_it():
    rng = np.random.default_rng(1)
    half = rng.normal(size=(40, 8))
    true = np.log(condition_number(half))
    values = [spectral_objective(half.T @ half, "condition", power)[0] for power in (2, 8, 64)]
    assert values[0] > values[1] > values[2] > true
    assert values[2] == pytest.approx(true, abs=0.05)
    assert condition_of_information(half.T @ half) == pytest.approx(condition_number(half), rel=1e-9)


def test_condition_of_information_without_full_rank_is_infinite():
    assert condition_of_information(np.diag([1.0, 0.0])) == np.inf
    assert condition_of_information(np.ones((2, 2))) == np.inf


def test_gradient_of_the_regressor_matches_changed_states():
    arm = random_chain("RPRR", np.random.default_rng(2))
    rng = np.random.default_rng(3)
    columns = np.array([0, 9, 11, 25, 39])
    state = rng.uniform(-1, 1, (3, 7, 4))
    weight = rng.normal(size=(7, 4, 5))
    moved = np.array([0, 1, 3])
    probed = probed_regressor(arm, columns, *state, moved)
    np.testing.assert_allclose(probed.Y, rigid_body_regressor(arm, *state, columns=columns), atol=1e-12)
    found = probed.gradient(weight)
    for signal in range(3):
        for place, joint in enumerate(moved):
            direction = np.zeros((3, 7, 4))
            direction[signal, :, joint] = rng.normal(size=7)
            h = 1e-4
            ends = [
                (rigid_body_regressor(arm, *(state + s * h * direction), columns=columns) * weight).sum()
                for s in (1, -1)
            ]
            expected = (ends[0] - ends[1]) / (2 * h)
            assert found[signal][:, place] @ direction[signal, :, joint] == pytest.approx(expected, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("coupled", [False, True], ids=["kinematic limits", "flow and pressure"])
def test_gradient_of_the_search_by_order_of_convergence(coupled):
    machine = driven_arm(3)
    base = reduce_parameters(machine)
    hydraulic = HydraulicLimits()
    if coupled:
        # So tight that both penalties act.
        guess = np.array([20.0, 30.0, 1.0, 10.0, 20.0, 1.0, 3.0, 8.0, 1.0])
        hydraulic = HydraulicLimits(flow=2e-4, pressure=1e6, back_pressure=1e5, base_parameters=guess)
    rng = np.random.default_rng(4)
    problem = pose_problem(machine, base, QUICK, None, None, hydraulic, rng)
    at = random_start(problem, rng)
    value, gradient = value_and_gradient(problem, at, STAGES[0])
    if coupled:
        free = replace(problem, hydraulic=replace(hydraulic, flow=1.0, pressure=1e9))
        assert value > value_and_gradient(free, at, STAGES[0])[0] + 0.1
    ratio, last = error_order(
        lambda c: value_and_gradient(problem, c, STAGES[0], want_gradient=False)[0],
        gradient,
        at,
        rng.normal(size=at.size),
    )
    # Penalties have kinks in their second derivative, so the order is only roughly two there.
    assert (30 if coupled else 80) < ratio < 300
    assert last < 1e-4


def test_gradient_of_the_band_limited_signal():
    basis = fourier_basis((1, 2, 5, 9), 20.0, (np.arange(90) + 0.5) * 20 / 90)
    stack = np.vstack([basis.position, basis.speed, basis.acceleration])
    scale = np.repeat([0.1, 0.12, 0.4], 90)
    rng = np.random.default_rng(5)
    at, direction = rng.normal(size=(2, basis.size))
    gradient = _band_value(at, stack, scale, 0.15, 0.12)[1]
    ratio, last = error_order(lambda c: _band_value(c, stack, scale, 0.15, 0.12)[0], gradient, at, direction)
    assert 60 < ratio < 150
    assert last < 1e-5
