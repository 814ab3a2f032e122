"""Motors instead of joints: signals, columns and parameters of coupled drives; test benches with a load cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from arm_examples import inverse_dynamics, standard_names
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.measured import staubli
from daq.machine.machine_file import Machine, parse_machine
from daq.recordings.recording import Recording
from fitting.arm.base_parameters import base_gravity_regressor, base_regressor, reduce_parameters
from fitting.arm.dynamics import coupled_regressor, standard_regressor
from fitting.arm.geometry import geometry_of
from fitting.arm.joint_side import at_joints
from fitting.loop.session import Options, Session
from fitting.pipeline.stage_two import identify_one_shot
from fitting.regression.drive import drive_names, drive_units

RATE = 200.0
RATIO, PULL = -32.0, 16.0
WRIST = f"""
schema: hilfit/machine/1
name: wrist
rate_hz: {RATE}
gravity: [0.0, -9.81, 0.0]
joints:
- name: bend
  dh: {{a: 0.2, alpha: 1.5707963267948966, d: 0.0, theta: 0.0}}
  limits: {{position: [-2.0, 2.0], velocity: 5.0, acceleration: 50.0}}
  drive: {{ratio: 45.0, offset: true}}
- name: turn
  dh: {{a: 0.1, alpha: 0.0, d: 0.3, theta: 0.5}}
  limits: {{position: [-2.0, 2.0], velocity: 5.0, acceleration: 50.0}}
  drive: {{ratio: {RATIO}, coupled: [{{joint: bend, ratio: {PULL}}}]}}
