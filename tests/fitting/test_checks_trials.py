"""Mistakes that only efforts, or two sensors together, can show: made in recordings of arms with known parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_arm import QUIET, Noise, force, make_motion, make_recordings, planar_machine, sample, truth

from daq.errors import RecordingError
from daq.machine.machine_file import Machine, load_machine, machine_to_yaml
from daq.recordings.recording import Recording, read_recording, write_recording
from fitting.arm.geometry import geometry_of
from fitting.checks.check import check_recordings
from fitting.checks.findings import Finding, Places
from fitting.checks.magnitudes import machine_findings
from fitting.checks.mistakes.channel_trials import recordings as role_trials
from fitting.checks.mistakes.machine_trials import lengths
from fitting.checks.mistakes.physical import Trial, fit
from fitting.checks.mistakes.samples import positions_of, take_samples
from fitting.checks.mistakes.trials import SUSPECT, search
from fitting.pipeline.check_gate import explained
from fitting.regression.plausible_arm import rods, standard_of_bodies

JOINT = planar_machine(3, sensors="joint")
BOTH = planar_machine(3)
MOTIONS = [("train", 2), ("train", 3), ("validate", 4)]
SINGLE = make_recordings(JOINT, truth(3), MOTIONS)
DOUBLE = make_recordings(BOTH, truth(3), [("unloaded", 1), *MOTIONS])


def changed(recordings: Sequence[Recording], of: Callable[[dict[str, np.ndarray]], dict[str, Any]]) -> list[Recording]:
    """All recordings with some channels in place of others."""
    return [replace(r, values={**r.values, **of({k: np.array(v) for k, v in r.values.items()})}) for r in recordings]


def first(found: Sequence[Finding]) -> tuple[str, str | None]:
    mistakes = [own for own in found if own.severity == "mistake"]
    assert mistakes, "silent"
    return mistakes[0].code, mistakes[0].joint


def with_length(machine: Machine, number: int, factor: float) -> Machine:
    """The machine with the length of a link ``factor`` times what it is."""
    own = machine.joints[number]
    other = own.model_copy(update={"dh": own.dh.model_copy(update={"a": factor * own.dh.a})})
    return machine.model_copy(
        update={"joints": tuple(other if k == number else j for k, j in enumerate(machine.joints))}
    )


def edited(machine: Machine, joint: int, **cylinder: float) -> Machine:
    own = machine.joints[joint]
    assert own.cylinder is not None
    new = own.model_copy(update={"cylinder": own.cylinder.model_copy(update=cylinder)})
    joints = tuple(new if k == joint else j for k, j in enumerate(machine.joints))
    return machine.model_copy(update={"joints": joints})


@pytest.mark.slow
def test_the_arm_that_was_made_explains_its_efforts() -> None:
    """Bounds (masses, braking friction) cost nothing where the arm exists: the misfit is that of least squares."""
    for machine, recordings in ((JOINT, SINGLE), (BOTH, DOUBLE)):
        assert check_recordings(machine, recordings) == ()
        samples = take_samples(machine, recordings)
        assert samples is not None
        after = fit(Trial(samples, machine, positions_of(machine, samples)))
        assert np.nanmax(after.misfits) < SUSPECT
        assert after.misfits == pytest.approx(after.free, abs=0.02)


def test_an_effort_turned_over_fits_without_bounds_and_not_with_them() -> None:
    samples = take_samples(JOINT, SINGLE)
    assert samples is not None
    trial = Trial(samples, JOINT, positions_of(JOINT, samples))
    own = {j: {f"head_pressure{j}": -c.head_area, f"rod_pressure{j}": c.rod_area, "known": -1.0}
           for j in range(3) if (c := JOINT.joints[j].cylinder)}  # fmt: skip
    after = fit(trial, own)
    assert np.nanmax(after.free) < 0.1
    assert np.nanmin(after.misfits) > 0.5


def test_a_torque_that_is_late_at_a_cylinder_is_explained_by_its_own_rate() -> None:
    """A joint effort is brought to the piston by the lever arm, and so is its rate: a delay leaves almost nothing."""
    machine, arm, late = planar_machine(2, effort="cylinder_force", sensors="joint"), truth(2), 0.02
    arm = replace(arm, drive=arm.drive * [1, 1, 0, 1, 0])  # a step of friction that is late is no rate
    channels = tuple(
        c.model_copy(update={"quantity": "joint_effort", "unit": "N m"}) if c.quantity == "cylinder_force" else c
        for c in machine.channels
    )
    other = machine.model_copy(update={"channels": channels})
    recordings = []
    for number, seed in enumerate((2, 3)):
        moved = make_motion(machine, "train", seed)
        torque = force(machine, arm, moved) * moved.r
        torque = np.stack([np.interp(moved.t - late, moved.t, own) for own in torque.T], axis=1)
        recordings.append(sample(other, moved, torque, "train", number, QUIET))
    samples = take_samples(other, recordings)
    assert samples is not None
    trial = Trial(samples, other, positions_of(other, samples))
    lever = trial.motion.r[:, 1]
    assert np.ptp(lever) > 0.2 * np.max(np.abs(lever))  # or a lever arm would be a factor
    assert fit(trial).free[0] < 3e-4  # the delay's square is left; 7e-4 where the rate is not brought to the piston


def swap(a: str, b: str) -> Callable[[dict[str, np.ndarray]], dict[str, Any]]:
    return lambda values: {a: values[b], b: values[a]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "code", "joint"),
    [
        (swap("joint2.head", "joint2.rod"), "swapped_chambers", "joint2"),
        (swap("joint1.head", "joint3.head"), "exchanged_channels", "joint1"),
        (swap("joint1.head", "joint3.rod"), "exchanged_channels", "joint1"),
        (swap("joint1.q", "joint2.q"), "exchanged_channels", "joint1"),
        (lambda v: {"joint2.q": -v["joint2.q"]}, "sign", "joint2"),
        (lambda v: {"joint3.head": v["joint3.head"] / 1e5}, "unit", "joint3"),
    ],
)
def test_a_mistake_at_one_joint_is_named_there(of: Callable[..., dict[str, Any]], code: str, joint: str) -> None:
    assert first(check_recordings(JOINT, changed(SINGLE, of))) == (code, joint)


@pytest.mark.parametrize(("machine", "asked"), [(JOINT, True), (BOTH, False)])
def test_pins_are_asked_of_the_efforts_only_where_one_sensor_measures_the_joint(machine: Machine, asked: bool) -> None:
    samples = take_samples(machine, make_recordings(machine, truth(3), MOTIONS[:1]))
    assert samples is not None
    trial = Trial(samples, machine, positions_of(machine, samples))
    assert any(own.code == "linkage" for own in lengths(trial)) is asked


@pytest.mark.slow
def test_gravity_turned_over() -> None:
    machine = JOINT.model_copy(update={"gravity": (0.0, 9.81, 0.0)})
    found = check_recordings(machine, SINGLE)
    assert first(found) == ("gravity", None)
    assert "[-0, -9.81, -0]" in found[0].cure or "[0, -9.81, 0]" in found[0].cure


@pytest.mark.slow
def test_a_wrong_rod_shows_in_the_ratio_of_the_areas_of_one_joint_alone() -> None:
    machine = planar_machine(1, sensors="joint")
    recordings = make_recordings(machine, truth(1), MOTIONS)
    assert check_recordings(machine, recordings) == ()
    found = check_recordings(edited(machine, 0, rod=0.068), recordings)
    assert first(found) == ("cylinder_areas", "joint1")
    # The rod is really 45 mm thick, of 80 mm bore: rho = (80^2 - 45^2) / (80^2 - 68^2).
    assert found[0].factor == pytest.approx((80**2 - 45**2) / (80**2 - 68**2), rel=0.03)


@pytest.mark.slow
def test_back_pressure_of_a_valve_is_no_wrong_area() -> None:
    """A meter-out edge holds back by the square of the speed while the cylinder extends: no mistake, at most a note."""
    machine = planar_machine(1, sensors="joint")
    recordings = make_recordings(machine, truth(1), MOTIONS)
    cylinder = machine.joints[0].cylinder
    assert cylinder is not None
    held = []
    for own in recordings:
        v = np.gradient(cylinder.linkage.piston_position(own.values["joint1.q"]), own.time)
        force = 0.3 * np.ptp(own.values["joint1.head"]) * np.where(v > 0, (v / np.abs(v).max()) ** 2, 0.0)
        held.append(replace(own, values={**own.values, "joint1.head": own.values["joint1.head"] + force}))
    assert [own for own in check_recordings(machine, held) if own.severity == "mistake"] == []


@pytest.mark.slow
def test_exchanged_pressures_are_found_however_little_they_leave() -> None:
    """The rod pressures of two joints are alike: with them exchanged nearly all of the efforts is explained."""
    mixed = changed(SINGLE, lambda v: {"joint1.rod": v["joint2.rod"], "joint2.rod": v["joint1.rod"]})
    found = check_recordings(JOINT, mixed)
    assert first(found) == ("exchanged_channels", "joint1")
    assert found[0].text.startswith("joint1.rod and joint2.rod look exchanged")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("a", "b", "code"),
    [
        ("joint1.head", "joint1.rod", "swapped_chambers"),
        ("joint1.head", "joint2.head", "exchanged_channels"),
        ("joint1.rod", "joint2.head", "exchanged_channels"),
        ("joint1.q", "joint3.q", "exchanged_channels"),
    ],
)
def test_what_was_wrong_in_one_recording_is_said_of_it(a: str, b: str, code: str) -> None:
    one = SINGLE[1]
    swapped = {a: one.values[b], b: one.values[a]}
    found = check_recordings(JOINT, [SINGLE[0], replace(one, values={**one.values, **swapped}), SINGLE[2]])
    assert first(found) == (code, "joint1")
    assert (found[0].recording, "in this recording alone" in found[0].text) == (one.file, True)


@pytest.mark.slow
def test_an_encoder_that_counts_twice_as_far() -> None:
    found = check_recordings(BOTH, changed(DOUBLE, lambda v: {"joint2.q": 2 * v["joint2.q"]}))
    assert first(found) == ("scale", "joint2")
    assert found[0].factor == 0.5


@pytest.mark.slow
def test_mistakes_that_the_data_cannot_tell_apart_are_named_together() -> None:
    """An angle that counts the other way is a pin offset of the other sign."""
    found = check_recordings(BOTH, changed(DOUBLE, lambda v: {"joint2.q": -v["joint2.q"]}))
    assert first(found) == ("sign", "joint2")
    assert any("linkage.offset" in text for text in found[0].alternatives)
    assert "as well:" in found[0].line


@pytest.mark.parametrize(
    ("change", "code", "severity"),
    [
        ({"gravity": (0.0, -1.0, 0.0)}, "gravity", "mistake"),
        ({"rate_hz": 2.0e4}, "machine_file", "note"),
    ],
)
def test_numbers_of_the_machine_file_that_are_hardly_meant(change: dict[str, Any], code: str, severity: str) -> None:
    (found,) = machine_findings(JOINT.model_copy(update=change), Places())
    assert (found.code, found.severity) == (code, severity)
    assert machine_findings(JOINT, Places()) == []


def test_an_angle_in_degrees_in_the_machine_file() -> None:
    first, second, third = JOINT.joints
    second = second.model_copy(update={"dh": second.dh.model_copy(update={"alpha": 90.0})})
    (found,) = machine_findings(JOINT.model_copy(update={"joints": (first, second, third)}), Places())
    assert (found.code, found.joint, found.severity) == ("axis", "joint2", "mistake")
    assert "1.570796" in found.cure


@pytest.mark.slow
def test_two_sensors_tell_without_dynamics() -> None:
    other = changed(DOUBLE, lambda v: {"joint2.x": 0.3 - v["joint2.x"]})
    assert first(check_recordings(BOTH, other)) == ("sign", "joint2")
    pins = edited(BOTH, 1, linkage=BOTH.joints[1].cylinder.linkage.model_copy(update={"b": 0.21}))  # type: ignore[union-attr,arg-type]
    found = check_recordings(pins, DOUBLE)
    assert first(found) == ("linkage", "joint2")
    assert found[0].factor == pytest.approx(0.16 / 0.21, rel=0.01)


@pytest.mark.slow
def test_a_clock_that_all_efforts_share() -> None:
    """Pressures 0.5 s late: every joint says so, and by how much."""
    late = 25

    def of(values: dict[str, np.ndarray]) -> dict[str, Any]:
        return {k: np.concatenate([v[:late], v[:-late]]) for k, v in values.items() if not k.endswith(".q")}

    found = check_recordings(JOINT, changed(SINGLE, of))
    assert first(found) == ("clock_offset", None)
    assert found[0].factor == pytest.approx(0.5, abs=0.05)


def test_a_late_sensor_of_one_joint_is_an_effect_and_no_mistake() -> None:
    def of(values: dict[str, np.ndarray]) -> dict[str, Any]:
        return {k: np.concatenate([values[k][:2], values[k][:-2]]) for k in ("joint2.head", "joint2.rod")}

    assert check_recordings(JOINT, changed(SINGLE, of)) == ()


@pytest.mark.slow
@pytest.mark.parametrize("size", [-0.08, 0.08])
def test_a_gain_of_a_transducer_is_an_effect_and_no_mistake(size: float) -> None:
    found = check_recordings(JOINT, changed(SINGLE, lambda v: {"joint1.head": (1 + size) * v["joint1.head"]}))
    assert found == ()


@pytest.mark.slow
def test_rods_off_in_a_training_recording() -> None:
    wrong = [replace(r, role="train") if r.role == "unloaded" else r for r in DOUBLE]
    found = check_recordings(BOTH, wrong)
    assert first(found) == ("wrong_role", None)
    assert found[0].recording == DOUBLE[0].file


@pytest.mark.slow
def test_what_nothing_explains_is_said_in_general() -> None:
    """Efforts of another motion: no unit, sign or cable makes them this one's."""
    others = make_recordings(JOINT, truth(3), [("train", 11), ("train", 12), ("validate", 13)])
    names = [c.name for c in JOINT.channels if c.quantity.endswith("pressure")]
    mixed = [
        replace(r, values={**r.values, **{n: o.values[n] for n in names}}) for r, o in zip(SINGLE, others, strict=True)
    ]
    code, _ = first(check_recordings(JOINT, mixed))
    assert code == "unexplained"


