"""The offline plant against independent physics: energy, geometry, and a fit of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, filtfilt

from daq.errors import InputError
from daq.machine.machine_file import Cylinder, Machine, parse_machine
from sim_backends import (
    Plant,
    SensorQuality,
    Truth,
    excavator_front,
    folding_arm,
    random_motion,
    record,
    slewing_arm,
    telescopic_crane,
)
from sim_backends.plant.arm import Arm, ArmDesign
from sim_backends.plant.hydraulics import chamber_pressures
from sim_backends.plant.truth import CylinderTruth, DriveTruth, Hydraulics, LinkTruth

QUIET = SensorQuality.perfect()
ARMS = [folding_arm, slewing_arm, excavator_front, telescopic_crane]


def hydraulic_force(table, joint) -> np.ndarray:
    """p1 A1 - p2 A2 of a recording in SI units."""
    c = joint.cylinder
    return table[f"{joint.name}.head_pressure"] * c.head_area - table[f"{joint.name}.rod_pressure"] * c.rod_area


def homogeneous(machine: Machine, q: np.ndarray) -> list[np.ndarray]:
    """Distal frames by multiplying Denavit-Hartenberg matrices, written here on its own."""
    frames, frame = [], np.eye(4)
    for joint, value in zip(machine.joints, q, strict=True):
        dh = joint.dh
        theta, d = (dh.theta + value, dh.d) if joint.type == "revolute" else (dh.theta, dh.d + value)
        ct, st_, ca, sa = np.cos(theta), np.sin(theta), np.cos(dh.alpha), np.sin(dh.alpha)
        frame = frame @ np.array(
            [
                [ct, -st_ * ca, st_ * sa, dh.a * ct],
                [st_, ct * ca, -ct * sa, dh.a * st_],
                [0, sa, ca, d],
                [0, 0, 0, 1],
            ]
        )
        frames.append(frame)
    return frames


def energies(machine: Machine, truth: Truth, q: np.ndarray, qd: np.ndarray) -> tuple[float, float]:
    """Kinetic and potential energy of the links, from frames and their derivative along the motion."""
    h = 1e-6
    ahead, behind = homogeneous(machine, q + h * qd), homogeneous(machine, q - h * qd)
    kinetic = potential = 0.0
    gravity = np.array(machine.gravity)
    for link, frame, plus, minus in zip(truth.links, homogeneous(machine, q), ahead, behind, strict=True):
        xx, xy, xz, yy, yz, zz = link.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        second = 0.5 * np.trace(tensor) * np.eye(3) - tensor  # integral of r r^T dm
        pseudo = np.zeros((4, 4))
        pseudo[:3, :3], pseudo[:3, 3], pseudo[3, :3], pseudo[3, 3] = second, link.moment, link.moment, link.mass
        rate = (plus - minus) / (2 * h)
        kinetic += 0.5 * np.trace(rate @ pseudo @ rate.T)
        potential -= float(gravity @ (frame @ np.append(link.moment, link.mass))[:3])
    return kinetic, potential


@pytest.mark.parametrize("arm", ARMS)
def test_effort_obeys_lagrange(arm):
    """tau_i = d/dt(dT/dq'_i) - dT/dq_i + dV/dq_i, with T and V from this file's own kinematics."""
    machine, truth = arm(3)
    light = replace(truth, cylinders={n: replace(c, m=1e-9) for n, c in truth.cylinders.items()})
    rng = np.random.default_rng(0)
    count = len(machine.joints)
    q, qd, qdd = rng.uniform(-0.6, 0.6, (3, count))
    effort = Arm(ArmDesign(machine, light)).effort(q[None], qd[None], qdd[None])[0]
    h = 1e-3
    rounding = max(2e-3, 1e-7 * np.abs(effort).max())  # differences of step 1e-3
    for i in range(count):
        e = np.eye(count)[i] * h

        def momentum(at, rate, e=e):
            return (energies(machine, truth, at, rate + e)[0] - energies(machine, truth, at, rate - e)[0]) / (2 * h)

        forward = momentum(q + h * qd + 0.5 * h * h * qdd, qd + h * qdd)
        backward = momentum(q - h * qd + 0.5 * h * h * qdd, qd - h * qdd)
        (t1, v1), (t0, v0) = energies(machine, truth, q + e, qd), energies(machine, truth, q - e, qd)
        expected = (forward - backward) / (2 * h) - (t1 - t0) / (2 * h) + (v1 - v0) / (2 * h)
        assert effort[i] == pytest.approx(expected, rel=2e-5, abs=rounding)


def test_tendons_obey_the_law_of_cosines_and_carry_the_pistons_mass():
    machine, truth = folding_arm(1)
    heavy = replace(truth, cylinders={n: replace(c, m=c.m + 50.0) for n, c in truth.cylinders.items()})
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.uniform(-0.6, 0.6, (3, 20, 6))
    arm = Arm(ArmDesign(machine, truth))
    x, v, a, r = arm.piston(q, qd, qdd)
    for j, joint in enumerate(machine.joints):
        np.testing.assert_allclose(x[:, j], joint.cylinder.linkage.piston_position(q[:, j]), atol=1e-9)
    extra = Arm(ArmDesign(machine, heavy)).effort(q, qd, qdd) - arm.effort(q, qd, qdd)
    np.testing.assert_allclose(extra, r * 50.0 * a, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(v, r * qd)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_without_noise_the_recording_is_the_model(arm):
    """p1 A1 - p2 A2 = m x'' + c x' + K x + F_d + F_l at every sample, with derivatives of the motion itself."""
    machine, truth = arm(2)
    motion = random_motion(machine, np.random.default_rng(5), 8.0)
    table = record(machine, truth, motion, quality=QUIET, rng=np.random.default_rng(0))
    plant = Plant(machine, truth, quality=QUIET, rng=np.random.default_rng(0))
    plant.controller.follow(motion, at_once=True)
    block, _, _ = plant.step(8000)
    at = np.arange(20 - 1, 8000 - 20, 20)
    efforts = plant.arm.effort(block.q[at], block.qd[at], block.qdd[at])  # with the masses of most pistons
    for j, joint in enumerate(machine.joints):
        c, law = joint.cylinder, truth.cylinders[joint.name]
        force = hydraulic_force(table, joint)
        v, x, r = block.v[at, j], block.x[at, j], block.lever[at, j]
        clear = np.abs(v) > 2e-3
        friction = law.f_c * np.sign(v) + law.f_v * v + law.f_s * np.abs(v) ** (1 / 3) * np.sign(v)
        piston = 0.0 if plant.arm.has_tendon[j] else law.m * block.a[at, j]
        expected = efforts[:, j] / r + piston + c.damping * v + law.K * x + friction
        np.testing.assert_allclose(force[1:][clear], expected[clear], rtol=1e-9, atol=1e-4)
        encoder = machine.channel("joint_position", joint.name).name
        np.testing.assert_allclose(table[encoder][1:], block.q[at, j], atol=1e-12)


def test_a_fit_on_a_quiet_unloaded_recording_finds_all_five_parameters():
    """Least squares of its own; x'', x' from a spline through the recorded positions."""
    machine, truth = folding_arm(0)
    motion = random_motion(machine, np.random.default_rng(4), 30.0, rods="unpinned")
    table = record(machine, truth, motion, quality=QUIET, rng=np.random.default_rng(9))
    for joint in machine.joints:
        c, law = joint.cylinder, truth.cylinders[joint.name]
        x = table[f"{joint.name}.piston_position"]
        spline = make_interp_spline(table["time"], x, k=5)
        v, acceleration = spline.derivative(1)(table["time"]), spline.derivative(2)(table["time"])
        clear = np.abs(v) > 2e-3
        columns = np.stack([acceleration, x, np.sign(v), v, np.cbrt(v)], axis=1)
        measured = hydraulic_force(table, joint) - c.damping * v
        theta, *_ = np.linalg.lstsq(columns[clear], measured[clear], rcond=None)
        np.testing.assert_allclose(theta, [law.m, law.K, law.f_c, law.f_v, law.f_s], rtol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("arm", [folding_arm, slewing_arm])
def test_a_fit_on_a_noisy_unloaded_recording_finds_stiffness_and_friction(arm):
    """60 s with default noise, filtered at 3 Hz. The mass is not asked for: its force is below the disturbance."""
    machine, truth = arm(0)
    motion = random_motion(machine, np.random.default_rng(4), 60.0, rods="unpinned")
    table = record(machine, truth, motion, rng=np.random.default_rng(9))
    numerator, denominator = butter(4, 3.0 / 25.0)

    def smooth(y):
        return filtfilt(numerator, denominator, y)

    for joint in machine.joints:
        law = truth.cylinders[joint.name]
        x = smooth(table[f"{joint.name}.piston_position"])
        v = np.gradient(x, 0.02)
        columns = np.stack([smooth(column) for column in (x, np.sign(v), v, np.cbrt(v))], axis=1)
        measured = smooth(hydraulic_force(table, joint) - joint.cylinder.damping * v)
        theta, *_ = np.linalg.lstsq(columns[100:-100], measured[100:-100], rcond=None)
        # Disturbance of 0.1 f_c over 60 s / 0.3 s independent samples and a travel of 0.03 m: 3 sigma.
        assert theta[0] == pytest.approx(law.K, abs=3 * 0.1 * law.f_c / np.sqrt(200) / 0.025)
        speed = 0.03  # f_c, f_v and f_s trade off: what counts is the friction at a speed
        fitted = theta[1] + theta[2] * speed + theta[3] * np.cbrt(speed)
        assert fitted == pytest.approx(law.f_c + law.f_v * speed + law.f_s * np.cbrt(speed), rel=0.03)


def test_a_recording_is_cut_from_the_machine_by_its_seed():
    machine, truth = slewing_arm(0)
    motion = random_motion(machine, np.random.default_rng(1), 4.0)
    one, same, other = (record(machine, truth, motion, rng=np.random.default_rng(s)) for s in (1, 1, 2))
    assert list(one) == ["time", *(c.name for c in machine.channels)]
    assert all(np.array_equal(one[k], same[k]) for k in one)
    moved = one["joint1.angle"] - other["joint1.angle"]
    assert 1e-6 < np.std(moved) < 1e-3, "the motion is never bit-identical, yet closely followed"
    np.testing.assert_allclose(np.diff(one["time"]), 0.02)


def test_unpinned_rods_leave_the_arm_parked_and_unloaded():
    machine, truth = folding_arm(0)
    motion = random_motion(machine, np.random.default_rng(1), 6.0, rods="unpinned")
    table = record(machine, truth, motion, rng=np.random.default_rng(1))
    for joint in machine.joints:
        assert np.abs(table[f"{joint.name}.angle"]).max() < 1e-4
        assert np.ptp(table[f"{joint.name}.piston_position"]) > 0.3 * np.ptp(motion.positions[:, 0])
        # Friction and stiffness only, none of the arm's kilonewtons.
        assert np.abs(hydraulic_force(table, joint)).max() < 1500.0


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000), arm=st.sampled_from(ARMS), unpinned=st.booleans())
def test_random_motions_keep_all_limits_and_use_them(seed, arm, unpinned):
    machine, _ = arm(seed)
    motion = random_motion(machine, np.random.default_rng(seed), 30.0, rods="unpinned" if unpinned else "pinned")
    for k, joint in enumerate(machine.joints):
        low, high = joint.limits.position
        lever = 1.0
        if unpinned:
            q = np.linspace(low, high, 201)
            x = joint.cylinder.linkage.piston_position(q)
            low, high, lever = x.min(), x.max(), np.abs(np.gradient(x, q)).max()
            assert low >= 0 and high <= joint.cylinder.stroke
        p = motion.positions[:, k]
        speed = np.abs(np.gradient(p, motion.time)).max()
        use = max(np.abs(p - (low + high) / 2).max() / ((high - low) / 2), speed / (joint.limits.velocity * lever))
        assert p.min() >= low and p.max() <= high and speed <= joint.limits.velocity * lever
        assert use > 0.7 or np.abs(np.diff(p, 2)).max() * 2500 > 0.7 * joint.limits.acceleration * lever


