"""What is physically impossible is named, and what is possible is not: against cvxpy, and on parameters made wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import link_map
from synthetic_arm import clean_session, make_session, planar_machine, truth

from fitting.pipeline.plausibility import _nearest, physics, plausibility
from fitting.pipeline.results.stage_results import Physics
from fitting.residual.friction_power import friction_power
from fitting.residual.terms import Model


def with_negative_inertia(model: Model) -> tuple[Model, int]:
    """The last link's inertia about its own joint below zero by thirty deviations, and where its parameter is.

    About the joint it is ``ZZ + 2 a MX + a^2 m``, of the base parameters ``(ZZ - a^2 m) + 2 a (MX + a m)``.
    """
    part, base = model.design.parameters.base_slice, model.design.parameters.base
    inertia, moment = (part.start + base.names.index(name) for name in ("ZZ2", "MX2"))
    wrong = changed(model)
    wrong.fit.theta[inertia] = -2 * 0.65 * wrong.fit.theta[moment] - 30.0 * model.fit.std[inertia]
    return wrong, inertia


@pytest.fixture(scope="module")
def model() -> Model:
    return clean_session().weighted_base.model


def changed(model: Model, **values: float) -> Model:
    """The model with some parameters changed, by name with ``__`` for the dot; deviations stay."""
    names, theta = model.design.parameters.names, model.fit.theta.copy()
    for name, value in values.items():
        theta[names.index(name.replace("__", "."))] = value
    return replace(model, fit=replace(model.fit, theta=theta))


def test_a_healthy_arm_is_possible(model: Model) -> None:
    found = plausibility(model)
    assert found.violations == ()
    assert found.theta is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_healthy_arms_are_possible_whatever_the_noise(seed: int) -> None:
    session = make_session(planar_machine(2), truth(2, seed=20 + seed), seed=seed, seconds=30.0)
    assert plausibility(session.weighted_base.model).violations == ()


def test_the_true_parameters_are_at_no_distance(model: Model) -> None:
    own = truth(2).theta(model.design.machine)
    exact = replace(model, fit=replace(model.fit, theta=own))
    theta, distance, _ = _nearest(exact, whole=False)
    assert distance < 1e-3
    assert theta == pytest.approx(own, rel=1e-3, abs=1e-3)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")  # to its own eight digits; two per cent are asked
def test_the_distance_is_that_of_a_semidefinite_program(model: Model) -> None:
    """Two solvers for one convex problem: cvxpy with the matrix inequality, and the generated cones."""
    cp = pytest.importorskip("cvxpy")

    wrong, _ = with_negative_inertia(model)
    part, base = model.design.parameters.base_slice, model.design.parameters.base
    _, distance, count = _nearest(wrong, whole=False)
    S = model.fit.covariance[part, part]
    size = np.sqrt(np.diag(S))
    root = np.linalg.inv(np.linalg.cholesky(S / np.outer(size, size)))
    links = [cp.Variable((4, 4), PSD=True) for _ in range(2)]
    pi = cp.hstack([link_map(np.eye(4)) @ cp.vec(J, order="C") for J in links])
    value = (base.regrouping / size[:, None]) @ pi - wrong.fit.theta[part] / size
    problem = cp.Problem(cp.Minimize(cp.sum_squares(root @ value)))
    problem.solve(solver=cp.CLARABEL)
    assert count == len(base)
    assert distance == pytest.approx(problem.value, rel=0.02)
    assert distance > 100.0


def test_a_negative_stiffness_is_named_with_its_cause(model: Model) -> None:
    found = plausibility(changed(model, joint1__K=-800.0))
    worst = found.violations[0]
    assert (worst.kind, worst.joint, worst.parameter, worst.unit) == ("drive", "joint1", "K", "N/m")
    assert worst.value == -800.0
    assert worst.possible == pytest.approx(0.0, abs=1e-6)
    assert "gravity" in worst.cause


def test_friction_that_drives_is_named_though_each_coefficient_might_do(model: Model) -> None:
    found = plausibility(changed(model, joint2__f_c=-90.0, joint2__f_s=-10.0))
    assert [v.kind for v in found.violations] == ["friction"]
    assert found.violations[0].joint == "joint2"
    assert found.theta is not None
    power = friction_power(model, 1)
    assert np.all(power.force(found.theta) > -1e-3 * np.abs(power.force(model.fit.theta)).max())


def test_a_negative_coefficient_is_allowed_where_the_whole_curve_opposes_the_motion(model: Model) -> None:
    names = model.design.parameters.names
    strong = model.fit.theta[names.index("joint1.f_c")]
    assert plausibility(changed(model, joint1__f_v=-0.5 * strong)).violations == ()


def test_the_friction_curve_is_the_mean_over_its_bins(model: Model) -> None:
    power = friction_power(model, 0)
    own = truth(2).drive[0]
    expected = own[2] + own[3] * power.speed + own[4] * power.speed ** (1 / 3) + 150.0 * power.speed
    assert power.force(model.fit.theta) == pytest.approx(expected, rel=0.15)
    assert np.all(power.std(model.fit.covariance) < 0.2 * expected)


def test_a_link_that_no_body_can_be_is_named(model: Model) -> None:
    wrong, place = with_negative_inertia(model)
    found = plausibility(wrong)
    assert {v.kind for v in found.violations} == {"link"}
    assert found.violations[0].sigmas > 5.0
    assert found.theta is not None
    assert found.theta[place] > wrong.fit.theta[place]


def test_the_constrained_fit_stands_beside_with_its_price(model: Model) -> None:
    wrong = changed(model, joint1__K=-800.0)
    said = physics(wrong.design, wrong)
    assert said.constrained is not None
    assert len(said.constrained.theta) == len(wrong.fit.theta)
    assert set(said.constrained.price_percent) == {"train", "validate"}
    assert set(said.constrained.errors) >= {"train", "validate", "validate_rms"}
    assert said.violations[0]["text"] == "the stiffness of joint1 is negative"
    assert physics(model.design, model) == Physics()
