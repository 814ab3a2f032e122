"""Cases recording by recording: what is measured beside what is there, with an effect and without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_backends import UNDECLARED, EffectSpec, SensorQuality, simulate_case
from sim_backends.plant.cases import STEMS, plan_case
from sim_backends.plant.plant import Plant
from sim_backends.undeclared import OUTSIDE, OUTSIDE_MISMATCH

QUALITY = SensorQuality()


@pytest.fixture(scope="module")
def plan():
    return plan_case("folding", 6, seconds=10.0)


@pytest.mark.slow
def test_a_plan_records_what_the_case_has(plan) -> None:
    effects = (EffectSpec("stribeck", "joint2", 40.0),)
    case = simulate_case("folding", 6, effects, QUALITY, 10.0)
    assert tuple(case.recordings) == STEMS
    for stem in ("unloaded", "repeat"):
        measured, _ = plan.record(stem, effects, QUALITY)
        for name, column in measured.items():
            np.testing.assert_array_equal(column, case.recordings[stem][name])


def test_measured_less_ideal_is_the_transducers_noise(plan) -> None:
    measured, ideal = plan.record("train-1", (), replace(QUALITY, pressure_resolution=0.0))
    noise = measured["joint1.head_pressure"] - ideal["joint1.head_pressure"]
    assert noise.std() == pytest.approx(QUALITY.pressure_std, rel=0.15)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.15


def test_two_ideal_tables_differ_by_the_effect_alone(plan) -> None:
    _, bare = plan.record("train-1", (), QUALITY)
    _, with_effect = plan.record("train-1", (EffectSpec("pressure_offset", "joint3", 5000.0),), QUALITY)
    for name, column in bare.items():
        expected = 5000.0 if name == "joint3.head_pressure" else 0.0
        np.testing.assert_allclose(with_effect[name] - column, expected, atol=1e-6)


def test_an_effect_keeps_its_hidden_shape_behind_one_of_size_zero(plan) -> None:
    first, second = EffectSpec("gas_spring", "joint1", 100.0), EffectSpec("position_harmonic", "joint2", 50.0)
    _, bare = plan.record("train-1", (), QUALITY)
    _, alone = plan.record("train-1", (replace(first, size=0.0), second), QUALITY)
    _, both = plan.record("train-1", (first, second), QUALITY)
    name = "joint2.head_pressure"
    assert np.ptp(alone[name] - bare[name]) > 1e4
    np.testing.assert_allclose(both[name] - bare[name], alone[name] - bare[name], atol=1e-3)


@pytest.mark.slow
def test_effects_outside_the_catalogue_say_which_signals_show_them(plan) -> None:
    rng = np.random.default_rng(0)
    for effect, kind in UNDECLARED.items():
        spec = EffectSpec(effect, None if kind.base_wide else "joint3", 1e-3)
        (built,) = Plant(plan.machine, plan.truth, undeclared=[spec], rng=rng).effects
        assert bool(built.variables()) == (effect in (*OUTSIDE, *OUTSIDE_MISMATCH))
        for variable in built.variables():
            joint, _, signal = variable.rpartition(".")
            assert signal in {"piston_position", "piston_speed", "piston_acceleration", "joint_position"} | {
                "time_since_reversal",
                "distance_since_reversal",
                "total_flow",
                "link_angle",
                "cylinder_force",
                "head_pressure",
                "rod_pressure",
                "time",
                "oil_temperature",
            }
            assert joint in {"", *(j.name for j in plan.machine.joints)} - {"joint3"}
