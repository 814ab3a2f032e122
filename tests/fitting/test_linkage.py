"""Lever arms are the derivatives of the piston position, and the inverse comes back to the joint."""

from __future__ import annotations

import numpy as np
import pytest
from arm_examples import driven_arm
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.errors import InputError
from daq.linkages import Direct, Linkage, Polynomial, Rack, ThreePin
from daq.machine_file import Cylinder, Joint, Limits
from fitting.linkage import (
    joint_motion,
    joint_position,
    lever_arm,
    lever_arm_derivatives,
    lever_arm_slope,
    parameter_derivatives,
    parameter_names,
    piston_motion,
    stroke_limits,
)

THREE_PIN = ThreePin(type="three_pin", a=0.45, b=0.16, offset=1.7, retracted=0.37)
LINKAGES: list[Linkage] = [
    THREE_PIN,
    ThreePin(type="three_pin", a=0.45, b=0.16, offset=-1.7, retracted=0.37),
    ThreePin(type="three_pin", a=0.16, b=0.45, offset=1.7 + 4 * np.pi, retracted=0.37),
    Rack(type="rack", radius=-0.08, zero=1.5),
    Direct(type="direct"),
    Polynomial(type="polynomial", coefficients=(0.12, 0.15, -0.02, 0.01)),
]


def joint_with(linkage: Linkage, limits: tuple[float, float] = (-0.6, 0.6)) -> Joint:
    x = linkage.piston_position(np.array(limits))
    # Zero the linkage so that the piston stays in its stroke, whichever linkage it is.
    if isinstance(linkage, Direct):
        limits = (0.0, 0.5)
    stroke = 2.0 if isinstance(linkage, Direct) else float(x.max()) + 0.01
    return Joint(
        name="boom",
        type="prismatic" if isinstance(linkage, Direct) else "revolute",
        dh={"a": 0.0, "alpha": 0.0, "d": 0.0, "theta": 0.0},
        limits=Limits(position=limits, velocity=1.0, acceleration=1.0),
        cylinder=Cylinder(bore=0.1, rod=0.05, stroke=stroke, linkage=linkage),
    )


def test_three_pin_length_is_the_distance_between_two_points():
    """The law of cosines against plane geometry: one pin at a on the x axis, the other turned by q + offset."""
    q = np.linspace(-0.6, 0.6, 7)
    fixed = np.array([THREE_PIN.a, 0.0])
    turned = THREE_PIN.b * np.stack([np.cos(q + THREE_PIN.offset), np.sin(q + THREE_PIN.offset)], axis=-1)
    distance = np.linalg.norm(turned - fixed, axis=-1)
    np.testing.assert_allclose(THREE_PIN.piston_position(q) + THREE_PIN.retracted, distance, rtol=1e-14)
    # The lever arm of a force along the rod is the distance of the rod's line from the axis.
    along = (turned - fixed) / distance[:, None]
    moment = turned[:, 0] * along[:, 1] - turned[:, 1] * along[:, 0]
    np.testing.assert_allclose(lever_arm(THREE_PIN, q), moment, rtol=1e-12)


def central(function, at, h):
    return (function(at + h) - function(at - h)) / (2 * h)


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda linkage: linkage.type)
def test_derivatives_converge_with_the_square_of_the_step(linkage):
    q = np.linspace(-0.55, 0.55, 11)
    for function, derivative in (
        (linkage.piston_position, lever_arm(linkage, q)),
        (lambda at: lever_arm(linkage, at), lever_arm_slope(linkage, q)),
    ):
        coarse = np.abs(central(function, q, 1e-2) - derivative).max()
        fine = np.abs(central(function, q, 1e-3) - derivative).max()
        assert fine < 1e-6
        assert coarse < 1e-9 or 80 < coarse / fine < 120  # order 2: a tenth of the step, a hundredth of the error


