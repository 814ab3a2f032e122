"""Rows in which the rods are not where the role says are left out; everything else is left alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_arm import RATE, make_recordings, planar_machine, truth

from daq.errors import RecordingError
from daq.recordings.recording import Recording
from fitting.loop.session import Options, Session
from fitting.signals.rods import with_declared_rods

MACHINE = planar_machine(2)
UNLOADED, TRAIN, REPEAT, VALIDATE = make_recordings(MACHINE, truth(2))
BEGINNING = slice(0, 100)  # 2 s
STROKE = 0.3


def changed(recording: Recording, rows: slice, values: Mapping[str, object]) -> Recording:
    """The recording with other values in some rows."""
    columns = dict(recording.values)
    for name, value in values.items():
        columns[name] = columns[name].copy()
        columns[name][rows] = value
    return replace(recording, values=columns)


def without_pins(recording: Recording) -> Recording:
    """The arm parked and its pistons, 40 mm away, brought to where the pins fit; they need little for that."""
    way = 0.04 * np.cos(np.linspace(0.0, np.pi / 2, 100))
    values: dict[str, object] = {}
    for joint in MACHINE.joints:
        angle, x = recording.values[f"{joint.name}.q"][100], recording.values[f"{joint.name}.x"][100]
        values |= {f"{joint.name}.q": angle, f"{joint.name}.x": x + way}
        values |= {f"{joint.name}.head": 1e6, f"{joint.name}.rod": 1.4e6}
    return changed(recording, BEGINNING, values)


def with_pins(recording: Recording) -> Recording:
    """The arm stands still and is held by its cylinders."""
    values: dict[str, object] = {}
    for joint in MACHINE.joints:
        values |= {f"{joint.name}.x": recording.values[f"{joint.name}.x"][100], f"{joint.name}.head": 6e6}
    return changed(recording, BEGINNING, values)


def missing(recording: Recording) -> np.ndarray:
    return np.any([~np.isfinite(values) for values in recording.values.values()], axis=0)


def test_ordinary_recordings_are_left_alone() -> None:
    recordings = (UNLOADED, TRAIN, REPEAT, VALIDATE)
    kept, lines = with_declared_rods(MACHINE, recordings)
    assert lines == () and all(a is b for a, b in zip(kept, recordings, strict=True))


@given(
    offset=st.floats(-0.05, 0.05), gain=st.floats(-0.02, 0.02), late=st.integers(0, 3), knock=st.integers(1, 9),
    at=st.integers(0, 1900),
)  # fmt: skip
@settings(deadline=None, max_examples=40)
def test_errors_of_encoders_and_short_faults_are_left_to_the_loop(
    offset: float, gain: float, late: int, knock: int, at: int
) -> None:
    x = np.roll(TRAIN.values["joint1.x"], late) * (1 + gain) + offset
    x[:late] = x[late]
    bent = changed(changed(TRAIN, slice(None), {"joint1.x": x}), slice(at, at + knock), {"joint1.x": 0.0})
    kept, lines = with_declared_rods(MACHINE, [bent])
    assert kept[0] is bent and lines == ()


def test_a_training_recording_that_began_before_the_pins_were_in() -> None:
    (kept,), (line,) = with_declared_rods(MACHINE, [replace(without_pins(TRAIN), file="site/train.parquet")])
    out = missing(kept)
    assert out[BEGINNING].all() and not out[150:].any()
    assert line.startswith("train.parquet (train): 0.0 to ") and "40 mm" in line and "(joint1, joint2)" in line
    assert np.array_equal(kept.values["joint2.head"], without_pins(TRAIN).values["joint2.head"])


def test_an_unloaded_recording_that_began_before_the_pins_were_out() -> None:
    (kept,), (line,) = with_declared_rods(MACHINE, [with_pins(UNLOADED)])
    out = missing(kept)
    assert out[BEGINNING].all() and not out[150:].any()
    assert "0.0 to 2.5 s left out" in line and "(joint1, joint2)" in line


def test_an_unloaded_recording_in_whose_beginning_the_arm_is_moved() -> None:
    joint = MACHINE.joints[0]
    assert joint.cylinder is not None
    angle = 0.2 * np.sin(np.linspace(0.0, np.pi, 100))
    x = joint.cylinder.linkage.piston_position(angle)
    started = changed(UNLOADED, BEGINNING, {"joint1.q": angle, "joint1.x": x})
    (kept,), (line,) = with_declared_rods(MACHINE, [started])
    out = missing(kept)
    assert out[BEGINNING].all() and not out[200:].any() and "(joint1)" in line


@pytest.mark.slow
def test_a_few_such_rows_change_nothing() -> None:
    def theta(recordings: list[Recording]) -> np.ndarray:
        return Session(MACHINE, recordings, Options(bandwidth_hz=3.0)).base_model.fit.theta

    clean = theta([UNLOADED, TRAIN, REPEAT, VALIDATE])
    late = theta([with_pins(UNLOADED), without_pins(TRAIN), REPEAT, VALIDATE])
    fit = Session(MACHINE, [UNLOADED, TRAIN, REPEAT, VALIDATE], Options(bandwidth_hz=3.0)).base_model.fit
    assert np.all(np.abs(late - clean) < 3 * fit.std + 1e-9)


@pytest.mark.parametrize("role", ["train", "validate", "operation"])
def test_rods_that_are_off_all_the_time_are_refused(role: str) -> None:
    with pytest.raises(RecordingError, match=rf"joint1 moves and its joint does not follow.*'{role}'"):
        with_declared_rods(MACHINE, [replace(UNLOADED, role=role)])


def test_rods_that_are_on_all_the_time_are_refused() -> None:
    with pytest.raises(RecordingError, match=r"joint1 moves with its piston.*take it off"):
        with_declared_rods(MACHINE, [replace(TRAIN, role="unloaded")])


@pytest.mark.parametrize("sensors", ["joint", "piston"])
def test_one_position_alone_tells_nothing_of_an_arm(sensors: str) -> None:
    machine = planar_machine(2, sensors=sensors)
    recordings = make_recordings(machine, truth(2), seconds=20.0)
    loaded = recordings[1]
    kept, lines = with_declared_rods(machine, [replace(loaded, role="train")])
    assert kept[0] is loaded or not missing(kept[0]).any()
    assert lines == ()


def test_a_line_names_what_a_person_needs() -> None:
    later = changed(TRAIN, slice(1000, 1100), {"joint2.x": 0.5 * STROKE})
    _, (line,) = with_declared_rods(MACHINE, [without_pins(later)])
    assert "0.0 to 2." in line and f"{1000 / RATE - 0.5:.1f} to " in line and "rods were not on the arm" in line
