"""Recordings as MDF4, MCAP and MAT by the command line: read back by the formats' own libraries."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF
from bench_machines import plain
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from scipy.io import loadmat
from sound_recordings import ROWS, Columns, motion

from daq import parse_machine, read_recording, write_recording
from daq.recordings.recording_exports import LONGEST, variables
from daq.recordings.recording_files import read_table
from server.commands.command_line import main

MACHINE = parse_machine(plain())
BEGAN = datetime(2024, 2, 29, 12, 30, 0, 250_000, tzinfo=UTC)


def in_si(columns: Columns) -> Columns:
    return {channel.name: MACHINE.conversion(channel).to_si(columns[channel.name]) for channel in MACHINE.channels}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    columns = motion()
    time = columns.pop("time") + 3.0  # the first cycles were not recorded
    utc_ns = np.round((BEGAN.timestamp() + time) * 1e9).astype(np.int64)
    utc_ns[0] = 0  # a cycle that never happened
    return write_recording(
        tmp_path / "r.parquet", MACHINE, "train", time, in_si(columns), cycle=np.arange(150, 150 + ROWS), utc_ns=utc_ns
    )


def exported(recording: Path, suffix: str) -> Path:
    target = recording.with_suffix(suffix)
    with pytest.raises(SystemExit) as ended:
        main(["export", str(recording), "-o", str(target)])
    assert ended.value.code in (0, None)
    return target


def test_an_mdf4_export_has_all_channels_times_and_units(recording: Path) -> None:
    original = read_table(recording)
    with MDF(exported(recording, ".mf4")) as file:
        for name, values in original.columns.items():
            if name != "time":
                np.testing.assert_array_equal(file.get(name).samples, values)
                np.testing.assert_array_equal(file.get(name).timestamps, original.columns["time"])
        assert file.get("j1.head").unit == "bar"
        assert abs(file.start_time - BEGAN) < timedelta(microseconds=10)


def test_the_start_of_a_recording_that_does_not_know_it(tmp_path: Path) -> None:
    columns = motion()
    path = write_recording(tmp_path / "r.parquet", MACHINE, "train", columns.pop("time"), in_si(columns))
    with MDF(exported(path, ".mf4")) as file:
        assert file.start_time == datetime(1970, 1, 1, tzinfo=UTC)


def test_an_mcap_export_has_all_rows_and_columns(recording: Path) -> None:
    original = read_table(recording)
    with exported(recording, ".mcap").open("rb") as file:
        rows = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages()]
    assert len(rows) == ROWS
    for name, values in original.columns.items():
        found = [np.nan if row[name] is None else row[name] for row in sorted(rows, key=lambda row: row["cycle"])]
        np.testing.assert_array_equal(found, values)


def test_a_mat_export_has_all_columns_and_units(recording: Path) -> None:
    original = read_table(recording)
    content = loadmat(exported(recording, ".mat"), squeeze_me=True)
    assert list(content["hilfit_columns"]) == list(original.columns)
    for column, variable in zip(content["hilfit_columns"], content["hilfit_variables"], strict=True):
        np.testing.assert_array_equal(content[variable], original.columns[column])
    units = dict(zip(content["hilfit_variables"], content["hilfit_units"], strict=True))
    assert units["j1_head"] == "bar" and units["j1_angle"] == "deg"
    assert json.loads(str(content["hilfit_metadata"])) == original.metadata


def test_mat_comes_back(recording: Path, tmp_path: Path) -> None:
    machine, back = tmp_path / "arm.yaml", tmp_path / "back.parquet"
    machine.write_text(plain())
    with pytest.raises(SystemExit) as ended:
        main(["import", str(exported(recording, ".mat")), "--machine", str(machine), "-o", str(back)])
    assert ended.value.code in (0, None)
    first, second = read_recording(recording, MACHINE, "train"), read_recording(back, MACHINE, "train")
    for name, values in first.values.items():
        np.testing.assert_allclose(second.values[name], values)


@pytest.mark.slow
@given(st.lists(st.text(min_size=1, max_size=80), unique=True, max_size=12))
def test_variables_are_names_that_matlab_takes(columns: list[str]) -> None:
    made = variables(columns)
    assert list(made) == columns and len(set(made.values())) == len(columns)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) and len(name) <= LONGEST for name in made.values())


def test_what_cannot_be_written_is_refused_and_nothing_is_left(
    tmp_path: Path, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    timeless = tmp_path / "t.csv"
    timeless.write_text("a,b\n1,2\n")
    with pytest.raises(SystemExit) as ended:
        main(["export", str(timeless), "-o", str(tmp_path / "t.mf4")])
    assert ended.value.code == 2
    assert "without 'time'" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.parquet", "t.csv"]
