"""Least squares of joint efforts: against numpy on the stacked rows, and what its uncertainty promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import clean_session

from fitting.estimators.effort_fit import EffortRows, mean_levers, noise_variance, parameter_error
from fitting.regression.design import effort_errors
from fitting.regression.prior import Prior

NOTHING = Prior(np.full(2, np.nan), np.full(2, np.nan))


def stacked(rows: EffortRows) -> list[tuple[np.ndarray, np.ndarray]]:
    """Columns and target of each joint, all segments in a row."""
    joints = range(len(rows.rows))
    return [
        tuple(np.concatenate(part) for part in zip(*rows.parts(joint), strict=True))  # type: ignore[misc]
        for joint in joints
    ]


@pytest.fixture(scope="module")
def rows() -> EffortRows:
    plain = clean_session().plain
    return EffortRows(plain.design, plain.fitted)


def test_the_solution_is_numpys_on_all_rows(rows: EffortRows) -> None:
    A = np.vstack([A for A, _ in stacked(rows)])
    b = np.concatenate([b for _, b in stacked(rows)])
    size = np.linalg.norm(A, axis=0)
    expected = np.linalg.lstsq(A / size, b, rcond=None)[0] / size
    assert rows.least_squares(NOTHING) == pytest.approx(expected, rel=1e-6)


def test_errors_are_those_of_the_efforts(rows: EffortRows) -> None:
    plain = clean_session().plain
    theta = rows.least_squares(NOTHING)
    loaded = EffortRows(plain.design, plain.design.indices("train"))
    expected = [np.sqrt(np.mean(e**2)) for e in effort_errors(plain.design, theta, plain.design.indices("train"))]
    assert loaded.errors(theta) == pytest.approx(expected, rel=1e-6)


def test_a_free_cylinder_counts_at_its_mean_lever_arm(rows: EffortRows) -> None:
    design = clean_session().plain.design
    free = EffortRows(design, design.indices("unloaded"))
    lever = mean_levers(design)[0]
    block = design.blocks[0][design.indices("unloaded")[0]]
    (_, b), *_ = stacked(free)
    assert b == pytest.approx(lever * block.reduced_target[block.keep], rel=1e-9)


def test_a_prior_of_a_moving_mass_counts(rows: EffortRows) -> None:
    names = clean_session().plain.design.parameters.names
    mass = names.index("joint1.m")
    free, bound = (
        rows.least_squares(prior) for prior in (NOTHING, Prior(np.array([40.0, np.nan]), np.array([1e-6, np.nan])))
    )
    assert bound[mass] == pytest.approx(40.0, rel=1e-3)
    assert abs(free[mass] - 40.0) > 1.0


def test_deviations_are_near_those_of_the_noise_where_the_model_is_right(rows: EffortRows) -> None:
    session = clean_session()
    ratio = rows.fit(session.prior).std / session.base_model.fit.std
    assert 0.8 < float(np.median(ratio)) < 2.0  # weights by the noise are the best, so others are hardly better


def test_the_noise_of_many_rows_is_what_least_squares_leaves_per_degree_of_freedom() -> None:
    rng = np.random.default_rng(5)
    A = rng.standard_normal((3000, 12)) * np.geomspace(1.0, 1e4, 12)
    b = A @ (rng.standard_normal(12) / np.geomspace(1.0, 1e4, 12)) + 0.2 * rng.standard_normal(3000)
    left = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    variance, theta = noise_variance([np.column_stack([A, b])[k::3] for k in range(3)], 3000)
    assert variance == pytest.approx(left @ left / (3000 - 12), rel=3e-3)
    assert theta == pytest.approx(np.linalg.lstsq(A, b, rcond=None)[0], rel=1e-3)


@pytest.mark.parametrize("rows", [30, 45, 70])
def test_the_noise_of_fewer_rows_than_parameters_is_not_what_least_squares_leaves(rows: int) -> None:
    """Columns of a slow motion: their singular values fall from the effort to far below the noise."""
    rng = np.random.default_rng(6)
    found = []
    for _ in range(20):
        U, V = (np.linalg.qr(rng.standard_normal((n, n)))[0] for n in (rows, 60))
        least = min(rows, 60)
        A = U[:, :least] * np.geomspace(1.0, 1e-5, least) @ V[:, :least].T
        b = A @ rng.standard_normal(60)
        noise = 0.02 * float(np.sqrt(np.mean(b**2)))
        b = b + noise * rng.standard_normal(rows)
        found.append(noise_variance([np.column_stack([A, b])], rows)[0] / noise**2)
    assert 0.6 < float(np.median(found)) < 1.7  # least squares: 0 of up to 60 rows


def test_rows_without_an_effort_have_no_noise() -> None:
    variance, theta = noise_variance([np.column_stack([np.ones((5, 2)), np.zeros(5)])], 5)
    assert variance == 0.0 and not theta.any()


def test_the_parameters_error_is_exceeded_as_often_as_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    session = clean_session()
    design, fit = session.plain.design, session.base_model.fit
    rows = EffortRows(design, design.indices("validate"))
    floor = np.array([0.5, 0.3])
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(fit.covariance + 1e-12 * np.diag(np.diag(fit.covariance)))
    drawn = []
    for _ in range(400):
        moved = root @ rng.normal(size=len(root))
        sums = [np.sum((R[:, :-1] @ moved) ** 2) for R in rows.triangles]
        drawn.append(np.sqrt(np.mean(np.array(sums) / rows.rows / floor**2)))
    for chance in (0.05, 0.3):
        monkeypatch.setattr("fitting.estimators.effort_fit.CHANCE", chance)
        share = float(np.mean(np.array(drawn) > parameter_error(rows, fit, floor)))
        assert abs(share - chance) < 3.5 * np.sqrt(chance * (1 - chance) / 400) + 0.02, chance


def test_nothing_to_predict_has_no_error() -> None:
    session = clean_session()
    rows = EffortRows(session.plain.design, session.plain.design.indices("validate"))
    fit = session.base_model.fit
    assert parameter_error(rows, replace(fit, covariance=0.0 * fit.covariance), np.ones(2)) == 0.0
    assert parameter_error(rows, fit, np.zeros(2)) == 0.0