@given(force=st.floats(-3e4, 3e4), speed=st.floats(-0.3, 0.3))
def test_chambers_carry_exactly_the_force_and_are_never_negative(force, speed):
    cylinder = BENCH_CYLINDER
    p1, p2 = chamber_pressures(
        np.array([force]), np.array([speed]), cylinder.head_area, cylinder.rod_area, Hydraulics()
    )
    assert p1[0] * cylinder.head_area - p2[0] * cylinder.rod_area == pytest.approx(force, abs=1e-6)
    assert p1[0] > 0.3e6 and p2[0] > 0.3e6


def one_joint(kind: str, cylinder: str, channels: str) -> Machine:
    return parse_machine(
        f"""
schema: hilfit/machine/1
name: bench
gravity: [0.0, -9.81, 0.0]
joints:
- name: axis
  type: {kind}
  dh: {{a: 0.4, alpha: 0.0, d: 0.1, theta: 0.3}}
  limits: {{position: [-0.2, 0.2], velocity: 0.4, acceleration: 2.0}}
  cylinder: {cylinder}
channels:
{channels}
"""
    )


UNITS = {"joint_position": "rad", "piston_position": "m", "head_pressure": "Pa", "rod_pressure": "Pa"}
PRESSURES = "\n".join(
    f"- {{name: {name}, quantity: {name}, joint: axis, unit: {unit}}}" for name, unit in UNITS.items()
)
BENCH_CYLINDER = Cylinder.model_validate({"bore": 0.08, "rod": 0.0448, "stroke": 0.3, "linkage": {"type": "direct"}})
LINK = LinkTruth(12.0, (3.0, 0.2, 0.0), (0.3, 0.0, 0.0, 0.9, 0.0, 1.0))


