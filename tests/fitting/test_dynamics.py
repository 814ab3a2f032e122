"""The regressor against MuJoCo's inverse dynamics, against closed forms, and against itself."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from arm_examples import (
    RIGHT,
    chain,
    driven_arm,
    inverse_dynamics,
    physical_links,
    planar_arm,
    random_chain,
    sample_machine,
    standard_names,
    standard_parameters,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import fitting.arm.dynamics as dynamics
from fitting.arm.dynamics import (
    rigid_body_regressor,
    self_check,
    stacked,
    standard_regressor,
)
from fitting.arm.geometry import Geometry, link_frames


def to_mujoco(arm: Geometry, links, drive_inertia=None, damping=None) -> mujoco.MjModel:
    """The same chain as bodies: body ``i`` is frame ``i - 1`` moved by joint ``i``, and frame ``i`` fixed in it."""
    masses, centres, inertias = links
    at_rest = link_frames(arm, np.zeros(arm.joints))
    fixed = [np.linalg.inv(at_rest[i]) @ at_rest[i + 1] for i in range(arm.joints)]  # A_i(0)
    body, closing = "", ""
    pose = np.eye(4)
    for i in range(arm.joints):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, pose[:3, :3].ravel())
        centre = fixed[i][:3, :3] @ centres[i] + fixed[i][:3, 3]
        inertia = fixed[i][:3, :3] @ inertias[i] @ fixed[i][:3, :3].T
        entries = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
        numbers = {
            "pos": pose[:3, 3],
            "quat": quaternion,
            "com": centre,
            "full": entries,
        }
        text = {key: " ".join(repr(float(v)) for v in values) for key, values in numbers.items()}
        body += (
            f'<body pos="{text["pos"]}" quat="{text["quat"]}">'
            f'<joint type="{"hinge" if arm.revolute[i] else "slide"}" axis="0 0 1"'
            f' armature="{0.0 if drive_inertia is None else float(drive_inertia[i])!r}"'
            f' damping="{0.0 if damping is None else float(damping[i])!r}"/>'
            f'<inertial pos="{text["com"]}" mass="{float(masses[i])!r}" fullinertia="{text["full"]}"/>'
        )
        closing += "</body>"
        pose = fixed[i]
    gravity = " ".join(repr(float(v)) for v in arm.gravity)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{gravity}"/>'
        f"<worldbody>{body}{closing}</worldbody></mujoco>"
    )


def mujoco_efforts(model: mujoco.MjModel, q, qd, qdd) -> np.ndarray:
    data = mujoco.MjData(model)
    tau = np.zeros(q.shape)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        tau[k] = data.qfrc_inverse
    return tau


def states(n: int, samples: int, seed: int):
    return np.random.default_rng(seed).uniform(-2, 2, (3, samples, n))


@pytest.mark.parametrize("kinds", ["RRRRRR", "RPRRPR", "PPRRRP", "R", "P"])
@pytest.mark.parametrize("square", [False, True], ids=["any twist", "right angles"])
def test_efforts_agree_with_mujoco(kinds, square):
    rng = np.random.default_rng(len(kinds) + 10 * square)
    arm = random_chain(kinds, rng, square=square)
    links = physical_links(arm.joints, rng)
    q, qd, qdd = states(arm.joints, 25, 5)
    expected = mujoco_efforts(to_mujoco(arm, links), q, qd, qdd)
    pi = standard_parameters(*links)
    found = rigid_body_regressor(arm, q, qd, qdd) @ pi.ravel()
    scale = np.abs(expected).max(axis=0)
    assert (np.abs(found - expected) / scale).max() < 1e-9
    np.testing.assert_allclose(inverse_dynamics(arm, pi, q, qd, qdd), found, rtol=1e-12, atol=1e-12 * scale.max())


@settings(max_examples=25, deadline=None)
@given(
    kinds=st.text("RP", min_size=1, max_size=7), seed=st.integers(0, 10_000), square=st.booleans(), fast=st.booleans()
)
def test_any_chain_agrees_with_mujoco(kinds, seed, square, fast):
    rng = np.random.default_rng(seed)
    arm = random_chain(kinds, rng, square=square)
    links = physical_links(arm.joints, rng)
    q, qd, qdd = states(arm.joints, 3, seed)
    if not fast:
        qd = np.zeros_like(qd)  # the regressor skips what is zero for all samples
    expected = mujoco_efforts(to_mujoco(arm, links), q, qd, qdd)
    found = rigid_body_regressor(arm, q, qd, qdd) @ standard_parameters(*links).ravel()
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_standard_parameters_agree_with_mujoco_armature_and_damping():
    rng = np.random.default_rng(0)
    arm = random_chain("RRP", rng)
    links = physical_links(3, rng)
    drive, damping = rng.uniform(0.1, 2, (2, 3))
    q, qd, qdd = states(3, 20, 1)
    expected = mujoco_efforts(to_mujoco(arm, links, drive, damping), q, qd, qdd)
    coulomb = np.array([3.0, 2.0, 1.0])
    pi = np.hstack([standard_parameters(*links), coulomb[:, None], damping[:, None], drive[:, None]])
    expected = expected + coulomb * np.sign(qd)  # MuJoCo's frictionloss is a constraint, not part of the inverse
    np.testing.assert_allclose(standard_regressor(arm, q, qd, qdd) @ pi.ravel(), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(inverse_dynamics(arm, pi, q, qd, qdd), expected, rtol=1e-9, atol=1e-9)


def test_pendulum_in_closed_form():
    """A point mass at the end of a rod that turns about a horizontal axis: ``m l^2 q'' + m g l cos q``."""
    m, length = 3.0, 0.7
    arm = planar_arm(1)
    # Frame 1 sits at the link's far end, a = 0.9 from the axis; the mass is at `length`.
    back = length - arm.a[0]
    pi = standard_parameters(np.array([m]), np.array([[back, 0, 0]]), np.zeros((1, 3, 3)))
    q, qd, qdd = states(1, 30, 2)
    tau = inverse_dynamics(arm, pi, q, qd, qdd)
    np.testing.assert_allclose(tau, m * length**2 * qdd + m * 9.81 * length * np.cos(q), rtol=1e-12)


def test_vertical_slide_carries_its_weight():
    arm = chain("P", [0.0], [0.0], [0.0], [0, 0, -9.81])
    q, qd, qdd = states(1, 10, 3)
    tau = inverse_dynamics(arm, standard_parameters(np.array([4.0]), np.zeros((1, 3)), np.zeros((1, 3, 3))), q, qd, qdd)
    np.testing.assert_allclose(tau, 4.0 * (qdd + 9.81), rtol=1e-12)


def test_two_links_in_closed_form():
    """Two point masses at the ends of two links (Siciliano et al., 7.3.2, without motors)."""
    arm = planar_arm(2)
    l1, l2 = arm.a
    m1, m2 = 5.0, 2.0
    pi = standard_parameters(np.array([m1, m2]), np.zeros((2, 3)), np.zeros((2, 3, 3)))
    q, qd, qdd = states(2, 40, 4)
    c1, c2, c12, s2 = np.cos(q[:, 0]), np.cos(q[:, 1]), np.cos(q.sum(axis=1)), np.sin(q[:, 1])
    b12 = m2 * (l2**2 + l1 * l2 * c2)
    tau1 = (
        (m1 * l1**2 + m2 * (l1**2 + l2**2 + 2 * l1 * l2 * c2)) * qdd[:, 0]
        + b12 * qdd[:, 1]
        - m2 * l1 * l2 * s2 * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2)
        + (m1 + m2) * 9.81 * l1 * c1
        + m2 * 9.81 * l2 * c12
    )
    tau2 = b12 * qdd[:, 0] + m2 * l2**2 * qdd[:, 1] + m2 * l1 * l2 * s2 * qd[:, 0] ** 2 + m2 * 9.81 * l2 * c12
    np.testing.assert_allclose(inverse_dynamics(arm, pi, q, qd, qdd), np.column_stack([tau1, tau2]), rtol=1e-10)


def test_power_is_the_rate_of_kinetic_energy():
    """Without gravity ``q' . tau`` is the change of ``q' M q' / 2``, along any motion."""
    rng = np.random.default_rng(7)
    arm = random_chain("RPRR", rng)
    pi = standard_parameters(*physical_links(4, rng))
    t = np.linspace(0, 1, 4001)
    amplitude, rate, phase = rng.uniform(0.3, 1, (3, 4))
    q = amplitude * np.sin(rate * t[:, None] + phase)
    qd, qdd = amplitude * rate * np.cos(rate * t[:, None] + phase), -q * rate**2
    power = (inverse_dynamics(arm, pi, q, qd, qdd, gravity=[0, 0, 0]) * qd).sum(axis=1)
    # At q' = 0, q'' := q', tau = M q'; so q' M q' / 2 follows without a mass matrix of our own.
    energy = 0.5 * (inverse_dynamics(arm, pi, q, np.zeros_like(q), qd, gravity=[0, 0, 0]) * qd).sum(axis=1)
    change = np.gradient(energy, t)
    np.testing.assert_allclose(power[1:-1], change[1:-1], atol=1e-5 * np.abs(power).max())


