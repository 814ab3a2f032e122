"""Lambda: noise as the plant makes it, blindness to what the base model can take, and linearity in size."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy import signal

from benchmarks.attribution.sight import FITTED, Sight, delayed, inertias, noise_covariance, restlessness
from fitting.arm.linkage import lever_arm
from sim_backends.plant.arm import ArmDesign, arm_xml
from sim_backends.plant.cases import CasePlan, plan_case
from sim_backends.plant.controller import LOOP_DAMPING, LOOP_FREQUENCY, VALVE_NOISE_TIME, output_std
from sim_backends.plant.linear_filter import ColouredNoise, second_order
from sim_backends.plant.plant import Plant
from sim_backends.plant.truth import SensorQuality
from sim_backends.undeclared import EffectSpec

pytestmark = pytest.mark.slow

QUALITY = SensorQuality(knock_rate=0.05)


def ideal(plan: CasePlan, *effects: EffectSpec):
    return {stem: plan.record(stem, effects, QUALITY)[1] for stem in FITTED}


@pytest.fixture(scope="module")
def plan():
    return plan_case("slewing", 5, seconds=20.0)


@pytest.fixture(scope="module")
def bare(plan):
    return ideal(plan)


@pytest.fixture(scope="module")
def sight(plan, bare):
    return Sight(plan.machine, plan.truth, QUALITY, bare)


@pytest.fixture(scope="module")
def standing(plan):
    """Noise in the hydraulic force of joint 1, 600 s: nothing moves, so what is there is noise."""
    still = replace(QUALITY, tracking=0.0)
    plant = Plant(plan.machine, plan.truth, quality=still, rng=np.random.default_rng(0))
    values = plant.advance(round(600 * plan.machine.rate_hz))
    names = [channel.name for channel in plan.machine.channels]
    cylinder = plan.machine.joints[0].cylinder
    force = (
        values[:, names.index("joint1.head_pressure")] * cylinder.head_area
        - values[:, names.index("joint1.rod_pressure")] * cylinder.rod_area
    )
    return force - force.mean()


@pytest.mark.slow
def test_the_noise_has_the_covariance_of_the_formula(plan, standing) -> None:
    expected = noise_covariance(plan.machine, plan.truth, QUALITY, 0, 50)
    for lag in (0, 1, 2, 5):
        found = float(np.mean(standing[: len(standing) - lag] * standing[lag:]))
        assert found == pytest.approx(expected[lag], rel=0.12)


def test_whitened_noise_is_white_inside_the_band_and_not_above_one(plan, bare, standing) -> None:
    sight = Sight(plan.machine, plan.truth, QUALITY, bare, positions=False)  # nothing moves here
    pieces = np.array_split(standing, 30)
    white = np.concatenate([sight._white(0, piece[: min(map(len, pieces))], "train-1") for piece in pieces])
    # The floor under the filter's stop band takes about a tenth of the variance, and nothing else does.
    assert 0.8 < white.var() < 1.0


@pytest.mark.parametrize("what", ["link", "cylinder"])
def test_what_the_base_model_can_take_is_invisible(plan, bare, sight, what: str) -> None:
    links, cylinders = list(plan.truth.links), dict(plan.truth.cylinders)
    if what == "link":
        scaled = [1.1 * value for value in links[2].as_list()]
        links[2] = type(links[2]).from_list(scaled)
    else:
        law = cylinders["joint2"]
        cylinders["joint2"] = replace(law, m=1.3 * law.m, K=1.2 * law.K, f_v=1.3 * law.f_v, f_s=1.2 * law.f_s)
    other = replace(plan, truth=replace(plan.truth, links=tuple(links), cylinders=cylinders))
    changed = ideal(other)
    moved = max(float(np.ptp(changed[s][n] - bare[s][n])) for s in FITTED for n in bare[s] if "pressure" in n)
    assert moved > 1e4  # Pa: it does show in the pressures
    assert sight.force(changed) < 0.5


@pytest.mark.slow
def test_lambda_grows_with_the_size_and_sits_at_the_joint(plan, sight) -> None:
    one, two = (
        sight.force(ideal(plan, EffectSpec("position_dependent_friction", "joint2", size))) for size in (20.0, 40.0)
    )
    assert one > 4
    assert two == pytest.approx(2 * one, rel=0.02)
    assert sight.force(ideal(plan, EffectSpec("position_dependent_friction", "joint2", 0.0))) == 0.0


@pytest.mark.slow
def test_lambda_falls_with_the_noise(plan, bare) -> None:
    effect = ideal(plan, EffectSpec("gas_spring", "joint3", 200.0))
    quiet, loud = (
        Sight(plan.machine, plan.truth, replace(QUALITY, disturbance=d, pressure_std=p), bare).force(effect)
        for d, p in ((0.05, 500.0), (0.5, 5000.0))
    )
    assert quiet > 5 * loud > 0


@pytest.mark.slow
def test_lambda_falls_with_the_noise_of_the_encoders_where_much_is_turned(plan, bare) -> None:
    effect = ideal(plan, EffectSpec("gas_spring", "joint1", 200.0))
    still = replace(QUALITY, encoder_resolution=0.0, piston_std=0.0, piston_resolution=0.0, tracking=0.0)
    seen = [
        Sight(plan.machine, plan.truth, replace(still, encoder_std=std), bare, positions)
        for std, positions in ((1e-2, True), (1e-5, True), (0.0, True), (1e-2, False))
    ]
    coarse, fine, none, not_counted = (sight.force(effect) for sight in seen)
    assert coarse < 0.95 * fine < none == pytest.approx(not_counted)


def test_noise_of_accelerations_meets_the_mass_matrix_of_another_engine(plan, bare) -> None:
    model = mujoco.MjModel.from_xml_string(arm_xml(ArmDesign(plan.machine, plan.truth)))
    data, joints = mujoco.MjData(model), plan.machine.joints
    q = np.stack([bare["train-1"][f"{joint.name}.angle"] for joint in joints], axis=1)
    expected = []
    for pose in q[:: len(q) // 50]:
        columns = []
        for acceleration in np.vstack([np.zeros(len(joints)), np.eye(len(joints))]):
            data.qpos[:], data.qvel[:], data.qacc[:] = pose, 0.0, acceleration
            mujoco.mj_inverse(model, data)
            columns.append(data.qfrc_inverse.copy())
        mass = np.array(columns[1:]).T - columns[0][:, None]
        lever = np.array([lever_arm(j.cylinder.linkage, pose[k]) for k, j in enumerate(joints)])
        own = np.diag([plan.truth.cylinders[j.name].m for j in joints]) * lever
        expected.append((mass / lever[:, None] + own) ** 2)
    found, wanted = inertias(plan.machine, plan.truth, q), np.mean(expected, axis=0)
    np.testing.assert_allclose(found.sum(axis=1), wanted.sum(axis=1), rtol=0.01)
    np.testing.assert_allclose(found, wanted, rtol=0.02, atol=1e-6 * wanted.max())


def test_what_restless_joints_do_above_half_the_rate_is_folded_into_the_band(plan) -> None:
    """The controller's loop, step by step: its sampled acceleration less what its sampled position tells."""
    dt, rate, seconds = 0.001, plan.machine.rate_hz, 600.0
    drive = ColouredNoise(VALVE_NOISE_TIME, dt, 1, np.random.default_rng(2))
    error, _, change = second_order(LOOP_FREQUENCY, LOOP_DAMPING, dt)(drive(round(seconds / dt)))
    step = round(1 / (rate * dt))
    frequency, _, position = signal.stft(error[::step, 0], rate, nperseg=2048)
    _, _, acceleration = signal.stft(change[::step, 0], rate, nperseg=2048)
    left = acceleration + (2 * np.pi * frequency[:, None]) ** 2 * position
    inside = (frequency > 0.5) & (frequency < 3.0)
    window = signal.windows.hann(2048, sym=False)
    density = np.mean(np.abs(left[inside]) ** 2) * np.sum(window) ** 2 / np.sum(window**2)
    quality = replace(QUALITY, encoder_std=0.0, encoder_resolution=0.0, tracking=output_std())
    span = float(np.ptp(plan.machine.joints[0].limits.position))
    counted = restlessness(plan.machine, quality, True, 10)[0]
    assert density == pytest.approx(counted[0] / span**2, rel=0.1) and not counted[1:].any()


