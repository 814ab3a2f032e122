"""From recordings to smooth motion and drive effort."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import QUIET, Noise, force, make_motion, make_recordings, planar_machine, prepare, sample, truth

from daq.errors import RecordingError
from fitting.signals.filters import filter_bank
from fitting.signals.preparation import Segment, position_noise

BANK = filter_bank(50.0, 3.0)
ARM = truth(2)


def prepared(machine_options: dict[str, str], noise: Noise = QUIET, **options: object) -> tuple[Segment, ...]:
    machine = planar_machine(2, **machine_options)
    recordings = make_recordings(machine, ARM, noise=noise)
    return prepare(machine, recordings, BANK, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("sensors", ["both", "joint", "piston"])
def test_the_motion_is_the_true_one_whichever_sensor_there_is(sensors: str) -> None:
    machine = planar_machine(2, sensors=sensors)
    segment = prepared({"sensors": sensors})[1]
    motion = make_motion(machine, "train", 2)
    for name in ("q", "qd", "qdd", "x", "v", "a", "r"):
        true = getattr(motion, name)[segment.start : segment.start + len(segment)]
        size = np.max(np.abs(true))
        # The trajectory filter is flat to 1e-3 in its band.
        assert np.max(np.abs(getattr(segment, name) - true)) < 2e-3 * size, name
    assert np.array_equal(segment.t, motion.t[segment.start : segment.start + len(segment)])


@pytest.mark.parametrize("effort", ["pressures", "cylinder_force"])
def test_the_drive_effort_is_the_force_at_the_piston_unfiltered(effort: str) -> None:
    machine = planar_machine(2, effort=effort)
    segment = prepared({"effort": effort})[1]
    motion = make_motion(machine, "train", 2)
    true = force(machine, ARM, motion)[segment.start : segment.start + len(segment)]
    assert np.allclose(segment.effort, true, atol=1e-6)
    assert np.isnan(segment.p1).all() == (effort == "cylinder_force")


def test_a_directly_driven_joint_is_its_own_driving_element() -> None:
    machine = planar_machine(kinds="rr")
    recordings = make_recordings(machine, ARM, (("train", 2),), noise=QUIET)
    (segment,) = prepare(machine, recordings, BANK)
    assert np.array_equal(segment.x, segment.q) and np.all(segment.r == 1)
    assert np.isnan(segment.gap).all()


def test_joint_effort_measured_beside_a_cylinder_is_brought_to_the_piston() -> None:
    machine = planar_machine(1, effort="cylinder_force")
    channel = next(c for c in machine.channels if c.quantity == "cylinder_force")
    other = machine.model_copy(
        update={
            "channels": tuple(
                c.model_copy(update={"quantity": "joint_effort", "unit": "N m"}) if c is channel else c
                for c in machine.channels
            )
        }
    )
    motion = make_motion(machine, "train", 2)
    effort = force(machine, truth(1), motion)
    recording = sample(other, motion, effort * motion.r, "train", 1, QUIET)
    (segment,) = prepare(other, [recording], BANK)
    inner = effort[segment.start : segment.start + len(segment)]
    assert np.allclose(segment.effort, inner, rtol=1e-3)


def test_unloaded_recordings_move_the_piston_of_a_parked_joint() -> None:
    segment = prepared({})[0]
    assert not segment.loaded and segment.role == "unloaded"
    assert not np.any(segment.qd) and not np.any(segment.qdd)
    assert np.ptp(segment.x[:, 0]) > 0.05


def test_position_noise_of_two_sensors_is_that_of_their_weighted_mean() -> None:
    machine = planar_machine(1)
    noise = Noise(joint=1e-4, piston=2e-5)
    motion = make_motion(machine, "train", 2, seconds=120.0)
    recording = sample(machine, motion, force(machine, truth(1), motion), "train", 1, noise)
    found = position_noise(machine, [recording], BANK)[0]
    joint = 1e-4 * np.sqrt(np.mean(motion.r**2))
    expected = 1 / np.sqrt(1 / joint**2 + 1 / 2e-5**2)
    assert found.position == pytest.approx(expected, rel=0.05)
    assert found.speed == pytest.approx(BANK.speed_noise(expected), rel=0.05)
    fused = prepare(machine, [recording], BANK)[0]
    true = motion.v[fused.start : fused.start + len(fused), 0]
    # The filter's ripple is far below the noise of this coarse encoder.
    assert np.std(fused.v[:, 0] - true) == pytest.approx(found.speed, rel=0.2)


def test_the_gap_is_the_disagreement_of_the_two_sensors() -> None:
    machine = planar_machine(2)
    offset = 0.01
    recordings = make_recordings(machine, ARM, noise=QUIET, joint_reading=lambda j, q: q + offset * (j == 1))
    segment = prepare(machine, recordings, BANK)[1]
    assert np.max(np.abs(segment.gap[:, 0])) < 1e-6
    assert np.allclose(segment.gap[:, 1], -segment.r[:, 1] * offset, rtol=0.02)
    corrected = prepare(machine, recordings, BANK, position_error={"joint2": lambda q: np.full_like(q, offset)})[1]
    assert np.max(np.abs(corrected.gap)) < 1e-6


@pytest.mark.parametrize("late", [0.02, 0.0137, 0.2])
def test_a_known_latency_is_taken_out_of_the_effort(late: float) -> None:
    machine = planar_machine(1)
    motion = make_motion(machine, "train", 2)
    w = 2 * np.pi * 0.8
    recording = sample(machine, motion, 1000 * np.sin(w * (motion.t - late))[:, None], "train", 1, QUIET)
    segment = prepare(machine, [recording], BANK, latency={"joint1": late})[0]
    inner = slice(20, len(segment) - 20)  # ends are held, not known
    assert np.allclose(segment.effort[inner, 0], 1000 * np.sin(w * segment.t[inner]), atol=0.5)
    untouched = prepare(machine, [recording], BANK)[0]
    assert np.max(np.abs(untouched.effort[:, 0] - 1000 * np.sin(w * segment.t))) > 20


def test_a_gap_makes_two_segments_and_too_short_ones_are_left_out() -> None:
    machine = planar_machine(2)
    recording = make_recordings(machine, ARM, (("train", 2),), noise=QUIET)[0]
    values = {name: value.copy() for name, value in recording.values.items()}
    values["joint1.head"][900:905] = np.nan
    values["joint2.q"][910] = np.nan
    segments = prepare(machine, [replace(recording, values=values)], BANK)
    assert len(segments) == 2
    assert segments[0].start == BANK.margin and len(segments[0]) == 900 - 2 * BANK.margin
    assert segments[1].start == 911 + BANK.margin
    for segment in segments:
        assert all(np.isfinite(getattr(segment, k)).all() for k in ("q", "qdd", "a", "effort", "p1"))


def test_a_recording_in_pieces_is_refused_with_the_length_it_takes() -> None:
    machine = planar_machine(2)
    recording = make_recordings(machine, ARM, (("train", 2),), noise=QUIET)[0]
    values = {name: value.copy() for name, value in recording.values.items()}
    values["joint1.head"][::60] = np.nan
    with pytest.raises(RecordingError, match=r"train-0.parquet: no stretch of \d+\.\d s without a gap") as caught:
        prepare(machine, [replace(recording, values=values)], BANK)
    assert "\n" not in str(caught.value)


def test_standing_still_is_marked_and_a_reversal_is_not() -> None:
    machine = planar_machine(1)
    t = np.arange(2000) / 50.0
    # Machine time runs, the motion's own time stops from 16 s to 24 s, with smooth ends.
    pace = 1.0 - 0.5 * (np.tanh((t - 16.0) / 0.3) - np.tanh((t - 24.0) / 0.3))
    q = 0.4 * np.sin(2 * np.pi * 0.15 * np.cumsum(pace) / 50.0)
    rng = np.random.default_rng(1)
    linkage = machine.joints[0].cylinder.linkage  # type: ignore[union-attr]
    recording = make_recordings(machine, truth(1), (("train", 2),))[0]
    values = {
        **recording.values,
        "joint1.q": q + 2e-5 * rng.normal(size=len(q)),
        "joint1.x": linkage.piston_position(q) + 1e-5 * rng.normal(size=len(q)),
    }
    segment = prepare(machine, [replace(recording, values=values)], BANK)[0]
    rest = segment.rest[:, 0]
    standing = (segment.t > 17.0) & (segment.t < 23.0)
    moving = (segment.t < 15.0) | (segment.t > 25.0)
    assert rest[standing].mean() > 0.99
    assert np.any(np.diff(np.sign(segment.v[moving, 0])) != 0)
    assert not rest[moving].any()


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_the_samples_that_the_filter_loses_at_the_start_are_known_to_what_remembers_them(speed: float) -> None:
    machine = planar_machine(kinds="rr")
    (recording,) = make_recordings(machine, ARM, (("train", 2),), noise=QUIET)
    clock = (np.arange(len(recording.time) + BANK.margin) - BANK.margin) / BANK.rate_hz
    # At one speed before the recording and in its first quarter of a second, which it does not know.
    swing = np.maximum(clock - 0.25, 0.0)
    longer = np.column_stack([speed * clock + 0.3 * (1 - np.cos(k * swing)) for k in (1.0, 2.0)])
    channels = [machine.channel("joint_position", joint.name) for joint in machine.joints]
    seen = {c.name: longer[BANK.margin :, j] for j, c in enumerate(channels) if c is not None}
    (segment,) = prepare(machine, [replace(recording, values={**recording.values, **seen})], BANK)
    assert segment.lead is not None and segment.start == BANK.margin == len(segment.lead)
    for joint in range(2):
        expected = BANK.smooth(longer[:, joint])[2]
        assert np.concatenate([segment.lead, segment.qdd])[:, joint] == pytest.approx(expected, abs=1e-9)