def test_regressor_is_linear_in_gravity():
    arm = random_chain("RRPR", np.random.default_rng(8))
    q, qd, qdd = states(4, 30, 9)
    tilt = np.array([0.3, -0.2, 0.1])
    whole = rigid_body_regressor(arm, q, qd, qdd, gravity=arm.gravity + tilt)
    parts = rigid_body_regressor(arm, q, qd, qdd) + rigid_body_regressor(arm, q, 0 * q, 0 * q, gravity=tilt)
    np.testing.assert_allclose(whole, parts, atol=1e-12)


def test_gravity_may_change_from_sample_to_sample():
    arm = random_chain("RRR", np.random.default_rng(10))
    q, qd, qdd = states(3, 12, 11)
    gravity = np.random.default_rng(12).normal(size=(12, 3))
    together = rigid_body_regressor(arm, q, qd, qdd, gravity=gravity)
    for k in range(12):
        row = slice(k, k + 1)
        alone = rigid_body_regressor(arm, q[row], qd[row], qdd[row], gravity=gravity[k])
        np.testing.assert_allclose(together[row], alone, atol=1e-13)


def test_a_tilted_base_is_a_turned_gravity_to_first_order():
    arm = planar_arm(3)
    q = states(3, 10, 13)[0]
    still = np.zeros_like(q)
    axis = np.array([0.0, 0.0, 1.0])
    direction = -np.cross(axis, arm.gravity)
    errors = []
    for angle in (1e-2, 1e-3):
        c, s = np.cos(-angle), np.sin(-angle)
        turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ arm.gravity
        exact = rigid_body_regressor(arm, q, still, still, gravity=turned)
        per_angle = rigid_body_regressor(arm, q, still, still, gravity=direction)
        guess = rigid_body_regressor(arm, q, still, still) + angle * per_angle
        errors.append(np.abs(exact - guess).max())
    assert 80 < errors[0] / errors[1] < 120  # what is left is of second order


