"""Lever arms are the derivatives of the piston position, and the inverse comes back to the joint."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from arm_examples import driven_arm
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import fsolve

from daq.errors import InputError
from daq.machine.linkages import Direct, FourBar, Linkage, Pins, Polynomial, Rack, ThreePin, reduced
from daq.machine.machine_file import Cylinder, Joint, Limits, MachineFileError, machine_to_yaml, parse_machine
from fitting.arm.linkage import (
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
PINS = Pins(
    type="pins", base_pin=(-0.3, 0.2), base_pivot=(0.1, 0.1), rod_pin=(0.1, 0.3), link_pivot=(0.2, 0.4), retracted=0.2
)
#: An excavator's bucket: origin at the bucket's axis, the stick to the left of it, the cylinder above the stick.
BUCKET = FourBar(
    type="four_bar",
    base_pin=(-1.5, 0.30),
    base_pivot=(0.0, 0.0),
    rocker_pivot=(-0.40, 0.05),
    coupler_pin=(-0.05, 0.30),
    link_pivot=(0.0, 0.0),
    rod_arm=0.48,
    coupler_arm=0.45,
    arms_angle=0.1,
    coupler=0.42,
    side="left",
    retracted=0.85,
)
#: The same seen from the other side.
MIRRORED = BUCKET.model_copy(
    update={
        "base_pin": (-1.5, -0.30),
        "rocker_pivot": (-0.40, -0.05),
        "coupler_pin": (-0.05, -0.30),
        "arms_angle": -0.1,
        "side": "right",
    }
)
LINKAGES: list[Linkage] = [
    THREE_PIN,
    ThreePin(type="three_pin", a=0.45, b=0.16, offset=-1.7, retracted=0.37),
    ThreePin(type="three_pin", a=0.16, b=0.45, offset=1.7 + 4 * np.pi, retracted=0.37),
    Rack(type="rack", radius=-0.08, zero=1.5),
    Direct(type="direct"),
    Polynomial(type="polynomial", coefficients=(0.12, 0.15, -0.02, 0.01)),
    PINS,
    BUCKET,
    MIRRORED,
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
        assert fine < 5e-6  # third derivatives of a bucket's linkage reach 10 m
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


POINT = st.tuples(st.floats(-1, 1), st.floats(-1, 1))


def turned(point, angle):
    """A point of the plane turned about the origin, by complex numbers."""
    z = complex(*point) * np.exp(1j * np.asarray(angle))
    return np.stack([z.real, z.imag], axis=-1)


@given(POINT, POINT, POINT, POINT, st.floats(-7, 7), st.floats(-2, 2))
def test_pins_are_the_distance_of_the_points_that_were_measured(base_pin, base_pivot, rod_pin, link_pivot, angle, q):
    assume(np.hypot(*np.subtract(base_pin, base_pivot)) > 0.05 and np.hypot(*np.subtract(rod_pin, link_pivot)) > 0.05)
    pins = Pins(
        type="pins", base_pin=base_pin, base_pivot=base_pivot, rod_pin=rod_pin, link_pivot=link_pivot, angle=angle,
        retracted=0.1,
    )  # fmt: skip
    # The moving link is put onto the parent so that both pivots lie on each other, and turned by q + angle.
    rod = np.add(base_pivot, turned(np.subtract(rod_pin, link_pivot), q + angle))
    along = rod - base_pin
    length = np.hypot(*along)
    assert pins.piston_position(q) + 0.1 == pytest.approx(length, abs=1e-9)
    assume(length > 0.02)
    arm = rod - base_pivot
    moment = (arm[0] * along[1] - arm[1] * along[0]) / length  # of a unit force along the rod, about the joint
    assert lever_arm(pins, q) == pytest.approx(moment, abs=1e-9)


@given(st.floats(0.2, 1), st.floats(0.2, 1), st.floats(-3, 3), st.floats(-3, 3), st.floats(-2, 2))
def test_pins_made_of_a_three_pin_linkage_are_that_linkage(a, b, offset, bearing, theta):
    pins = Pins(
        type="pins", base_pin=tuple(turned((a, 0), bearing)), base_pivot=(0, 0), link_pivot=(0, 0),
        rod_pin=tuple(turned((b, 0), bearing + offset - theta)), angle=theta, retracted=0.1,
    )  # fmt: skip
    same = ThreePin(type="three_pin", a=a, b=b, offset=offset, retracted=0.1)
    q = np.linspace(-3, 3, 13)
    np.testing.assert_allclose(pins.piston_position(q), same.piston_position(q), atol=1e-8)
    assert reduced(same) is same and isinstance(reduced(pins), ThreePin)
    assert parameter_names(pins) == parameter_names(same)


def loop_closure(linkage: FourBar, q: float, start: float) -> float:
    """Piston position by solving both equations of the loop numerically; ``start`` is a guess of the rocker."""
    theta = q + (linkage.angle or 0.0)
    pin = np.add(linkage.base_pivot, turned(np.subtract(linkage.coupler_pin, linkage.link_pivot), theta))

    def open_by(angles):
        rocker = np.add(linkage.rocker_pivot, turned((linkage.coupler_arm, 0), angles[0]))
        return rocker + turned((linkage.coupler, 0), angles[1]) - pin

    tip = np.add(linkage.rocker_pivot, turned((linkage.coupler_arm, 0), start))
    guess = np.arctan2(*(pin - tip)[::-1])
    angles, _, found, text = fsolve(open_by, [start, guess], full_output=True, xtol=1e-13)
    assert found == 1, text
    rod = np.add(linkage.rocker_pivot, turned((linkage.rod_arm, 0), angles[0] + linkage.arms_angle))
    return float(np.hypot(*(rod - np.array(linkage.base_pin)))) - linkage.retracted


@pytest.mark.slow
@settings(deadline=None)
@given(st.integers(0, 100_000), st.floats(-0.5, 0.5), st.sampled_from([BUCKET, MIRRORED]), st.floats(-3, 3))
def test_a_four_bar_linkage_closes_its_loop(seed, q, like, angle):
    """Lengths and points of a bucket, 5 % off; the numerical loop starts from the rocker's direction, 3 degrees off."""
    rng = np.random.default_rng(seed)
    content = like.model_dump()
    for name, value in content.items():
        if isinstance(value, float) and name not in ("arms_angle", "retracted"):
            content[name] = value * rng.uniform(0.95, 1.05)
        elif isinstance(value, tuple):
            content[name] = tuple(rng.normal(value, 0.02))
    content["angle"] = angle
    linkage = FourBar(**content)
    q = q - angle
    assume(abs(float(linkage.closing_cosine(q))) < 0.98)
    assert linkage.piston_position(q) == pytest.approx(
        loop_closure(linkage, q, float(linkage.rocker(q)) + 0.05), abs=1e-9
    )
    step = 1e-5
    slope = (linkage.piston_position(q + step) - linkage.piston_position(q - step)) / (2 * step)
    assert lever_arm(linkage, q) == pytest.approx(slope, abs=1e-6 * (1 + abs(slope)))


