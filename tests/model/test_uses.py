"""Uses of a model on an arm whose physics a test knows: feedforward, energy, overload, payload; and the commands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as arrow_csv
import pytest
from model_examples import fitted, report_of, session_of, true_model
from synthetic_arm import force, make_motion, sample, truth

from daq import write_recording
from daq.errors import InputError
from daq.motion_files import Motion, write_motion
from daq.recordings.recording import Recording
from fitting.model.arm_model import ArmModel
from fitting.model.codec import model_from_json, model_to_json, save_model
from fitting.model.handover import hand_over
from fitting.model.prediction import on_recording
from fitting.model.tails import Tail, excursions, tail_of
from fitting.model.uses.energy import energy_of_motion, energy_of_recording
from fitting.model.uses.feedforward import feedforward, path_of, write_feedforward
from fitting.model.uses.overload import alarms_in, delay_s, learn, overloads, quick, scores_of, thresholds
from fitting.model.uses.payload import payload_signal, weighed
from server.commands.command_line import main

SESSION = session_of(2)


@pytest.fixture(scope="module")
def exact() -> ArmModel:
    return true_model(SESSION.machine, truth(2), SESSION)


@pytest.fixture(scope="module")
def model() -> ArmModel:
    return hand_over(SESSION, (), fitted(SESSION, ()), report_of(SESSION))


def program(machine: str, seconds: float = 4.0) -> Motion:
    """One joint out and back with a jerk that begins and ends at zero; the other holds."""
    t = np.linspace(0.0, seconds, 161)
    s = t / seconds
    return Motion(machine, "pinned", t, {"joint1": 0.3 * (64 * s**3 * (1 - s) ** 3) - 0.1})


def test_feedforward_is_what_the_motion_takes(exact: ArmModel, tmp_path: Path) -> None:
    path = path_of(exact, program(exact.machine.name))
    s = path.t / 4.0
    np.testing.assert_allclose(path.q[:, 0], 0.3 * (64 * s**3 * (1 - s) ** 3) - 0.1, atol=1e-7)
    np.testing.assert_allclose(path.qd[:, 0], np.gradient(path.q[:, 0], path.t, edge_order=2), atol=1e-3)
    assert np.ptp(path.q[:, 1]) == 0
    found = feedforward(exact, path, rod=6e5)
    write_feedforward(tmp_path / "ff.csv", found)
    table = {k: np.array(v) for k, v in arrow_csv.read_csv(tmp_path / "ff.csv").to_pydict().items()}
    for number, joint in enumerate(exact.machine.joints):
        assert joint.cylinder is not None
        pressed = table[f"{joint.name}.head_pressure"] * joint.cylinder.head_area
        pressed -= table[f"{joint.name}.rod_pressure"] * joint.cylinder.rod_area
        np.testing.assert_allclose(pressed, table[f"{joint.name}.force"], rtol=1e-6, atol=1e-4)
        np.testing.assert_allclose(table[f"{joint.name}.effort"], found.effort[:, number], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(table["time"], np.arange(len(path.t)) / exact.machine.rate_hz, atol=1e-9)


def test_a_motion_of_free_pistons_is_refused(exact: ArmModel) -> None:
    free = replace(program(exact.machine.name), rods="unpinned")
    with pytest.raises(InputError, match="give a pinned one"):
        path_of(exact, free)


def test_energy_of_a_motion_that_returns_is_what_friction_takes(exact: ArmModel) -> None:
    """Out and back to the same pose at rest: gravity and inertia do no work in all."""
    found = energy_of_motion(exact, path_of(exact, program(exact.machine.name)))
    net = found.given - found.returned
    # The spring and the holding joint do no work over the whole motion either; what is left is dissipated.
    assert net[0] == pytest.approx(found.friction[0], rel=2e-3)
    assert found.friction[0] > 1.0 and found.given[1] == 0.0 and found.measured is None
    assert np.all(found.given_std[0] > 0)


def test_energy_of_a_recording_agrees_with_what_was_measured(model: ArmModel) -> None:
    (seen,) = [own for own in SESSION.recordings if own.role == "validate"][:1]
    found = energy_of_recording(model, seen)
    assert found.measured is not None
    np.testing.assert_allclose(found.given, found.measured, rtol=0.03)


def test_excursions_that_are_close_are_counted_once() -> None:
    above = np.zeros(40, dtype=bool)
    above[[3, 4, 8, 30]] = True
    assert excursions(above, 5) == [slice(3, 9), slice(30, 31)]
    assert excursions(np.zeros(4, dtype=bool), 5) == []


@pytest.mark.parametrize("heavy", [False, True], ids=["exponential", "heavy"])
def test_a_threshold_is_exceeded_as_often_as_it_says(heavy: bool) -> None:
    """Independent scores of a known law: learnt on a tenth of the time that they are counted in."""
    rng = np.random.default_rng(4)
    draw = (lambda n: rng.pareto(4.0, n)) if heavy else (lambda n: rng.exponential(1.0, n))
    tail = tail_of([draw(60_000)], 50.0, 0)
    assert (tail.shape > 0.1) == heavy
    limit = tail.threshold(0.02)  # once in 50 s: 240 expected in the time below
    count = len(excursions(draw(600_000) > limit, 0))
    assert 120 < count < 480
    assert tail.threshold(0.002) > limit
    with pytest.raises(InputError, match="longer recordings"):
        tail_of([draw(100)], 50.0, 10)


def struck(seen: Recording, joint: str, size: float, begin: float, seconds: float) -> Recording:
    """The recording with a force at a piston, in its head pressure."""
    described = next(own for own in SESSION.machine.joints if own.name == joint)
    channel = SESSION.machine.channel("head_pressure", joint)
    assert described.cylinder is not None and channel is not None
    time = seen.time - seen.time[0]
    push = size / described.cylinder.head_area * ((time >= begin) & (time < begin + seconds))
    return replace(seen, sha256="struck", values={**seen.values, channel.name: seen.values[channel.name] + push})


def test_a_hit_is_found_within_a_tenth_of_a_second_and_nothing_else(model: ArmModel) -> None:
    (seen,) = [own for own in SESSION.recordings if own.role == "validate"][:1]
    assert model.tails is not None
    limits = thresholds(model.tails, 1.0)
    assert overloads(model, seen, limits) == []
    size = 3.0 * float(limits[1] * model.residual_std[1])
    (found,) = overloads(model, struck(seen, "joint2", size, 6.0, 0.3), limits)
    assert found.joint == 1 and 0.0 < found.found - seen.time[0] - 6.0 <= 0.1
    assert found.seconds == pytest.approx(0.3, abs=0.1)
    assert abs(found.score) > found.threshold == limits[1]
    assert abs(found.residual) > found.limit == pytest.approx(found.threshold * found.residual / found.score)
    assert delay_s(quick(model)) == pytest.approx(0.06)
    assert np.all(thresholds(model.tails, 10.0) < limits)


def test_a_threshold_is_another_effort_in_another_pose(model: ArmModel) -> None:
    """Scores have no unit: what they are multiplied by is the band at the piston, by the lever arm of the pose."""
    assert model.tails is not None
    (seen,) = [own for own in SESSION.recordings if own.role == "validate"][:1]
    (part,) = scores_of(quick(model), seen)
    np.testing.assert_allclose(np.abs(part.residual), np.abs(part.scores) * part.unit, rtol=1e-9, atol=1e-9)
    assert np.all(np.quantile(part.unit, 0.95, axis=0) > 1.05 * np.quantile(part.unit, 0.05, axis=0))
    hit = struck(seen, "joint2", 5.0 * float(thresholds(model.tails, 1.0)[1] * model.residual_std[1]), 6.0, 0.3)
    for stated in (0.1, 1.0, 10.0):
        limits = thresholds(model.tails, stated)
        (alarm,) = alarms_in(model, scores_of(quick(model), hit), limits)
        (same,) = overloads(model, hit, limits)
        assert alarm == same and alarm.limit < abs(alarm.residual)


def test_tails_are_saved_with_the_model_and_files_without_them_are_read(model: ArmModel) -> None:
    content = json.loads(json.dumps(model_to_json(model)))
    assert model_from_json(content).tails == model.tails
    del content["tails"], content["sha256"]
    assert model_from_json(content).tails is None
    content["tails"] = [{"level": 1.0, "rate": 1.0, "scale": 1.0, "shape": 0.0}]
    with pytest.raises(InputError, match="tails"):
        model_from_json(content)
    again = learn(model, [own for own in SESSION.recordings if own.role != "unloaded"])
    assert all(isinstance(own, Tail) for own in again)


def test_scores_of_a_long_recording_are_learnt_in_pieces_on_its_own_clock(
    model: ArmModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = [own for own in SESSION.recordings if own.role != "unloaded"]
    whole = learn(model, seen)
    monkeypatch.setattr("fitting.model.uses.overload.PIECE_S", 5.0)
    starts: list[float | None] = []

    def watched(model: ArmModel, recording: Recording, start: float | None = None) -> Any:
        starts.append(start)
        return on_recording(model, recording, start)

    monkeypatch.setattr("fitting.model.uses.overload.on_recording", watched)
    for one, other in zip(learn(model, seen), whole, strict=True):
        assert one.level == pytest.approx(other.level, rel=0.1)
        assert one.threshold(1e-4) == pytest.approx(other.threshold(1e-4), rel=0.3)
    assert starts.count(None) == len(seen)
    assert len(starts) == sum(len(own) // (5 * round(own.rate_hz)) for own in seen) == 2 * len(seen)
    assert set(starts) - {None} == {quick(model).bank.trimmed(own.time)[0] for own in seen}


def test_the_payload_lies_within_its_stated_deviation() -> None:
    """Known columns, noise of known size and memory: the estimate is off by its own deviations."""
    rng, off = np.random.default_rng(2), []
    for _ in range(200):
        tip = rng.normal(size=(160, 2)) * (30.0, 5.0) + (60.0, 10.0)
        noise = rng.normal(size=(160, 2))
        noise[1:] += 0.6 * noise[:-1]
        found = weighed(7.0 * tip + noise * (40.0, 4.0), tip, np.ones((160, 2), dtype=bool))
        assert found is not None
        off.append((found.mass - 7.0) / found.std)
    assert 0.7 < np.std(off) < 1.4
    assert weighed(np.ones((9, 2)), np.ones((9, 2)), np.zeros((9, 2), dtype=bool)) is None


def test_a_mass_at_the_tip_is_found(exact: ArmModel) -> None:
    """The same motion with the efforts of an arm that carries more."""
    arm = truth(2)
    pi = arm.pi.copy()
    pi[10] += 12.0
    moved = make_motion(exact.machine, "operation", 31, 30.0)
    seen = sample(exact.machine, moved, force(exact.machine, replace(arm, pi=pi), moved), "operation", 31)
    found = payload_signal(exact, seen)
    known = np.isfinite(found.mass)
    assert known.sum() > 5
    assert np.median(found.mass[known]) == pytest.approx(12.0, abs=0.5)
    assert np.all(np.diff(found.t) > 0)


def test_commands_write_feedforward_energy_overload_and_payload(
    model: ArmModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_model(tmp_path / "model.json", model)
    write_motion(tmp_path / "motion.csv", program(model.machine.name))
    (seen,) = [own for own in SESSION.recordings if own.role == "validate"][:1]
    write_recording(tmp_path / "v.parquet", model.machine, "validate", seen.time, dict(seen.values))

    def run(*words: str, code: int = 0) -> Any:
        with pytest.raises(SystemExit) as ended:
            main([str(tmp_path / word) if "." in word else word for word in words])
        output = capsys.readouterr()
        assert (ended.value.code or 0) == code, output.err
        return json.loads(output.out) if code == 0 else output.err

    assert run("feedforward", "model.json", "motion.csv", "-o", "ff.csv", "--json")["rows"] == 201
    assert set(run("energy", "model.json", "motion.csv", "--json")["joints"]) == {"joint1", "joint2"}
    assert run("energy", "model.json", "v.parquet", "--json")["seconds"] > 5
    assert run("overload", "model.json", "v.parquet", "--json")["alarms"] == []
    found = run("payload", "model.json", "v.parquet", "-o", "p.csv", "--json")
    assert found.keys() == {"time", "mass", "std"} and (tmp_path / "p.csv").is_file()
    save_model(tmp_path / "old.json", replace(model, tails=None))
    assert "--usual" in run("overload", "old.json", "v.parquet", code=2)
    assert "cannot be read" in run("energy", "model.json", "none.csv", code=2)


def at_rest(seed: int, push: float = 0.0) -> Recording:
    """The arm held for half a minute: friction somewhere within its Coulomb friction, encoders that tremble.

    Joint and piston tremble together, by some ten times what the noise of a sensor makes of the speed.
    """
    machine, arm, rng = SESSION.machine, truth(2), np.random.default_rng(seed)
    still = make_motion(machine, "validate", seed, 30.0, moving=())
    friction = arm.drive[:, 2] * rng.uniform(-0.95, 0.95, 2)
    late = (still.t >= 15.0)[:, None] * np.array([0.0, push])
    seen = sample(machine, still, force(machine, arm, still) + friction + late, "operation", seed)
    tremble = 4e-5 * np.convolve(rng.normal(size=len(still.t) + 4), np.ones(5) / 5, mode="valid")
    values = dict(seen.values)
    for number, joint in enumerate(machine.joints):
        for quantity, lever in (("joint_position", 1.0), ("piston_position", still.r[0, number])):
            channel = machine.channel(quantity, joint.name)  # type: ignore[arg-type]
            assert channel is not None
            values[channel.name] = values[channel.name] + lever * tremble
    return replace(seen, sha256=f"rest-{seed}", values=values)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_an_arm_that_is_held_raises_no_alarm(seed: int, model: ArmModel) -> None:
    """Half a minute at a rate of an alarm in ten: a sign of a trembling speed would be off by twice the friction."""
    assert model.tails is not None
    assert overloads(model, at_rest(seed), thresholds(model.tails, 12.0)) == []


@pytest.mark.slow
def test_a_push_beyond_its_friction_is_found_at_rest(model: ArmModel) -> None:
    assert model.tails is not None
    push = 2.0 * truth(2).drive[1, 2] + 10.0 * float(model.residual_std[1])
    (found,) = overloads(model, at_rest(7, push), thresholds(model.tails, 1.0))
    assert found.joint == 1 and 0.0 < found.found - 15.0 <= 0.25


def test_no_alarm_before_the_filter_has_settled(model: ArmModel) -> None:
    """A force that is there from the first sample on is said after half a second of the stretch."""
    assert model.tails is not None
    (seen,) = [own for own in SESSION.recordings if own.role == "validate"][:1]
    hit = struck(seen, "joint2", 1e4, 0.0, 2.0)
    found = overloads(model, hit, thresholds(model.tails, 1.0))
    assert found and found[0].found - seen.time[0] >= 0.5