def test_chosen_columns_are_those_of_the_whole_and_chunks_do_not_show(monkeypatch):
    arm = random_chain("RRPRRR", np.random.default_rng(14))
    q, qd, qdd = states(6, 50, 15)
    whole = rigid_body_regressor(arm, q, qd, qdd)
    columns = [59, 3, 17, 20, 0]
    np.testing.assert_allclose(rigid_body_regressor(arm, q, qd, qdd, columns=columns), whole[:, :, columns], atol=1e-14)
    monkeypatch.setattr(dynamics, "_CHUNK", 7)
    np.testing.assert_allclose(rigid_body_regressor(arm, q, qd, qdd), whole, atol=1e-13)


def test_a_joint_does_not_feel_the_links_before_it():
    arm = random_chain("RRRR", np.random.default_rng(16))
    Y = rigid_body_regressor(arm, *states(4, 5, 17))
    for joint in range(4):
        assert not Y[:, joint, : 10 * joint].any()


def test_parameter_names_and_regressor_shapes_follow_from_the_arm():
    arm = planar_arm(6)
    assert len(standard_names(arm)) == 78
    assert standard_names(arm)[:14] == (
        *("m1", "mx1", "my1", "mz1", "Ixx1", "Ixy1", "Ixz1", "Iyy1", "Iyz1", "Izz1", "f_c1", "f_v1", "J1"),
        "m2",
    )
    q, qd, qdd = states(6, 4, 18)
    Y = standard_regressor(arm, q, qd, qdd)
    assert Y.shape == (4, 6, 78)
    np.testing.assert_array_equal(Y[:, 1, 13 + 10], np.sign(qd[:, 1]))
    np.testing.assert_array_equal(Y[:, 1, 13 + 11], qd[:, 1])
    np.testing.assert_array_equal(Y[:, 1, 13 + 12], qdd[:, 1])