def test_a_mirrored_bucket_is_the_bucket_backwards():
    q = np.linspace(-0.6, 0.6, 9)
    np.testing.assert_allclose(MIRRORED.piston_position(q), BUCKET.piston_position(-q), atol=1e-12)
    np.testing.assert_allclose(lever_arm(MIRRORED, q), -lever_arm(BUCKET, -q), atol=1e-12)


def test_power_goes_through_the_coupler():
    """Static forces in the bars instead of derivatives: rod force to coupler force at the rocker, coupler to bucket."""
    for q in np.linspace(-0.5, 0.5, 5):
        pin = np.array(turned(BUCKET.coupler_pin, q))
        phi = float(BUCKET.rocker(q))
        pivot = np.array(BUCKET.rocker_pivot)
        tip, rod = turned((BUCKET.coupler_arm, 0), phi), turned((BUCKET.rod_arm, 0), phi + BUCKET.arms_angle)
        push = pivot + rod - BUCKET.base_pin
        push = push / np.hypot(*push)
        bar = (pin - pivot - tip) / BUCKET.coupler
        cross = lambda a, b: a[0] * b[1] - a[1] * b[0]  # noqa: E731
        in_bar = cross(rod, push) / cross(tip, bar)  # the rocker is massless: moments about its pivot cancel
        assert lever_arm(BUCKET, q) == pytest.approx(in_bar * cross(pin, bar), rel=1e-10)


def file_with(linkage: dict, **joint) -> str:
    """A machine file of one joint with a linkage."""
    tree = yaml.safe_load(machine_to_yaml(driven_arm(1)))
    own = {**tree["joints"][0], "name": "boom", **joint}
    own["cylinder"] = {"bore": 0.1, "rod": 0.05, "stroke": 0.6, "linkage": linkage}
    own["limits"] = {"position": [-0.6, 0.6], "velocity": 1.0, "acceleration": 1.0}
    channels = [
        {"name": "q", "quantity": "joint_position", "joint": "boom", "unit": "rad"},
        {"name": "f", "quantity": "cylinder_force", "joint": "boom", "unit": "N"},
    ]
    return yaml.safe_dump({**tree, "joints": [own], "channels": channels}, sort_keys=False)


def test_linkages_in_files_come_back_and_take_the_tables_angle():
    bucket = BUCKET.model_dump(exclude={"angle"})
    for linkage in (bucket, PINS.model_dump(exclude={"angle"})):
        plain = parse_machine(file_with({**linkage, "angle": -0.3}))
        by_table = parse_machine(file_with(linkage, dh={"a": 1.0, "alpha": 0.0, "d": 0.0, "theta": -0.3}))
        assert plain.joints[0].cylinder == by_table.joints[0].cylinder
        assert parse_machine(machine_to_yaml(by_table)) == by_table


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"coupler": 0.1}, "cannot close: at q = .* coupler_pin is .* m from rocker_pivot, .* reach 0.35 to 0.55 m"),
        ({"coupler": 2.0}, "cannot close: at q"),
        ({"coupler": 0.2}, "dead centre.*the points, side or angle"),
        ({"retracted": 2.5}, "cannot close: .* stroke of 0.6 m; check retracted, the points, side or angle"),
        ({"side": "up"}, "linkage.side.*'left', 'right'"),
        ({"coupler_pin": [0.0, 0.0]}, "coupler_pin and link_pivot are the same point"),
        ({"rod_arm": -1.0}, "rod_arm.*greater than 0"),
    ],
)
def test_four_bar_linkages_that_cannot_be(change, words):
    with pytest.raises(MachineFileError, match=words):
        parse_machine(file_with({**BUCKET.model_dump(exclude={"angle"}), **change}))


def test_pins_that_cannot_be():
    good = PINS.model_dump(exclude={"angle"})
    parse_machine(file_with(good))
    with pytest.raises(MachineFileError, match="rod_pin and link_pivot are the same point"):
        parse_machine(file_with({**good, "rod_pin": good["link_pivot"]}))
    with pytest.raises(MachineFileError, match="needs a revolute joint"):
        parse_machine(file_with(good, type="prismatic").replace("unit: rad", "unit: m"))
    with pytest.raises(MachineFileError, match="unknown key; did you mean 'rod_pin'"):
        parse_machine(file_with({**good, "rodpin": [0.0, 0.0]}))
    with pytest.raises(MachineFileError, match="check the four points, retracted"):
        parse_machine(file_with({**good, "retracted": 1.5}))
