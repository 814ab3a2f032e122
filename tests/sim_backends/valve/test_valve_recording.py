"""Recordings of valve plants: what was sent, when, where; motions inside the travel; controllers side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from sim_backends.valve.effects import ValveEffectSpec
from sim_backends.valve.machines import VALVE_MACHINES
from sim_backends.valve.motion import GoTo, Guess, Hold, Operator, Phase, joint_motion, valve_motion, working_motion
from sim_backends.valve.recording import (
    ValveCase,
    guesses_of,
    simulate_valve_case,
    simulate_valve_cases,
    write_valve_case,
)
from sim_backends.valve.tracking import Control, TrueInverse, linear_inverse, track
from sim_backends.valve.truth import load_valve_truth

#: Levels of both signs on the first axis, the second at rest.
STEPS: list[Phase] = [
    Hold((u, 0.0), s) for u, s in ((0.0, 0.5), (0.5, 0.7), (0.0, 0.5), (-0.5, 0.7), (0.0, 0.5), (0.3, 0.6), (-0.3, 0.6))
]


@pytest.fixture(scope="module")
def cases() -> list[ValveCase]:
    """A crane, healthy and with a leaking piston, under the same commands."""
    machine, truth = VALVE_MACHINES["crane"](5)
    guesses = guesses_of(machine, truth, np.random.default_rng(0))
    programmes = {"train-1": STEPS, "repeat": STEPS}
    leak = ValveEffectSpec("piston_leak", "seal", "boom", 0.1)
    return simulate_valve_cases([(machine, truth, programmes, guesses, e, None, 7) for e in ((), (leak,))])


@pytest.mark.slow
def test_a_case_is_read_back_as_any_recording(tmp_path: Path, cases: list[ValveCase]) -> None:
    case = cases[1]
    write_valve_case(tmp_path, case, note="a crane")
    machine = load_machine(tmp_path / "machine.yaml")
    assert machine == case.machine
    assert load_valve_truth(tmp_path / "truth.yaml") == case.truth
    content = yaml.safe_load((tmp_path / "truth.yaml").read_text())
    assert content["note"] == "a crane"
    assert content["effects"] == [{"id": "piston_leak", "form": "seal", "joint": "boom", "size": 0.1}]
    recording = read_recording(tmp_path / "train-1.parquet", machine, "train")
    assert recording.rate_hz == 50.0
    valve = machine.joint("boom").cylinder.valve  # type: ignore[union-attr]
    sent = (recording.values["boom.command"] - valve.neutral) / (valve.extends * valve.full)  # type: ignore[union-attr]
    np.testing.assert_allclose(sent, case.courses["train-1"].command[:, 0], atol=1e-12)
    assert set(np.round(sent, 9)) == {-0.5, -0.3, 0.0, 0.3, 0.5}
    tank = recording.values["tank_pressure"].mean()
    assert tank == pytest.approx(case.truth.supply.tank, abs=1e3)


@pytest.mark.slow
def test_the_rod_follows_what_was_sent_by_its_delay(cases: list[ValveCase]) -> None:
    course, truth = cases[0].courses["train-1"], cases[0].truth
    sent = course.time[np.flatnonzero(course.command[:, 0])[0]]
    moved = course.time[np.flatnonzero(course.stroke[:, 0] > 0.03)[0]]  # the pilot stage is restless by less
    assert sent == pytest.approx(0.5)
    # Seen in the first row after it, once the spool has left centre: at most a cycle or two later.
    assert 0.0 <= moved - sent - truth.valves["boom"].spool.delay_extend < 0.0401
    assert np.all(course.v[course.time < sent + 0.5, 0] > -1e-3)


@pytest.mark.slow
def test_an_effect_leaves_noise_and_commands_as_they_were(cases: list[ValveCase]) -> None:
    healthy, leaking = (case.tables["train-1"] for case in cases)
    np.testing.assert_array_equal(healthy["boom.command"], leaking["boom.command"])
    noise = [case.tables["train-1"]["supply_pressure"] - case.courses["train-1"].supply for case in cases]
    assert np.abs(noise[0] - noise[1]).max() < 400.0  # Pa: a step of the transducer
    rest = cases[0].courses["train-1"].time < 0.5
    p = [case.courses["train-1"].pressure[rest, 1, 0] for case in cases]
    assert p[1][-1] > p[0][-1] + 1e4  # oil comes past the piston
    # The same motion again: the same commands, other noise, warmer oil.
    again = cases[0].tables["repeat"]
    np.testing.assert_array_equal(healthy["boom.command"], again["boom.command"])
    assert np.std(healthy["boom.head_pressure"] - again["boom.head_pressure"]) > 1e3
    assert again["oil_temperature"].mean() > healthy["oil_temperature"].mean() + 1.0


def test_an_operator_stays_off_the_ends_and_gives_up_what_it_cannot_reach() -> None:
    guess = Guess(low=0.0, high=0.5, speed=0.1, edge=0.1, delay=0.1)
    operator = Operator([Hold((0.9,), 1.0), GoTo((0.5,), patience=0.1)], [guess], 0.02)
    assert operator(np.array([0.49])) == [0.0]
    assert operator(np.array([0.2])) == [0.9]
    told = [operator(np.array([0.1]))[0] for _ in range(60)]
    assert told[:48] == [0.9] * 48
    assert told[48] == 0.5  # towards the middle, with caution
    assert operator.done
    assert operator(np.array([0.1])) == [0.0]


def test_a_motion_visits_levels_edges_and_rest() -> None:
    guesses = [Guess(0.0, 0.5, 0.15, 0.08, 0.15), Guess(0.0, 0.4, 0.1, 0.1, 0.1)]
    phases = valve_motion(0, guesses, [(0.5, 0.5), (0.5, 0.2)], 0.7)
    holds = [phase for phase in phases if isinstance(phase, Hold)]
    assert all(phase.commands[1] == 0.0 for phase in holds)
    levels = {round(phase.commands[0], 3) for phase in holds if phase.seconds > 0.8}
    assert {0.7, -0.7, 0.14, -0.14} <= levels
    rungs = {round(phase.commands[0], 2) for phase in holds if phase.seconds == 0.4}
    assert {round(s * (0.03 + 0.01 * k), 2) for k in range(11) for s in (1, -1)} == rungs
    assert max(phase.seconds for phase in holds if phase.commands == (0.0, 0.0)) == 10.0
    both = [p for p in joint_motion(guesses, np.random.default_rng(0), 0.8) if isinstance(p, Hold)]
    assert any(all(phase.commands) for phase in both)
    path = working_motion(guesses, np.random.default_rng(0), 20.0)[1].path  # type: ignore[attr-defined]
    assert np.all((path > 0.0) & (path < [0.5, 0.4]))
    assert np.abs(np.diff(path, axis=0) * 50.0).max(axis=0) == pytest.approx([0.7 * 0.15, 0.7 * 0.1], rel=0.5)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_case() -> None:
    machine, truth = VALVE_MACHINES["bench"](1)
    guesses = guesses_of(machine, truth, np.random.default_rng(0))
    one, other = (
        simulate_valve_case(machine, truth, {"train": [Hold((0.4, -0.4), 0.3)]}, guesses, seed=3) for _ in range(2)
    )
    for name, column in one.tables["train"].items():
        np.testing.assert_array_equal(column, other.tables["train"][name])


@pytest.mark.slow
def test_with_inverse_and_preview_the_error_is_a_fraction_of_linear_feedforwards() -> None:
    machine, truth = VALVE_MACHINES["crane"](1)
    rng = np.random.default_rng(1)
    guesses = guesses_of(machine, truth, rng)
    path = working_motion(guesses, rng, 10.0, 0.5)[1].path  # type: ignore[attr-defined]
    linear = linear_inverse(guesses)
    late = np.array([valve.spool.lateness + 0.01 for valve in truth.valves.values()])  # and half a cycle of 50 Hz
    ways = [
        Control(linear, feedforward=False),
        Control(linear),
        Control(TrueInverse(machine, truth)),
        Control(TrueInverse(machine, truth), preview=late),
    ]
    feedback, forward, inverse, preview = (float(np.sqrt((rms**2).mean())) for rms in track(machine, truth, path, ways))
    assert preview < 0.25 * forward < 0.25 * feedback  # the target of an identified inverse
    assert preview < inverse < forward