channels:
- {{name: m1.angle, quantity: motor_position, joint: bend, unit: rad}}
- {{name: m1.torque, quantity: motor_effort, joint: bend, unit: N m}}
- {{name: m2.angle, quantity: motor_position, joint: turn, unit: rad}}
- {{name: m2.torque, quantity: motor_effort, joint: turn, unit: N m}}
"""
#: Motor 2 at its own side of the gear: Coulomb (N m), viscous (N m s/rad), inertia (kg m^2).
MOTOR = (0.02, 3e-4, 2e-5)
OWN = {"f_c": (1.5, 0.6), "f_v": (0.8, 0.3)}
OFFSET = 0.4
FloatArray = npt.NDArray[np.float64]


def wrist() -> Machine:
    return parse_machine(WRIST)


def motion(seconds: float = 30.0) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    t = np.arange(round(seconds * RATE)) / RATE
    q, qd, qdd = np.zeros((3, len(t), 2))
    rng = np.random.default_rng(5)
    for joint in range(2):
        for w in (0.9, 1.7, 3.1, 4.3):
            size, phase = rng.uniform(0.1, 0.35), rng.uniform(0, 6)
            q[:, joint] += size * np.sin(w * t + phase)
            qd[:, joint] += size * w * np.cos(w * t + phase)
            qdd[:, joint] -= size * w**2 * np.sin(w * t + phase)
    return t, q, qd, qdd


def measured() -> Recording:
    """Motor signals, with friction and inertia of motor 2 written at the motor itself."""
    machine = wrist()
    t, q, qd, qdd = motion()
    link = np.array(
        [[2.0, 0.3, 0.1, 0.2, 0.05, 0.01, 0.0, 0.06, 0.0, 0.07], [1.0, 0.1, 0.05, 0.1, 0.02, 0.0, 0.0, 0.03, 0.0, 0.02]]
    )
    tau = inverse_dynamics(machine, link, q, qd, qdd)
    for joint in range(2):
        tau[:, joint] += OWN["f_c"][joint] * np.sign(qd[:, joint]) + OWN["f_v"][joint] * qd[:, joint]
    tau[:, 0] += OFFSET
    # Gears: motor 1 turns 45 times joint 1, motor 2 turns RATIO times joint 2 plus PULL times joint 1. Their powers
    # add up to that of the joints, so the second carries joint 2 and the first what is left of joint 1.
    second = tau[:, 1] / RATIO
    first = (tau[:, 0] - PULL * second) / 45.0
    w, wd = RATIO * qd[:, 1] + PULL * qd[:, 0], RATIO * qdd[:, 1] + PULL * qdd[:, 0]
    second = second + MOTOR[0] * np.sign(w) + MOTOR[1] * w + MOTOR[2] * wd
    values = {
        "m1.angle": 45.0 * q[:, 0],
        "m1.torque": first,
        "m2.angle": RATIO * q[:, 1] + PULL * q[:, 0],
        "m2.torque": second,
    }
    return Recording("wrist", "train", "made", "", RATE, t, values)


def test_joint_positions_follow_from_the_motors() -> None:
    machine, (recording,) = at_joints(wrist(), [measured()])
    _, q, _, _ = motion()
    for number, joint in enumerate(machine.joints):
        channel = machine.channel("joint_position", joint.name)
        assert channel is not None
        np.testing.assert_allclose(recording.values[channel.name], q[:, number], atol=1e-12)
    assert not {"motor_position", "motor_effort"} & {c.quantity for c in machine.channels}


def test_power_of_the_motors_is_power_of_the_joints() -> None:
    machine, (recording,) = at_joints(wrist(), [measured()])
    _, _, qd, _ = motion()
    made = measured().values
    motors = made["m1.torque"] * 45.0 * qd[:, 0] + made["m2.torque"] * (RATIO * qd[:, 1] + PULL * qd[:, 0])
    efforts = [machine.channel("joint_effort", joint.name) for joint in machine.joints]
    joints = sum(recording.values[c.name] * qd[:, n] for n, c in enumerate(efforts) if c is not None)
    np.testing.assert_allclose(joints, motors, atol=1e-10)


def test_a_row_without_a_motor_tells_no_joint() -> None:
    made = measured()
    values = {name: column.copy() for name, column in made.values.items()}
    values["m2.angle"][7] = np.nan
    values["m2.torque"][9] = np.nan
    machine, (recording,) = at_joints(wrist(), [replace(made, values=values)])
    missing = {name: np.flatnonzero(np.isnan(column)).tolist() for name, column in recording.values.items()}
    assert missing["turn.from_motors"] == [7]
    assert missing["bend.effort_of_motors"] == missing["turn.effort_of_motors"] == [9]
    assert [part.stop - part.start for part in recording.segments()] == [7, 1, len(recording) - 10]
    assert len(machine.channels) == 4


def test_a_joint_sensor_beats_its_motor() -> None:
    text = WRIST + "- {name: bend.angle, quantity: joint_position, joint: bend, unit: rad}\n"
    made = measured()
    _, q, _, _ = motion()
    values = {**made.values, "bend.angle": q[:, 0] + 0.01}
    machine, (recording,) = at_joints(parse_machine(text), [replace(made, values=values)])
    assert [c.name for c in machine.channels if c.quantity == "joint_position"] == ["bend.angle", "turn.from_motors"]
    # Motor 2's angle is then split by the joint that is measured.
    expected = q[:, 1] - PULL / RATIO * 0.01
    np.testing.assert_allclose(recording.values["turn.from_motors"], expected, atol=1e-12)


def test_an_ordinary_machine_is_left_alone() -> None:
    machine, recordings = at_joints(wrist(), [measured()])
    again, same = at_joints(machine, recordings)
    assert again is machine
    assert same == recordings


def test_parameters_of_a_coupled_motor_are_recovered_from_motor_signals() -> None:
    session = Session(wrist(), [measured()], Options(bandwidth_hz=10.0))
    design = session.plain.design
    theta = dict(zip(design.parameters.names, identify_one_shot(design).theta, strict=True))
    assert theta["f_cm2"] == pytest.approx(abs(RATIO) * MOTOR[0], rel=0.01)
    assert theta["f_vm2"] == pytest.approx(RATIO**2 * MOTOR[1], rel=0.01)
    assert theta["Jm2"] == pytest.approx(RATIO**2 * MOTOR[2], rel=0.02)
    for joint, name in enumerate(("bend", "turn")):
        assert theta[f"{name}.f_c"] == pytest.approx(OWN["f_c"][joint], rel=0.01)
        assert theta[f"{name}.f_v"] == pytest.approx(OWN["f_v"][joint], rel=0.01)
    assert theta["bend.f_0"] == pytest.approx(OFFSET, rel=0.01)
    assert "turn.f_0" not in theta
    with pytest.raises(AssertionError):  # without the coupling the same data tells another story
        plain = parse_machine(WRIST.replace(f", coupled: [{{joint: bend, ratio: {PULL}}}]", ""))
        wrong = Session(plain, [measured()], Options(bandwidth_hz=10.0)).plain.design
        found = dict(zip(wrong.parameters.names, identify_one_shot(wrong).theta, strict=True))
        assert found["turn.f_v"] == pytest.approx(OWN["f_v"][1], rel=0.01)


def test_what_a_joint_that_stands_elsewhere_changes_is_small_where_motors_are_coupled() -> None:
    """By moving the joint a thousandth of a radian: the motor's friction changes with its speed, not by a jump."""
    recording, rng = measured(), np.random.default_rng(1)
    noisy = {n: v + (n.endswith("angle") * 0.02) * rng.standard_normal(len(v)) for n, v in recording.values.items()}
    model = Session(wrist(), (replace(recording, values=noisy),), Options(loop=False)).base_model
    for joint, view in enumerate(model.views[0]):
        wave = np.cos(2.0 * view.segment.t)
        segment, noise = view.segment, [own.speed for own in view.noise]
        moved = [values.copy() for values in (segment.q, segment.qd, segment.qdd)]
        for values, change in zip(
            moved, (wave, -2.0 * np.sin(2.0 * segment.t), -4.0 * np.cos(2.0 * segment.t)), strict=True
        ):
            values[:, joint] += 1e-3 * change
        there = base_regressor(wrist(), view.base, *moved, speed_noise=noise) @ view.base_values
        own = view.body_change(wave)
        smooth = np.abs(segment.qd @ geometry_of(wrist()).coupling[0]) > 0.02  # at a reversal a thousandth is not small
        smooth[:50] = smooth[-50:] = False  # derivatives reach beyond the ends there
        assert np.count_nonzero(smooth) > 0.8 * len(smooth)
        assert np.max(np.abs(own)) < 1e3 * float(np.max(np.abs(own[smooth])))
        assert own[smooth] == pytest.approx(1e3 * (there - view.loads)[smooth], abs=1e-2 * float(np.ptp(own)))


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_coupled_columns_are_virtual_work_of_the_motor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    qd, qdd, dq = rng.normal(size=(3, 6, 2))
    Y = coupled_regressor(wrist(), qd, qdd)
    values = rng.uniform(0.1, 2.0, 3)
    part = PULL / RATIO
    w, wd, turned = (row[:, 1] + part * row[:, 0] for row in (qd, qdd, dq))
    effort = values[0] * np.sign(w) + values[1] * w + values[2] * wd
    np.testing.assert_allclose(np.einsum("sj,sj->s", Y @ values, dq), effort * turned, atol=1e-12)