@pytest.mark.parametrize(
    "linkage",
    ["{type: rack, radius: 0.3, zero: -0.4}", "{type: polynomial, coefficients: [0.12, 0.3, 0.0]}"],
)
def test_rack_and_polynomial_give_the_same_machine_where_their_laws_agree(linkage):
    text = f"{{bore: 0.05, rod: 0.03, stroke: 0.3, linkage: {linkage}}}"
    machine = one_joint("revolute", text, PRESSURES)
    truth = Truth((LINK,), {"axis": CylinderTruth(3.0, 200.0, 20.0, 100.0, 10.0)})
    motion = random_motion(machine, np.random.default_rng(0), 5.0)
    table = record(machine, truth, motion, quality=QUIET, rng=np.random.default_rng(0))
    np.testing.assert_allclose(table["piston_position"], 0.3 * table["joint_position"] + 0.12, atol=1e-9)
    c = machine.joints[0].cylinder
    q = table["joint_position"]
    qdd = np.gradient(np.gradient(q, 0.02), 0.02)
    force = table["head_pressure"] * c.head_area - table["rod_pressure"] * c.rod_area
    v = 0.3 * np.gradient(q, 0.02)
    angle = 0.3 + q  # the link's moment is given in its distal frame, which only turns about z
    lx, ly = 3.0, 0.2  # first moments about the distal origin
    ax = 12.0 * 0.4 + lx  # about the joint axis: the distal origin is 0.4 m out
    weight = 9.81 * (ax * np.cos(angle) - ly * np.sin(angle))
    inertia = 1.0 + 12.0 * 0.4**2 + 2 * 0.4 * lx  # parallel axes through first moments
    expected = (inertia * qdd + weight) / 0.3 + 3.0 * 0.3 * qdd + 200.0 * (0.3 * q + 0.12)
    expected += 20.0 * np.sign(v) + 100.0 * v + 10.0 * np.cbrt(v)
    clear = np.abs(v) > 5e-3
    clear[:5] = clear[-5:] = False
    np.testing.assert_allclose(force[clear], expected[clear], rtol=2e-3, atol=1.5)  # differences at 50 Hz


