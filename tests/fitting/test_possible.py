"""Physically consistent parameters: links that can exist, at a price that is said."""

from __future__ import annotations

import numpy as np
import pytest
from arm_examples import chain, physical_links, planar_arm, puma_560, standard_parameters

from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.dynamics import standard_of_link
from fitting.arm.geometry import Geometry
from fitting.estimators import StageTwo, within
from fitting.estimators.possible import PossibleFit
from fitting.estimators.wls import WeightedLeastSquares
from fitting.regression.body_prior import pseudo_inertia


def rows(arm: Geometry, beta: np.ndarray, noise: float, seed: int, samples: int = 150) -> tuple[np.ndarray, ...]:
    """Regressor, efforts and groups of a random motion of an arm with base parameters ``beta``."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-1.5, 1.5, (3, samples, arm.joints))
    Y = base_regressor(arm, reduce_parameters(arm), q, qd, qdd)
    A = Y.transpose(1, 0, 2).reshape(-1, Y.shape[2])
    return A, A @ beta + noise * rng.standard_normal(len(A)), np.repeat(np.arange(arm.joints), samples)


def possible(arm: Geometry) -> PossibleFit:
    estimator = within(PossibleFit(), StageTwo(arm, reduce_parameters(arm), "white"))
    assert isinstance(estimator, PossibleFit)
    return estimator


# --- pseudo-inertia -----------------------------------------------------------------------------------------------


def test_the_pseudo_inertia_is_the_second_moment_of_mass() -> None:
    rng = np.random.default_rng(1)
    m, points = rng.uniform(0.1, 2.0, 12), rng.uniform(-0.5, 0.5, (12, 3))
    homogeneous = np.column_stack([points, np.ones(12)])
    centre = m @ points / m.sum()
    r = points - centre
    central = np.einsum("k,kab->ab", m, np.einsum("ka,ka->k", r, r)[:, None, None] * np.eye(3)) - (m * r.T) @ r
    link = standard_of_link(m.sum(), centre, central)
    assert pseudo_inertia(link) == pytest.approx((m * homogeneous.T) @ homogeneous, abs=1e-12)


def test_links_from_drawings_are_those_of_the_dynamics() -> None:
    masses, centres, inertias = physical_links(3, np.random.default_rng(2))
    expected = standard_parameters(masses, centres, inertias)
    for i in range(3):
        link = standard_of_link(masses[i], centres[i], inertias[i])
        assert link == pytest.approx(expected[i], rel=1e-12)


# --- the fit ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("arm", [planar_arm(3), puma_560()], ids=["planar", "puma"])
def test_where_least_squares_is_consistent_already_nothing_changes(arm: Geometry) -> None:
    pi = standard_parameters(*physical_links(arm.joints, np.random.default_rng(3)))
    base = reduce_parameters(arm)
    A, b, groups = rows(arm, base.from_standard(pi), 0.01, 4)
    free = WeightedLeastSquares().fit(A, b, groups=groups)
    held = possible(arm).fit(A, b, groups=groups)
    assert np.abs((held.theta - free.theta) / free.std).max() < 0.05
    assert held.details["chi_square_price"] < 0.01
    found = np.array([held.details["standard_parameters"][name] for name in base.standard_names])
    # The standard parameters are a body's, and regroup to what was found.
    assert base.from_standard(found) == pytest.approx(held.theta, rel=1e-9)
    assert min(np.linalg.eigvalsh(pseudo_inertia(link)).min() for link in found.reshape(-1, 10)) > 0
    assert held.details["smallest_eigenvalue"] > 0


def test_noise_that_makes_an_inertia_negative_is_held_at_its_price() -> None:
    # One joint that turns about the vertical: its only base parameter is the inertia about the axis.
    arm = chain("R", [0.0], [0.5], [0.0], [0.0, 0.0, -9.81])
    base = reduce_parameters(arm)
    assert base.names == ("ZZ1",)
    rng = np.random.default_rng(5)
    qdd = rng.uniform(-1, 1, (200, 1))
    b = -0.3 * qdd[:, 0] + 0.05 * rng.standard_normal(200)  # an inertia of -0.3 kg m^2: the sensor's sign is wrong
    free = WeightedLeastSquares().fit(qdd, b)
    held = possible(arm).fit(qdd, b)
    assert free.theta[0] < -0.25
    assert 0 < held.theta[0] < 0.02
    # The only consistent neighbour is zero: the price is the squared distance in deviations.
    assert held.details["chi_square_price"] == pytest.approx((free.theta[0] / free.std[0]) ** 2, rel=0.05)
    assert held.details["moved_sigmas"]["ZZ1"] == pytest.approx(-free.theta[0] / free.std[0], rel=0.05)
    assert held.details["error_rise_percent"][0] > 10


@pytest.mark.parametrize("seed", range(3))
def test_strong_noise_on_a_light_tip_still_gives_links_that_exist(seed: int) -> None:
    arm = planar_arm(3)
    pi = standard_parameters(*physical_links(3, np.random.default_rng(6)))
    pi[2] *= 0.01  # a tip so light that noise decides on its parameters
    base = reduce_parameters(arm)
    truth = base.from_standard(pi)
    A, b, groups = rows(arm, truth, 3.0, 7 + seed)
    held = possible(arm).fit(A, b, groups=groups)
    free = WeightedLeastSquares().fit(A, b, groups=groups)
    assert held.details["smallest_eigenvalue"] > 0
    # The truth is consistent, so the nearest consistent point to the rows is not farther from them than the truth.
    scale = np.sqrt(np.diag(free.covariance))
    information = np.linalg.inv(free.covariance / np.outer(scale, scale))
    away = (truth - free.theta) / scale
    assert -1e-6 <= held.details["chi_square_price"] <= float(away @ information @ away) + 0.2


def test_columns_of_another_arm_are_refused() -> None:
    with pytest.raises(ValueError, match="base parameters, the regressor has 2 columns"):
        possible(planar_arm(2)).fit(np.eye(4)[:, :2], np.ones(4))
