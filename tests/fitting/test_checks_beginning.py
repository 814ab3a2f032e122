"""What a check says of a recording whose first seconds are not of the machine that it records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from synthetic_arm import make_recordings, planar_machine, truth

from daq.recordings.recording import Recording
from fitting.checks.check import check_recordings
from fitting.checks.findings import Finding

MACHINE = planar_machine(2)
UNLOADED, TRAIN, REPEAT, VALIDATE = (
    replace(own, file=f"{name}.parquet")
    for name, own in zip(("free", "train", "repeat", "validate"), make_recordings(MACHINE, truth(2)), strict=True)
)
PRESSURES = [f"{joint.name}.{side}" for joint in MACHINE.joints for side in ("head", "rod")]


def begun_with(recording: Recording, seconds: float, values: Mapping[str, object]) -> Recording:
    """The recording with other values, and noise of their own, in its first seconds."""
    rng, rows = np.random.default_rng(5), round(seconds * recording.rate_hz)
    columns = {name: np.array(own) for name, own in recording.values.items()}
    for name, value in values.items():
        columns[name][:rows] = value + (3e3 if name in PRESSURES else 2e-5) * rng.normal(size=rows)
    return replace(recording, values=columns)


def without_pins(recording: Recording) -> Recording:
    """The first two seconds of an arm that is parked and of pistons that are brought to where the pins fit."""
    way = 0.04 * np.cos(np.linspace(0.0, np.pi / 2, 100))
    first: dict[str, object] = dict.fromkeys(PRESSURES, 1000000.0)
    for joint in MACHINE.joints:
        q, x = f"{joint.name}.q", f"{joint.name}.x"
        first |= {q: recording.values[q][100], x: recording.values[x][100] + way}
    return begun_with(recording, 2.0, first)


def said(recordings: list[Recording]) -> list[Finding]:
    return list(check_recordings(MACHINE, recordings))


def test_sound_recordings_leave_nothing_to_say() -> None:
    assert said([UNLOADED, TRAIN, REPEAT, VALIDATE]) == []


def test_rods_that_are_off_in_the_first_seconds_are_said_and_accuse_nothing_else() -> None:
    (found,) = said([UNLOADED, without_pins(TRAIN), REPEAT, VALIDATE])
    assert (found.code, found.severity, found.recording) == ("rods", "note", "train.parquet")
    assert found.line.startswith("train.parquet (train): 0.0 to 2.") and "rods were not on the arm" in found.line


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["joint1.x", "joint1.q"])
def test_a_position_that_is_wrong_in_the_first_second_is_said(channel: str) -> None:
    (found,) = said([UNLOADED, begun_with(TRAIN, 1.0, {channel: 0.0}), REPEAT, VALIDATE])
    assert (found.severity, found.channel, found.recording) == ("mistake", channel, "train.parquet")
    assert "0.98 s" in found.text


@pytest.mark.slow
@pytest.mark.parametrize("recording", [TRAIN, UNLOADED], ids=["train", "unloaded"])
def test_a_recording_that_begins_before_the_pumps_run_is_said(recording: Recording) -> None:
    late = begun_with(recording, 1.0, dict.fromkeys(PRESSURES, 0.0))
    others = [own for own in (UNLOADED, TRAIN, REPEAT, VALIDATE) if own is not recording]
    (found,) = said([late, *others])
    assert (found.code, found.severity, found.recording) == ("no_pressure", "mistake", recording.file)
    assert "the first 1.0 s" in found.text


def test_one_cylinder_without_pressure_is_no_pump_that_rests() -> None:
    late = begun_with(TRAIN, 1.0, dict.fromkeys(PRESSURES[:2], 0.0))
    assert "no_pressure" not in {own.code for own in said([UNLOADED, late, REPEAT, VALIDATE])}