def test_the_sign_of_a_noisy_motor_speed_is_its_expectation() -> None:
    qd = np.array([[0.001, 0.0], [2.0, 2.0]])
    Y = coupled_regressor(wrist(), qd, 0 * qd, speed_noise=[0.01, 0.01])
    assert abs(Y[0, 1, 0]) < 0.2
    assert Y[1, 1, 0] == pytest.approx(np.sign(2.0 + PULL / RATIO * 2.0))


def test_standard_and_base_columns_agree() -> None:
    machine = wrist()
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(3, 40, 2))
    whole = reduce_parameters(machine, friction_by_stage_1=False)
    links = reduce_parameters(machine)
    assert whole.standard_count == links.standard_count == 29
    assert standard_names(machine)[-3:] == ("f_cm2", "f_vm2", "Jm2") == links.names[-3:]
    assert links.units[-3:] == ("N m", "N m s/rad", "kg m^2")
    assert not links.only_rigid_body
    pi = rng.normal(size=29)
    np.testing.assert_allclose(
        base_regressor(machine, whole, q, qd, qdd) @ whole.from_standard(pi),
        standard_regressor(machine, q, qd, qdd) @ pi,
        atol=1e-9,
    )
    inertial = np.concatenate([pi[:10], pi[13:23], pi[26:]])  # what reduces with friction frozen: links, then motors
    np.testing.assert_allclose(
        base_regressor(machine, links, q, qd, qdd) @ links.from_standard(inertial),
        (standard_regressor(machine, q, qd, qdd) @ np.concatenate([pi[:10], [0, 0, 0], pi[13:23], [0, 0, 0], pi[26:]])),
        atol=1e-9,
    )