@given(
    a=st.floats(0.2, 2.0),
    ratio=st.floats(0.2, 0.9),
    middle=st.floats(0.7, 2.4),
    turns=st.integers(-3, 3),
    side=st.sampled_from([1.0, -1.0]),
)
def test_three_pin_inverse_comes_back_on_either_branch(a, ratio, middle, turns, side):
    b = a * ratio
    offset = side * middle + 2 * np.pi * turns
    shape = ThreePin(type="three_pin", a=a, b=b, offset=offset, retracted=1e-3)
    ends = shape.length(np.array([-0.5, 0.0, 0.5]))
    linkage = shape.model_copy(update={"retracted": float(ends.min()) * 0.999})
    joint = joint_with(linkage, (-0.5, 0.5))
    q = np.linspace(-0.5, 0.5, 41)
    np.testing.assert_allclose(joint_position(joint, linkage.piston_position(q)), q, atol=1e-10)


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda linkage: linkage.type)
def test_inverse_and_motion_come_back(linkage):
    joint = joint_with(linkage)
    rng = np.random.default_rng(1)
    low, high = joint.limits.position
    q, qd, qdd = rng.uniform(low, high, 50), rng.normal(size=50), rng.normal(size=50)
    there = piston_motion(linkage, q, qd, qdd)
    for found, expected in zip(joint_motion(joint, *there), (q, qd, qdd), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_piston_motion_is_what_differentiation_in_time_gives():
    t = np.linspace(0, 2, 20001)
    q, qd, qdd = 0.4 * np.sin(3 * t), 1.2 * np.cos(3 * t), -3.6 * np.sin(3 * t)
    x, xd, xdd = piston_motion(THREE_PIN, q, qd, qdd)
    np.testing.assert_allclose(np.gradient(x, t)[1:-1], xd[1:-1], atol=1e-7)
    np.testing.assert_allclose(np.gradient(xd, t)[1:-1], xdd[1:-1], atol=1e-7)


def test_positions_beyond_reach_give_the_nearest_joint_position_and_nan_stays():
    joint = joint_with(THREE_PIN)
    stretched = THREE_PIN.a + THREE_PIN.b - THREE_PIN.retracted
    q = joint_position(joint, np.array([stretched + 0.1, np.nan]))
    assert q[0] == pytest.approx(np.pi - THREE_PIN.offset)
    assert np.isnan(q[1])


@settings(max_examples=30)
@given(q=st.floats(-0.6, 0.6), which=st.sampled_from([0, 1, 3, 5]))
def test_parameter_derivatives_match_a_changed_linkage(q, which):
    linkage = LINKAGES[which]
    h = 1e-6
    for k, name in enumerate(parameter_names(linkage)):

        def changed(step, name=name):
            if isinstance(linkage, Polynomial):
                coefficients = list(linkage.coefficients)
                coefficients[int(name[1:])] += step
                return linkage.model_copy(update={"coefficients": tuple(coefficients)})
            return linkage.model_copy(update={name: getattr(linkage, name) + step})

        by_position = (changed(h).piston_position(q) - changed(-h).piston_position(q)) / (2 * h)
        by_arm = (lever_arm(changed(h), q) - lever_arm(changed(-h), q)) / (2 * h)
        assert parameter_derivatives(linkage, q)[k] == pytest.approx(float(by_position), abs=1e-8)
        assert lever_arm_derivatives(linkage, q)[k] == pytest.approx(float(by_arm), abs=1e-8)


def test_direct_linkage_has_no_parameters():
    assert parameter_names(Direct(type="direct")) == ()
    assert parameter_derivatives(Direct(type="direct"), np.zeros(4)).shape == (4, 0)


def test_stroke_limits_lie_inside_both():
    joint = driven_arm(1).joints[0]
    assert stroke_limits(joint) == pytest.approx(joint.limits.position, abs=1e-12)
    assert joint.cylinder is not None
    # A stroke that ends a tenth of a millimetre before the limit does is what the machine file still tolerates.
    reach = float(joint.cylinder.linkage.piston_position(np.array(0.6)))
    shorter = joint.model_copy(update={"cylinder": joint.cylinder.model_copy(update={"stroke": reach - 1e-4})})
    low, high = stroke_limits(shorter)
    assert low == pytest.approx(-0.6, abs=1e-12)
    assert float(joint.cylinder.linkage.piston_position(high)) == pytest.approx(reach - 1e-4)


def test_a_joint_without_cylinder_has_no_piston():
    bare = driven_arm(1).joints[0].model_copy(update={"cylinder": None})
    with pytest.raises(InputError, match=r"joints\.joint1: has no cylinder"):
        joint_position(bare, np.zeros(3))
