"""Where the links are, against transforms multiplied out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from arm_examples import RIGHT, chain, driven_arm, planar_arm, random_chain

from fitting.arm.geometry import geometry_of, link_frames


def turn_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def turn_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def move(x, z):
    out = np.eye(4)
    out[0, 3], out[2, 3] = x, z
    return out


def test_frames_are_the_product_of_the_four_elementary_transforms():
    arm = random_chain("RPRPR", np.random.default_rng(3))
    q = np.random.default_rng(4).normal(size=(3, 5))
    frames = link_frames(arm, q)
    assert frames.shape == (3, 6, 4, 4)
    for sample in range(3):
        pose = np.eye(4)
        for i in range(5):
            turned, slid = (q[sample, i], 0.0) if arm.revolute[i] else (0.0, q[sample, i])
            pose = (
                pose
                @ turn_z(arm.theta[i] + turned)
                @ move(0, arm.d[i] + slid)
                @ move(arm.a[i], 0)
                @ turn_x(arm.alpha[i])
            )
            np.testing.assert_allclose(frames[sample, i + 1], pose, atol=1e-12)


def test_stretched_planar_arm_reaches_the_sum_of_its_links():
    arm = planar_arm(6)
    tip = link_frames(arm, np.zeros(6))[-1]
    np.testing.assert_allclose(tip[:3, 3], [arm.a.sum(), 0, 0], atol=1e-14)
    lifted = link_frames(arm, np.array([RIGHT, 0, 0, 0, 0, 0]))[-1]
    np.testing.assert_allclose(lifted[:3, 3], [0, arm.a.sum(), 0], atol=1e-14)


def test_geometry_of_a_machine_file_is_its_table():
    machine = driven_arm(3, twisted=True)
    geometry = geometry_of(machine)
    assert geometry.names == ("joint1", "joint2", "joint3")
    assert geometry.revolute.all()
    np.testing.assert_array_equal(geometry.a, [joint.dh.a for joint in machine.joints])
    np.testing.assert_array_equal(geometry.gravity, machine.gravity)
    assert geometry_of(geometry) is geometry


def test_right_angles_have_exact_zeros():
    arm = chain("RRR", [RIGHT, -RIGHT, np.pi], [0.1] * 3, [0.1] * 3, [0, 0, -9.81])
    assert arm.cos_alpha[0] == 0.0
    assert arm.cos_alpha[1] == 0.0
    assert arm.sin_alpha[2] == 0.0


def test_squared_up_mends_rounded_right_angles_and_nothing_else():
    arm = chain("RRR", [1.5708, -1.57, 0.3], [0.1] * 3, [0.1] * 3, [0, 0, -9.81])
    mended = arm.squared_up()
    assert mended.alpha[0] == RIGHT
    assert mended.alpha[1] == -1.57  # 0.8 mrad: may be meant
    assert mended.alpha[2] == 0.3


def test_wrong_number_of_joints_is_refused():
    with pytest.raises(ValueError, match="must hold the 6 joints"):
        link_frames(planar_arm(6), np.zeros((4, 5)))