def test_a_line_above_the_band_is_seen_without_the_filter_only(plan, bare) -> None:
    sight = Sight(plan.machine, plan.truth, QUALITY, bare, lines=False)
    amplitude, frequency = 2.0e4, 7.0
    tables = {
        stem: {
            **table,
            "joint1.head_pressure": table["joint1.head_pressure"]
            + amplitude * np.sin(2 * np.pi * frequency * table["time"]),
        }
        for stem, table in bare.items()
    }
    covariance = noise_covariance(plan.machine, plan.truth, QUALITY, 0, 400)
    lags = np.arange(1, 400)
    density = covariance[0] + 2 * np.cos(2 * np.pi * frequency / 50 * lags) @ covariance[1:]
    samples = sum(len(table["time"]) for table in bare.values())
    force = amplitude * plan.machine.joints[0].cylinder.head_area
    assert sight.broadband(tables) == pytest.approx(np.sqrt(samples * force**2 / 2 / density), rel=0.02)
    assert sight.force(tables) < 0.1 * sight.broadband(tables)
    # A restless arm hides some of it: the more, the less quiet its encoders are.
    restless = [replace(QUALITY, encoder_std=std) for std in (0.0, 2e-5, 1e-4)]
    seen = [Sight(plan.machine, plan.truth, own, bare).broadband(tables) for own in restless]
    assert sight.broadband(tables) >= seen[0] > seen[1] > seen[2]


