"""Measured joint velocities: how much weight they get, what that is worth, and what a bad one cannot do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import RATE, Noise, make_motion, make_recordings, planar_machine, prepare, truth
from test_coupled_drives import WRIST, measured, motion

from daq.machine.machine_file import Machine, MachineFileError, parse_machine
from daq.recordings.recording import Recording
from fitting.arm.joint_side import at_joints
from fitting.loop.session import Options, Session
from fitting.signals.filters import advanced, filter_bank
from fitting.signals.position_sensors import velocity_share
from fitting.signals.preparation import position_noise

BANK = filter_bank(RATE, 3.0)
ROLES = (("train", 2), ("validate", 3))


def with_velocity(kinds: str = "r", sensors: str = "joint") -> Machine:
    tree = planar_machine(kinds=kinds, sensors=sensors).model_dump(mode="json", by_alias=True)
    for joint in tree["joints"]:
        unit = "rad/s" if joint["type"] == "revolute" else "m/s"
        name = joint["name"]
        tree["channels"].append({"name": f"{name}.speed", "quantity": "joint_velocity", "joint": name, "unit": unit})
    return parse_machine(yaml.safe_dump(tree))


def recorded(
    machine: Machine, std: float, noise: Noise, late: float = 0.0, gain: float = 1.0, roles: tuple = ROLES
) -> list[Recording]:
    """Recordings of a machine of :func:`with_velocity`; velocity sensors of ``std``, ``gain``, ``late`` samples."""
    arm = truth(len(machine.joints))
    plain = planar_machine(kinds="".join("Rr"[j.cylinder is None] for j in machine.joints), sensors="both")
    result = []
    for number, recording in enumerate(make_recordings(plain, arm, roles, noise=noise, seconds=30.0)):
        rng = np.random.default_rng(number)
        moved = make_motion(plain, roles[number][0], roles[number][1], 30.0)
        values = dict(recording.values)
        for j, joint in enumerate(machine.joints):
            clean = gain * advanced(moved.qd[:, j], -late)
            values[f"{joint.name}.speed"] = clean + std * rng.normal(size=len(clean))
        result.append(replace(recording, values={c.name: values[c.name] for c in machine.channels}))
    return result


def errors(machine: Machine, recordings: list[Recording]) -> tuple[float, float]:
    """Standard deviation of prepared speeds and accelerations from the truth."""
    segment = prepare(machine, recordings[:1], BANK)[0]
    moved = make_motion(machine, ROLES[0][0], ROLES[0][1], 30.0)
    part = slice(segment.start, segment.start + len(segment))
    return float(np.std(segment.qd - moved.qd[part])), float(np.std(segment.qdd - moved.qdd[part]))


def test_a_quiet_velocity_makes_speed_and_acceleration_quieter_as_promised() -> None:
    noise, machine = Noise(joint=1e-3), with_velocity()
    recordings = recorded(machine, 2e-3, noise)
    without = errors(planar_machine(kinds="r"), recordings)
    fused = errors(machine, recordings)
    said = position_noise(machine, recordings, BANK)[0]
    assert fused[0] < 0.5 * without[0]
    assert fused[1] < 0.7 * without[1]
    # The noise that the rest of the program is told is the noise that is there (a thousand independent samples or so).
    assert said.speed == pytest.approx(fused[0], rel=0.25)
    assert said.acceleration == pytest.approx(fused[1], rel=0.25)


@given(st.floats(-5, -1), st.floats(-4, 0))
@settings(max_examples=20, deadline=None)
def test_weights_are_inverse_variances(position: float, velocity: float) -> None:
    rng = np.random.default_rng(1)
    q_std, v_std = 10.0**position, 10.0**velocity
    t = np.arange(3000) / RATE
    q = np.sin(t) + q_std * rng.normal(size=len(t))
    v = np.cos(t) + v_std * rng.normal(size=len(t))
    share = velocity_share(q, v, [slice(0, len(t))], BANK, q_std, v_std)
    # Monte Carlo instead of kernels' norms: what is left of both noises in the smoothed signals.
    derived = np.std(BANK.smooth(q_std * rng.normal(size=20_000))[1])
    smoothed = np.std(BANK.smoothed(v_std * rng.normal(size=20_000)))
    best = derived**2 / (derived**2 + smoothed**2)
    assert 0.0 <= share.speed <= min(1.0, 1.1 * best + 1e-9)  # never more than noise justifies
    if 1e-3 < best < 0.9:  # above, filters' own errors (1e-3 of the motion) weigh more than such a quiet sensor
        assert share.speed == pytest.approx(best, rel=0.35)


@pytest.mark.parametrize(("late", "gain"), [(3.0, 1.0), (0.0, 1.2)])
def test_a_late_or_wrongly_scaled_velocity_loses_its_weight(late: float, gain: float) -> None:
    noise, machine = Noise(joint=2e-5), with_velocity()
    recordings = recorded(machine, 1e-4, noise, late, gain)
    without = errors(planar_machine(kinds="r"), recordings)
    fused = errors(machine, recordings)
    assert fused[0] < 1.1 * without[0] and fused[1] < 1.1 * without[1]


def test_a_cylinders_piston_moves_with_the_fused_joint() -> None:
    noise = Noise(joint=1e-3, piston=1e-3)
    for sensors in ("joint", "piston", "both"):
        machine = with_velocity("R", sensors)
        recordings = recorded(machine, 1e-3, noise)
        segment = prepare(machine, recordings[:1], BANK)[0]
        moved = make_motion(machine, *ROLES[0], 30.0)
        part = slice(segment.start, segment.start + len(segment))
        plain = prepare(planar_machine(1, sensors=sensors), recordings[:1], BANK)[0]
        assert np.std(segment.v - moved.v[part]) < 0.6 * np.std(plain.v - moved.v[part]), sensors
        np.testing.assert_allclose(segment.v, segment.r * segment.qd, atol=1e-12)


def test_an_unpinned_rod_moves_without_the_joint_that_the_velocity_is_of() -> None:
    machine = with_velocity("R", "both")
    roles = (("unloaded", 1), ("train", 2))
    recordings = recorded(machine, 1e-3, Noise(), roles=roles)
    segment = prepare(machine, recordings[:1], BANK)[0]
    assert not segment.qd.any() and segment.v.any()


def test_replicas_of_a_session_carry_velocities() -> None:
    """A session with a velocity runs where recordings are drawn anew."""
    from fitting.residual.null import Replicas
    from fitting.signals.preparation import position_channel_noise

    machine = with_velocity()
    session = Session(machine, recorded(machine, 2e-3, Noise()), Options())
    stds = position_channel_noise(session.machine, session.recordings)
    assert stds["joint1.speed"] == pytest.approx(2e-3, rel=0.1)
    stretch = np.zeros(2000)
    drawn = Replicas(session.base_model, stds, [[stretch]]).draw(np.random.default_rng(0))
    assert set(drawn[0].values) == {c.name for c in machine.channels}


def test_motor_velocities_tell_their_joints() -> None:
    text = WRIST + (
        "- {name: m1.speed, quantity: motor_velocity, joint: bend, unit: rad/s}\n"
        "- {name: m2.speed, quantity: motor_velocity, joint: turn, unit: rpm}\n"
    )
    machine = parse_machine(text)
    _, _, qd, _ = motion()
    made = measured()
    R = machine.ratios
    values = {**made.values, "m1.speed": qd @ R[0], "m2.speed": qd @ R[1]}
    joints, (recording,) = at_joints(machine, [replace(made, values=values)])
    for number, joint in enumerate(joints.joints):
        channel = joints.channel("joint_velocity", joint.name)
        assert channel is not None
        np.testing.assert_allclose(recording.values[channel.name], qd[:, number], atol=1e-12)
    lone = WRIST + "- {name: m2.speed, quantity: motor_velocity, joint: turn, unit: rad/s}\n"
    with pytest.raises(MachineFileError, match=r"joints\.turn: its motor_velocity .* speed of bend"):
        parse_machine(lone)
    beside = lone + "- {name: bend.speed, quantity: joint_velocity, joint: bend, unit: rad/s}\n"
    values = {**made.values, "m2.speed": qd @ R[1], "bend.speed": qd[:, 0]}
    joints, (recording,) = at_joints(parse_machine(beside), [replace(made, values=values)])
    np.testing.assert_allclose(recording.values["turn.velocity_from_motors"], qd[:, 1], atol=1e-12)