def test_stacking_goes_joint_by_joint_without_a_copy():
    arm = planar_arm(3)
    Y = rigid_body_regressor(arm, *states(3, 8, 19))
    W = stacked(Y)
    assert W.shape == (24, 30)
    assert np.shares_memory(W, Y)
    np.testing.assert_array_equal(W[8:16], Y[:, 1])


def test_self_check_is_at_round_off_for_every_kind_of_arm():
    for machine in (driven_arm(6), driven_arm(6, twisted=True), random_chain("RPRPRR", np.random.default_rng(20))):
        assert self_check(machine) < 1e-12


@pytest.mark.parametrize("case", ["nothing-missing", "tilted-base"])
def test_self_check_of_the_sample_machines(case):
    assert self_check(sample_machine(case)) < 1e-12


def test_self_check_sees_a_wrong_regressor(monkeypatch):
    right = dynamics.rigid_body_regressor

    def wrong(*args, **kwargs):
        Y = right(*args, **kwargs).copy()
        Y[:, :, 14] *= -1  # the sign of a product of inertia, the classical slip
        return Y

    monkeypatch.setattr(dynamics, "rigid_body_regressor", wrong)
    assert self_check(random_chain("RRR", np.random.default_rng(21))) > 1e-3


def test_wrong_shapes_are_refused():
    arm = planar_arm(2)
    q = np.zeros((5, 2))
    with pytest.raises(ValueError, match=r"qd has shape \(5, 3\)"):
        rigid_body_regressor(arm, q, np.zeros((5, 3)), q)
    with pytest.raises(ValueError, match="same number of samples"):
        rigid_body_regressor(arm, q, q[:4], q)
    with pytest.raises(ValueError, match=r"columns must be 0 to 19"):
        rigid_body_regressor(arm, q, q, q, columns=[20])
    with pytest.raises(ValueError, match="gravity has shape"):
        rigid_body_regressor(arm, q, q, q, gravity=[1.0])
    with pytest.raises(ValueError, match="pi has 7 numbers"):
        inverse_dynamics(arm, np.zeros(7), q, q, q)


def test_right_twists_cost_nothing_in_accuracy():
    """A twist of 90 degrees in floating point is off by 6e-17; taking it as exact must not show."""
    exact = chain("RRR", [RIGHT, -RIGHT, RIGHT], [0.3, 0.2, 0.1], [0.1, 0.0, 0.2], [0, 0, -9.81])
    near = chain("RRR", [RIGHT + 1e-12, -RIGHT, RIGHT], [0.3, 0.2, 0.1], [0.1, 0.0, 0.2], [0, 0, -9.81])
    motion = states(3, 20, 22)
    np.testing.assert_allclose(rigid_body_regressor(exact, *motion), rigid_body_regressor(near, *motion), atol=1e-10)
