"""The plausible arm: against a conic solver, as rows, on motions that tell little, and on measured machines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_examples import link_map, physical_links, planar_arm, puma_560, standard_parameters
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import clean_session, make_session, planar_machine, truth

from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from fitting.arm.base_parameters import BaseParameters, base_regressor, reduce_parameters
from fitting.arm.geometry import Geometry
from fitting.estimators.effort_fit import EffortRows, predicted_std
from fitting.loop.session import Options, Session
from fitting.regression.error_sizes import errors_of
from fitting.regression.plausible_arm import (
    BELOW_ZERO,
    WEIGHT,
    Optimum,
    PlausibleArm,
    plausible_arm,
    rods,
)
from fitting.regression.solving import factor

SHARED = Path(__file__).parents[3] / "shared"
DRIVES = ("f_c", "f_v")


def problem(
    arm: Geometry, seed: int, *, span: float, noise: float, drive: float = 1.0
) -> tuple[PlausibleArm, np.ndarray, np.ndarray, BaseParameters]:
    """Rows of unit noise of a motion over ``span`` rad, with a friction ``drive`` times its usual size."""
    rng = np.random.default_rng(seed)
    base, n, samples = reduce_parameters(arm), arm.joints, 120
    q, qd, qdd = (rng.uniform(-span, span, (samples, n)) for _ in range(3))
    body = base_regressor(arm, base, q, qd, qdd).transpose(1, 0, 2)
    columns = np.zeros((n, samples, 2 * n + len(base)))
    for joint in range(n):
        columns[joint, :, 2 * joint] = np.sign(qd[:, joint])
        columns[joint, :, 2 * joint + 1] = qd[:, joint]
    columns[:, :, 2 * n :] = body
    beta = base.from_standard(standard_parameters(*physical_links(n, rng)))
    theta = np.concatenate([np.tile([drive, 0.5 * drive], n), beta])
    A = columns.reshape(-1, columns.shape[2]) / noise
    b = A @ theta + rng.standard_normal(len(A))
    parts = [
        np.column_stack([A[k * samples : (k + 1) * samples], b[k * samples : (k + 1) * samples]]) for k in range(n)
    ]
    return plausible_arm(arm, base, DRIVES * n, parts), A, b, base


def cost(found: Optimum, A: np.ndarray, b: np.ndarray) -> float:
    """The objective, written down once more."""
    arm, total = found.arm, float(np.sum((A @ found.theta - b) ** 2)) / 2
    for J0, J in zip(arm.bodies, found.bodies, strict=True):
        own = np.linalg.solve(J0, J)
        total += found.weight * (float(np.trace(own)) - float(np.log(np.linalg.det(own))) - 4.0)
    below = arm.signed & (found.phi < 0)
    return total + float(np.sum(arm.own * np.where(below, BELOW_ZERO**-2, 1.0) * found.phi**2)) / 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "span", "drive"), [(planar_arm(3), 1.0, 1.0), (puma_560(), 0.3, -1.0)], ids=["planar", "puma"]
)
def test_the_optimum_is_that_of_a_conic_solver(arm: Geometry, span: float, drive: float) -> None:
    cp = pytest.importorskip("cvxpy", reason="the extra 'test' is not installed")
    own, A, b, base = problem(arm, 3, span=span, noise=5.0, drive=drive)
    found = own.optimum(A, b)
    links, n = [cp.Variable((4, 4), PSD=True) for _ in range(arm.joints)], arm.joints
    roots = np.linalg.cholesky(own.bodies)
    pi = cp.hstack([link_map(L) @ cp.vec(X, order="C") for L, X in zip(roots, links, strict=True)])
    up, down = cp.Variable(2 * n, nonneg=True), cp.Variable(2 * n, nonneg=True)
    missing = A[:, : 2 * n] @ (up - down) + A[:, 2 * n :] @ (base.regrouping @ pi) - b
    goal = cp.sum_squares(missing) / 2 + WEIGHT * sum(cp.trace(X) - cp.log_det(X) - 4 for X in links)
    goal += cp.sum(cp.multiply(own.own, cp.square(up) + cp.square(down) / BELOW_ZERO**2)) / 2
    problem_of = cp.Problem(cp.Minimize(goal))
    problem_of.solve(solver=cp.CLARABEL)
    assert cost(found, A, b) == pytest.approx(problem_of.value, rel=1e-4)
    assert cost(found, A, b) <= problem_of.value * (1 + 1e-6)  # the same convex problem: nobody is below the optimum


@pytest.mark.parametrize("arm", [planar_arm(3), puma_560()], ids=["planar", "puma"])
def test_beside_its_rows_least_squares_has_the_same_solution(arm: Geometry) -> None:
    own, A, b, _ = problem(arm, 4, span=0.4, noise=20.0, drive=-1.0)
    found = own.optimum(A, b)
    prior, target = found.rows
    both = factor(np.vstack([A, prior]))
    theta = both.root @ (both.Q.T @ np.concatenate([b, target]))
    size = np.linalg.norm(np.vstack([A, prior]), axis=0)
    assert np.max(np.abs(theta - found.theta) * size) < 1e-6 * np.linalg.norm(b)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), span=st.sampled_from([0.02, 0.3, 2.0]), drive=st.sampled_from([-2.0, 0.1, 3.0]))
def test_links_exist_and_no_drive_drives_whatever_was_measured(seed: int, span: float, drive: float) -> None:
    own, A, b, _ = problem(planar_arm(3), seed, span=span, noise=10.0, drive=drive)
    found = own.optimum(A, b)
    assert np.min(np.linalg.eigvalsh(found.bodies)) > 0
    # Below zero by no more than a few thousandths of what the joint's whole effort allows.
    assert np.all(found.phi[own.signed] * np.sqrt(own.own[own.signed]) > -10 * BELOW_ZERO)
    # From any start the same place: the problem is convex.
    other = own.optimum(A, b, found)
    assert cost(other, A, b) == pytest.approx(cost(found, A, b), rel=1e-8)


def test_a_motion_that_tells_all_leaves_next_to_nothing_to_the_prior() -> None:
    session = clean_session()
    base, rows = session.weighted_base, EffortRows(session.plain.design, session.plain.fitted)
    free, std = rows.least_squares(session.prior), base.model.fit.std
    assert np.max(np.abs(base.tried["equal"] - free) / std) < 2.0
    fit = base.model.fit
    assert fit.share is not None
    names = session.plain.design.parameters.names
    assert {n for n, share in zip(names, fit.share, strict=True) if share < 0.9} <= {"joint1.m", "joint2.m"}


def test_the_plausible_arm_weighs_what_the_efforts_ask_for() -> None:
    session = clean_session()
    arm = session.prior.arm
    assert arm is not None
    # A rod along each link, thickness .15 of its length: three equal second moments along and across.
    geometry = planar_arm(2)
    np.testing.assert_allclose(rods(geometry)[:, 3, 3], geometry.a / geometry.a.sum())
    housing = replace(geometry, a=np.array([geometry.a[0], 0.0]))  # of a wrist: a fifth of the mean link
    np.testing.assert_allclose(rods(housing)[:, 3, 3], np.array([1.0, 0.1]) / 1.1)
    assert np.all(np.linalg.eigvalsh(arm.bodies) > 0)


def test_a_joint_that_never_moved_keeps_what_is_expected_and_says_so() -> None:
    own, A, b, _ = problem(planar_arm(2), 5, span=0.5, noise=5.0)
    still = A.copy()
    still[:, 2:4] = 0.0  # the second drive has no column at all
    found = own.optimum(still, b)
    assert np.isfinite(found.theta).all()
    assert found.phi[2:4] == pytest.approx(np.zeros(2), abs=1e-12)


def test_parameters_that_a_slow_motion_does_not_tell_are_from_the_prior() -> None:
    session = make_session(planar_machine(2), truth(2), seconds=12.0, options=Options(loop=False))
    slow = Session(session.machine, session.recordings, replace(session.options, bandwidth_hz=3.0))
    fit = slow.weighted_base.model.fit
    assert fit.share is not None and np.all((fit.share >= 0) & (fit.share <= 1))
    rows = EffortRows(slow.plain.design, slow.plain.design.indices("validate"))
    # What uncertain parameters make of the error is the mean square over the rows of C's quadratic form.
    A = np.vstack([part for part, _ in rows.parts(0)])
    expected = np.sqrt(np.mean(np.einsum("ij,jk,ik->i", A, fit.covariance, A)))
    assert predicted_std(rows, fit)[0] == pytest.approx(expected, rel=1e-6)


# --- measured machines ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("swapped", "most"), [(False, 4.4), (True, 2.9)])
def test_a_measured_arm_is_predicted_on_another_motion(swapped: bool, most: float) -> None:
    data = SHARED / "data" / "kuka_lwr4"
    if not data.is_dir():
        pytest.skip("the measured KUKA is not there (../shared/data/kuka_lwr4)")
    machine = load_machine(data / "machine.yaml")
    roles = {"train": "validate", "validate": "train"} if swapped else {r: r for r in ("train", "repeat", "validate")}
    recordings = [replace(read_recording(data / f"{f}.parquet", machine, f), role=r) for f, r in roles.items()]
    session = Session(machine, recordings, Options(loop=False))
    error = errors_of(session.plain.design, session.weighted_base.model.fit.theta)[2]["validate"]
    assert 100.0 * error <= most
    assert not session.prior.refused


@pytest.mark.slow
def test_a_measured_arm_with_fewer_rows_than_parameters_keeps_the_plausible_arm() -> None:
    """35 rows of 69 parameters in a sixth of a motion: least squares leaves nothing of them, which is no noise."""
    data = SHARED / "data" / "kuka_lwr4"
    if not data.is_dir():
        pytest.skip("the measured KUKA is not there (../shared/data/kuka_lwr4)")
    machine = load_machine(data / "machine.yaml")
    train, validate = (read_recording(data / f"{f}.parquet", machine, f) for f in ("validate", "train"))
    sixth = len(train) // 6
    for k in range(2):
        part = replace(train.cut(slice(k * sixth, (k + 1) * sixth)), role="train")
        session = Session(machine, [part, replace(validate, role="validate")], Options(loop=False, bandwidth_hz=3.0))
        design, base = session.plain.design, session.weighted_base
        ways = {"base": base.model.fit.theta, **base.tried}
        error = {name: errors_of(design, theta)[2]["validate"] for name, theta in ways.items()}
        assert error["base"] < 0.85 * error["least_squares"] and error["base"] < 0.95 * error["possible"]


@pytest.mark.slow
def test_an_arm_whose_motion_refuses_it_is_left_to_least_squares() -> None:
    data = SHARED / "samples" / "tilted-base"
    if not data.is_dir():
        pytest.skip("the sample is not there (../shared/samples/tilted-base)")
    machine = load_machine(data / "machine.yaml")
    recordings = [read_recording(p, machine, p.stem.split("-")[0]) for p in sorted(data.glob("*.parquet"))]
    session = Session(machine, recordings, Options(loop=False))
    # Gravity turned is swallowed by stiffnesses below zero; held at zero they leave half as much again.
    assert session.prior.refused
    assert session.weighted_base.model.prior is not None and session.weighted_base.model.prior.point is None