def test_a_direct_drive_measures_its_effort():
    channels = (
        "- {name: q, quantity: joint_position, joint: axis, unit: mm}\n"
        "- {name: f, quantity: joint_effort, joint: axis, unit: N}"
    )
    machine = one_joint("prismatic", "null", channels)
    truth = Truth((LINK,), {}, {"axis": DriveTruth(7.0, 30.0, 4.0)})
    motion = random_motion(machine, np.random.default_rng(0), 5.0)
    table = record(machine, truth, motion, quality=QUIET, rng=np.random.default_rng(0))
    spline = make_interp_spline(table["time"], table["q"], k=5)
    v, a = spline.derivative(1)(table["time"]), spline.derivative(2)(table["time"])
    clear = np.abs(v) > 5e-3
    clear[:5] = clear[-5:] = False
    expected = 16.0 * a + 7.0 * np.sign(v) + 30.0 * v  # gravity is across the slide
    np.testing.assert_allclose(table["f"][clear], expected[clear], atol=0.02)


def test_parameters_of_another_arm_are_refused():
    machine, truth = folding_arm(0)
    with pytest.raises(InputError, match=r"1 links, folding-arm has 6 joints"):
        Plant(machine, Truth((LINK,)), rng=np.random.default_rng(0))
    few = replace(truth, cylinders={"joint1": truth.cylinders["joint1"]})
    with pytest.raises(InputError, match=r"lack cylinders\.joint2"):
        Plant(machine, few, rng=np.random.default_rng(0))