@pytest.mark.slow
def test_the_line_of_the_machine_file_is_said(tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(machine_to_yaml(JOINT), encoding="utf-8")
    found = check_recordings(JOINT, changed(SINGLE, lambda v: {"joint2.q": -v["joint2.q"]}), places=Places.of(file))
    lines = file.read_text(encoding="utf-8").splitlines()
    number = int(found[0].cure.rsplit(" ", 1)[1])
    assert "name: joint2.q" in lines[number - 1]


def test_a_refusal_is_explained(tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(machine_to_yaml(BOTH), encoding="utf-8")
    recording = changed(DOUBLE[1:2], lambda v: {"joint1.x": 1e3 * v["joint1.x"]})[0]
    path = write_recording(tmp_path / "train.parquet", BOTH, "train", recording.time, recording.values)
    error = explained(RecordingError("train.parquet: joint1.x: out of its stroke"), file, [("train", path)])
    assert "the values look like mm" in str(error)
    assert "\n" not in str(error)


def test_a_search_on_a_sound_arm_takes_nothing_back() -> None:
    samples = take_samples(JOINT, SINGLE)
    assert samples is not None
    searched = search(Trial(samples, JOINT, positions_of(JOINT, samples)))
    assert searched.accused == ()
    assert searched.current.misfits == pytest.approx(searched.nominal.misfits, nan_ok=True)


@pytest.mark.slow
def test_a_link_with_a_decimal_slip_is_named_however_little_it_leaves() -> None:
    """A tenth of its length is taken up by masses but for a few per cent, at every joint: nobody else does that."""
    arm = truth(3)
    arm = replace(arm, drive=0.3 * arm.drive)
    runs = make_recordings(JOINT, arm, MOTIONS, noise=Noise(2e-6, 1e-6, 1.0, 0.5))
    assert check_recordings(JOINT, runs) == ()
    wrong = with_length(JOINT, 0, 0.1)
    samples = take_samples(wrong, runs)
    assert samples is not None
    misfits = fit(Trial(samples, wrong, positions_of(wrong, samples))).misfits
    assert np.nanmax(misfits) < SUSPECT, "it would have been tried before"
    assert first(check_recordings(wrong, runs)) == ("length", "joint1")


def sample_of(name: str, left_out: str = "") -> tuple[Machine, list[Recording]]:
    """Machine and recordings of a sample; without those of a role, if one is left out."""
    data = Path(__file__).parents[3] / "shared" / "samples" / name
    if not data.is_dir():
        pytest.skip(f"the sample is not there (../shared/samples/{name})")
    machine = load_machine(data / "machine.yaml")
    roles = {path: path.stem.split("-")[0] for path in sorted(data.glob("*.parquet"))}
    return machine, [read_recording(path, machine, role) for path, role in roles.items() if role != left_out]


@pytest.mark.slow
def test_a_length_of_the_wrong_sign_is_named_however_little_it_leaves() -> None:
    machine, runs = sample_of("nothing-missing")
    found = check_recordings(with_length(machine, 1, -1.0), runs)
    assert first(found) == ("length", "joint2") and found[0].before is not None and found[0].before < SUSPECT


@pytest.mark.slow
def test_an_arm_that_moves_twenty_times_too_fast_is_not_pushed_by_its_joints() -> None:
    # With the unloaded recording far more hypotheses are tried, at three times the cost; the rate still wins.
    machine, runs = sample_of("tilted-base", left_out="unloaded")
    fast = machine.model_copy(update={"rate_hz": 20 * machine.rate_hz})
    found = check_recordings(fast, [replace(r, time=r.time / 20, rate_hz=fast.rate_hz) for r in runs])
    assert first(found) == ("wrong_rate", None)
    assert found[0].factor == pytest.approx(0.05)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [20.0, 10.0, 0.1, 0.05])
def test_a_false_time_axis_is_named_by_the_inertias_of_all_joints(factor: float) -> None:
    machine = JOINT.model_copy(update={"rate_hz": JOINT.rate_hz / factor})
    slow = [replace(r, time=factor * r.time, rate_hz=machine.rate_hz) for r in SINGLE]
    found = check_recordings(machine, slow)
    assert first(found) == ("wrong_rate", None)
    assert found[0].factor == pytest.approx(factor, rel=0.6)


def test_rods_of_one_kilogram_have_the_inertia_of_rods() -> None:
    """About its end a thin rod has m l^2 / 3; this one is thick."""
    links = standard_of_bodies(rods(geometry_of(planar_machine(1))))
    length = planar_machine(1).joints[0].dh.a
    mass, x, xx, zz = links[0], links[1], links[4], links[9]
    assert mass == pytest.approx(1.0)
    assert x == pytest.approx(-length / 2)  # frame 1 is at the far end
    thick = 2 * 0.15**2  # a deviation of 0.15 l along either axis across
    assert zz == pytest.approx((1 / 3 + thick) * length**2)
    assert xx == pytest.approx(thick * length**2)


def test_roles_are_errors_of_cylinders_alone() -> None:
    """Nothing can be taken off an arm without any, and a joint that stands in a recording says nothing of its role."""
    electric = planar_machine(2, kinds="rr")
    runs = make_recordings(electric, truth(2), [("train", 2), ("train", 3), ("validate", 4)])
    samples = take_samples(electric, runs)
    assert samples is not None
    trial = Trial(samples, electric, positions_of(electric, samples))
    assert not [own for own in role_trials(trial) if own.code == "wrong_role"]