def test_of_a_delay_is_counted_what_samples_tell_of_it(plan) -> None:
    rate, tau, rng = plan.machine.rate_hz, 0.7e-3, np.random.default_rng(4)
    time = np.arange(200_000) / rate
    turns = np.cumsum(rng.uniform(0.5, 1.5, 5000))
    force = np.where(np.searchsorted(turns, time) % 2, -1.0, 1.0)
    late = np.where(np.searchsorted(turns, time - tau) % 2, -1.0, 1.0)
    table = {
        "time": time,
        "joint1.head_pressure": force,
        "joint1.rod_pressure": np.sin(2.0 * time),
        "joint2.angle": time,
    }
    told = delayed(plan.machine, {"a": table}, "joint1", tau)["a"]
    assert np.allclose(told["joint1.rod_pressure"], np.sin(2.0 * (time - tau)), atol=(2 * tau) ** 2)
    assert told["joint2.angle"] is time
    band = signal.firwin(101, 3.0, fs=rate)
    true, counted = (np.convolve(own - force, band, "valid") for own in (late, told["joint1.head_pressure"]))
    assert true @ counted / (counted @ counted) == pytest.approx(1.0, abs=0.25), "the same on the average"
    assert true @ true / (counted @ counted) == pytest.approx(1 / (tau * rate), rel=0.25), "and far less of it"


def test_mismatch_is_counted_in_noise_widths_of_the_gap(plan, sight) -> None:
    offset = 2.0e-4
    changed = ideal(plan, EffectSpec("encoder_offset", "joint4", offset))
    linkage = plan.machine.joints[3].cylinder.linkage
    q = np.concatenate([changed[stem]["joint4.angle"] for stem in FITTED if stem != "unloaded"])
    gap = linkage.piston_position(q) - linkage.piston_position(q - offset)
    limits = plan.machine.joints[3].limits.position
    grid = np.linspace(*limits, 1001)
    lever = np.gradient(linkage.piston_position(grid), grid)
    angle = QUALITY.encoder_std**2 + QUALITY.encoder_resolution**2 / 12
    width = np.sqrt(QUALITY.piston_std**2 + QUALITY.piston_resolution**2 / 12 + angle * np.mean(lever**2))
    assert sight.mismatch(changed) == pytest.approx(np.sqrt(np.mean(gap**2)) / width, rel=0.01)
    assert sight.mismatch(changed, zeros=1) > 0.1 * sight.mismatch(changed)
    assert sight.mismatch(changed, zeros=2) < 0.02 * sight.mismatch(changed), "a zero explains all of it"
    assert sight.force(changed) == 0.0
