"""Encoders of one turn: wraps are put back wherever they fall; nothing else is touched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench_machines import plain
from hypothesis import given
from hypothesis import strategies as st
from sound_recordings import motion

from daq import parse_machine, read_recording
from daq.recordings.encoder_wraps import TURN, unwrapped

MACHINE = parse_machine(plain())
ANGLE = next(c for c in MACHINE.channels if c.quantity == "joint_position")
PISTON = next(c for c in MACHINE.channels if c.quantity == "piston_position")
MIDDLE = float(np.mean(MACHINE.joint(str(ANGLE.joint)).limits.position))


@given(
    zero=st.floats(-0.9, 0.9),
    size=st.floats(0.2, 1.0),
    lost=st.sets(st.integers(0, 399), max_size=100),
)
def test_the_motion_comes_back_wherever_the_encoder_begins_anew(zero: float, size: float, lost: set[int]) -> None:
    true = MIDDLE + size * np.sin(np.arange(400) / 40.0)
    seen = np.mod(true - MIDDLE - zero * size, TURN)
    seen[sorted(lost)] = np.nan
    found, rows = unwrapped(MACHINE, ANGLE, seen)
    there = np.isfinite(seen)
    wraps = np.flatnonzero(np.abs(np.diff(seen[there])) > 1.0)
    assert np.array_equal(rows, np.flatnonzero(there)[wraps + 1])
    if len(rows):
        off = found[there] - (true - MIDDLE - zero * size)[there]
        assert np.ptp(off) < 1e-9  # one motion again, on some whole turn
        assert abs(np.median(found[there]) - MIDDLE) <= TURN / 2
    else:
        assert found is seen


def test_what_is_no_wrap_of_an_angle_stays() -> None:
    step = np.where(np.arange(400) > 200, 0.131, 0.0) + 0.01 * np.sin(np.arange(400) / 40)
    assert unwrapped(MACHINE, PISTON, step)[0] is step
    jump = np.where(np.arange(400) > 200, 4.5, 0.0) + 0.01 * np.sin(np.arange(400) / 40)
    assert unwrapped(MACHINE, ANGLE, jump)[0] is jump  # three quarters of a turn are none
    fast = np.mod(1.3 * np.arange(400.0), TURN)
    assert unwrapped(MACHINE, ANGLE, fast)[0] is fast  # a fifth of a turn in every row: nobody knows
    assert len(unwrapped(MACHINE, ANGLE, np.full(10, np.nan))[1]) == 0
    beyond = np.resize([1e308, -1e308], 400)
    assert unwrapped(MACHINE, ANGLE, beyond)[0] is beyond  # a step between them is no number


def test_a_recording_says_its_channel_row_and_time(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = motion()
    whole = columns["j1.angle"].copy()  # degrees on disk
    columns["j1.angle"] = np.where(whole > np.median(whole), whole - 360.0, whole)
    pq.write_table(pa.table(columns), tmp_path / "r.parquet")
    recording = read_recording(tmp_path / "r.parquet", MACHINE, "train")
    assert recording.values["j1.angle"] == pytest.approx(np.deg2rad(whole), abs=1e-9)
    row = int(np.flatnonzero(np.abs(np.diff(columns["j1.angle"])) > 180)[0]) + 2
    count = int(np.count_nonzero(np.abs(np.diff(columns["j1.angle"])) > 180))
    (note,) = recording.notes
    said = f"j1.angle: the encoder wraps {count} times, the first at row {row} ({recording.time[row - 1]:.6g} s)"
    assert said in note