def test_gravity_says_nothing_of_a_motor() -> None:
    machine = wrist()
    base = reduce_parameters(machine)
    q = np.random.default_rng(2).normal(size=(5, 2))
    turned = base_gravity_regressor(machine, base, q, [1.0, 0.0, 0.0])
    still = np.zeros_like(q)
    change = base_regressor(machine, base, q, still, still, gravity=[1.0, -9.81, 0.0]) - base_regressor(
        machine, base, q, still, still
    )
    np.testing.assert_allclose(turned, change, atol=1e-12)
    assert not turned[..., -3:].any()
    uncoupled = geometry_of(machine).uncoupled()
    assert reduce_parameters(uncoupled).only_rigid_body


def test_the_tx40_has_61_parameters() -> None:
    machine = parse_machine(staubli.MACHINE.read_text(encoding="utf-8"))
    whole = reduce_parameters(machine, friction_by_stage_1=False)
    drives = drive_names(machine)
    assert whole.standard_count == 81
    assert len(whole) == 55  # 36 of the links, 4 drive inertias, 12 of friction, 3 of motor 6
    assert sum(name == "f_0" for names in drives for name in names) == 6
    assert len(reduce_parameters(machine)) + sum(map(len, drives)) == 61
    assert [number + 1 for number, names in enumerate(drives) if "J" in names] == [3, 4, 5, 6]
    assert drive_units(machine.joints[0])["f_0"] == "N m"


BENCH = """
schema: hilfit/machine/1
name: bench
rate_hz: 100
gravity: [0.0, 0.0, 0.0]
joints:
- name: rod
  type: prismatic
  dh: {a: 0.0, alpha: 0.0, d: 0.0, theta: 0.0}
  limits: {position: [0.0, 0.1], velocity: 0.2, acceleration: 1.0}
  cylinder: {bore: 0.025, rod: 0.01, stroke: 0.1, moving_mass: 0.5, vented: rod, linkage: {type: direct}}
channels:
- {name: x, quantity: joint_position, joint: rod, unit: m}
- {name: p, quantity: head_pressure, joint: rod, unit: bar}
- {name: cell, quantity: external_force, joint: rod, unit: N}
"""


def test_a_load_cell_leaves_the_cylinders_own_friction() -> None:
    machine = parse_machine(BENCH)
    t = np.arange(3000) / 100.0
    w = 2 * np.pi * 0.4
    x, v, a = 0.05 + 0.04 * np.sin(w * t), 0.04 * w * np.cos(w * t), -0.04 * w**2 * np.sin(w * t)
    pressure = 3e5 + 4e4 * np.sin(0.3 * t)
    force = pressure * np.pi * 0.025**2 / 4 - (6.0 * np.sign(v) + 20.0 * v + 0.5 * a)
    recording = Recording("bench", "train", "made", "", 100.0, t, {"x": x, "p": pressure, "cell": force})
    session = Session(machine, [recording], Options(bandwidth_hz=8.0))
    assert session.machine.channel("rod_pressure", "rod") is not None
    segment = session.plain.design.segments[0]
    assert segment.external is not None and not segment.p2.any()
    design = session.plain.design
    theta = dict(zip(design.parameters.names, identify_one_shot(design).theta, strict=True))
    predicted = theta["rod.f_c"] + theta["rod.f_v"] * 0.08 + theta["rod.f_s"] * 0.08 ** (1 / 3)
    assert predicted == pytest.approx(6.0 + 20.0 * 0.08, rel=0.01)
    assert abs(theta["m1"]) < 0.2
