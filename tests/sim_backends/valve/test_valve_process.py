"""A machine with valves behind the simulated buses: its controller, and what is seen of its commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.errors import InputError
from daq.valve_motions import Step, ValveAxis, ValveMotion, write_valve_motion
from sim_backends import EffectSpec, Motion, SimulatedMachine, Truth, default_machine, write_motion
from sim_backends.plant.truth import SensorQuality
from sim_backends.simulated_machine import truth_of
from sim_backends.valve.effects import ValveEffectSpec, parse_valve_spec
from sim_backends.valve.machines import default_crane
from sim_backends.valve.motion import GoTo, Hold, Swing
from sim_backends.valve.truth import ValvePlantTruth
from sim_backends.valve.valve_process import DEMO, ValveMachine, build, played, read_any_motion

MACHINE, TRUTH = default_crane()
NAMES = [channel.name for channel in MACHINE.channels]
BOOM = ValveAxis("boom", 0.0, -100.0, -0.5, 0.5, 0.36, 0.08, 0.25, 0.6, 5.0)  # a negative command raises the boom


def machine(seed: int = 0) -> ValveMachine:
    return ValveMachine(MACHINE, TRUTH, SensorQuality(), np.random.default_rng(seed))


def test_a_valve_motion_is_played_in_the_rods_sense_and_other_axes_stay_closed() -> None:
    steps = (Step("go", 7.0, (0.5,)), Step("hold", 1.0, (-30.0,)), Step("swing", 5.0, (40.0,), 0.2))
    phases, guesses = played(ValveMotion("valve-crane", (BOOM,), steps), MACHINE, machine().controller._guesses)
    go, hold, swing = phases
    extends = float(np.sign(MACHINE.joints[0].cylinder.linkage.piston_position(np.array([-0.5, 0.5])) @ [-1.0, 1.0]))
    assert isinstance(go, GoTo) and go.patience == 7.0 and go.pose[0] == pytest.approx(1.0 if extends > 0 else 0.0)
    assert hold == Hold((0.3 * extends, 0.0), 1.0)
    assert isinstance(swing, Swing) and swing.cycles == 1.0 and swing.amplitudes == (-0.4 * extends, 0.0)
    stroke = np.ptp(MACHINE.joints[0].cylinder.linkage.piston_position(np.array([-0.5, 0.5])))
    assert guesses[0].speed == pytest.approx(0.36 * stroke / 1.0) and (guesses[0].edge, guesses[0].delay) == (
        0.08,
        0.25,
    )


@pytest.mark.slow
def test_a_held_command_is_seen_as_it_is_sent_before_the_axis_moves() -> None:
    running = machine()
    running.controller.follow(ValveMotion("valve-crane", (BOOM,), (Step("hold", 1.0, (-50.0,)),)), "up")
    rows = running.advance(75)
    command, angle = rows[:, NAMES.index("boom.command")], rows[:, NAMES.index("boom.angle")]
    assert command.min() == -50.0 and running.controller.phase == "done"
    assert command[:5] == pytest.approx([-10.0, -20.0, -30.0, -40.0, -50.0]), "five times full in a second, at 50 Hz"
    assert np.count_nonzero(command) == 50
    begins = int(np.argmax(np.abs(angle - angle[0]) > 1e-3))
    late = TRUTH.valves["boom"].spool.delay_extend * MACHINE.rate_hz
    assert late < begins < late + 15, "the spool's delay, its lag, and some oil"
    assert angle[-1] > angle[0] + 0.02, "the joint goes up"
    assert np.ptp(rows[:, NAMES.index("jib.angle")]) < 5e-3 and not rows[:, NAMES.index("jib.command")].any()


@pytest.mark.slow
def test_a_motion_file_is_followed_by_feedback() -> None:
    time = np.arange(0.0, 8.01, 0.1)
    wave = 0.15 + 0.2 * np.sin(2 * np.pi * 0.125 * time) ** 2
    running = machine()
    running.controller.follow(
        Motion("valve-crane", "pinned", ("boom", "jib"), time, np.stack([wave, -wave], 1)), "wave"
    )
    phases, angles = [], []
    while running.controller.phase != "done":
        angles.append(running.advance(1)[0, [NAMES.index("boom.angle"), NAMES.index("jib.angle")]])
        phases.append(running.controller.phase)
    assert set(phases[:-1]) == {"moving_to_start", "following"}
    assert phases.count("following") == pytest.approx(400, abs=2)
    followed = np.array(angles)[[phase == "following" for phase in phases]]
    assert np.abs(followed[:400] - np.interp(np.arange(400) / 50, time, wave)[:, None] * [1, -1]).max() < 0.1


def test_files_that_it_cannot_play_are_refused(tmp_path: Path) -> None:
    unpinned = Motion("valve-crane", "unpinned", ("boom",), np.arange(10) * 0.1, np.full((10, 1), 0.2))
    write_motion(tmp_path / "free.csv", unpinned)
    with pytest.raises(InputError, match=r"free\.csv: rods=unpinned"):
        read_any_motion(tmp_path / "free.csv", MACHINE)
    write_valve_motion(tmp_path / "far.csv", ValveMotion("valve-crane", (BOOM,), (Step("hold", 1.0, (90.0,)),)))
    with pytest.raises(InputError, match=r"far\.csv:4: boom is sent 90"):
        read_any_motion(tmp_path / "far.csv", MACHINE)


@pytest.mark.slow
def test_what_is_undeclared_is_in_the_plant_and_in_nothing_that_is_measured_at_rest() -> None:
    configuration = {"truth": TRUTH.to_dict(), "quality": {}, "seed": 3}
    healthy, hidden = (build({**configuration, "undeclared": own}, MACHINE) for own in ([], "demo"))
    np.testing.assert_array_equal(healthy.advance(2), hidden.advance(2))
    told = ValveMotion("valve-crane", (BOOM,), (Step("hold", 1.2, (-30.0,)), Step("hold", 1.0, (0.0,))))
    for own in (healthy, hidden):
        own.controller.follow(told, "up")
    places = [NAMES.index(name) for name in ("boom.command", "boom.angle")]
    first, second = (own.advance(80)[:, places] for own in (healthy, hidden))
    np.testing.assert_array_equal(first[:, 0], second[:, 0])
    assert np.abs(first[:, 1] - second[:, 1]).max() > 1e-3


def test_specs_are_read_and_refused_in_one_line() -> None:
    (demo,) = DEMO
    assert parse_valve_spec("spool_hysteresis:play:boom:0.02") == demo
    assert parse_valve_spec("pump_flow_limit:flow:0.4") == ValveEffectSpec("pump_flow_limit", "flow", None, 0.4)
    for text in ("spool_hysteresis", "spool_hysteresis:play:boom:big", "a:b:c:d:1"):
        with pytest.raises(InputError, match=r"write EFFECT:FORM:JOINT:SIZE"):
            parse_valve_spec(text)
    with pytest.raises(InputError, match="is an effect of another kind of simulated machine"):
        SimulatedMachine(MACHINE, None, [EffectSpec("stribeck", "boom", 1.0)])
    with pytest.raises(InputError, match="forms play, magnetic"):
        SimulatedMachine(MACHINE, None, [ValveEffectSpec("spool_hysteresis", "rust", "boom", 0.02)])


def test_a_truth_is_of_the_kind_that_its_file_says(tmp_path: Path) -> None:
    import sim_backends.machines
    import sim_backends.valve

    (folding,), (valve,) = sim_backends.machines.__path__, sim_backends.valve.__path__
    assert isinstance(truth_of(MACHINE, Path(valve) / "crane.truth.yaml"), ValvePlantTruth)
    assert isinstance(truth_of(MACHINE, Path(folding) / "folding_arm.truth.yaml"), Truth)
    assert truth_of(MACHINE) == TRUTH and truth_of(default_machine()[0]) == default_machine()[1]
    with pytest.raises(InputError, match=r"none\.yaml: no such file"):
        truth_of(MACHINE, tmp_path / "none.yaml")
