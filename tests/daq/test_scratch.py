"""Arrays in a scratch file come back as they went in, whole or in part, and a full disk is one line."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bench_machines import plain
from hypothesis import given
from hypothesis import strategies as st

from daq import RecordingError, parse_machine, read_recording
from daq.errors import InputError
from daq.recordings import recording_files
from daq.recordings.recording_files import read_table
from daq.scratch import Scratch, ScratchArrays, ScratchColumns

MACHINE = parse_machine(plain())


@given(
    st.lists(
        st.tuples(st.integers(0, 40), st.integers(1, 5), st.sampled_from(["f8", "i8", "u1", "?"])),
        min_size=1,
        max_size=6,
    ),
    st.integers(-45, 45),
    st.integers(-45, 45),
)
def test_every_array_comes_back_whole_and_in_part(shapes: list[tuple[int, int, str]], first: int, last: int) -> None:
    rng = np.random.default_rng(len(shapes))
    scratch = Scratch()
    arrays = [rng.integers(0, 2, (rows, columns)).astype(kind) for rows, columns, kind in shapes]
    places = [scratch.put(array) for array in arrays]
    for array, place in zip(arrays, places, strict=True):
        back = scratch.read(place)
        assert back.dtype == array.dtype and np.array_equal(back, array)
        assert np.array_equal(scratch.read(place, slice(first, last)), array[first:last])


def test_columns_are_written_bit_by_bit_and_belong_to_the_reader() -> None:
    columns = ScratchColumns(Scratch())
    place = columns.reserve("a", 10, np.float64)
    columns["b"] = np.arange(10)
    columns.scratch.write(place, np.array([3.0, 4.0]), 6)
    assert columns["a"].tolist() == [0, 0, 0, 0, 0, 0, 3, 4, 0, 0]
    assert set(columns) == {"a", "b"} and "c" not in columns and len(columns) == 2
    part = columns.cut(slice(5, 8))
    part["a"][:] = 9.0
    assert columns["a"][6] == 3.0
    with pytest.raises(ValueError, match="read-only"):
        columns["b"][0] = 1


def test_a_full_disk_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    scratch = Scratch()

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(InputError, match=r"No space left on device.*set TMPDIR") as caught:
        scratch.put(np.zeros(3))
    assert "\n" not in str(caught.value)


# --- long Parquet files -------------------------------------------------------------------------------------------


def recorded(rows: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    t = np.arange(rows) / 50.0
    q = 0.8 * np.sin(2 * np.pi * 0.2 * t)
    return {
        "time": t,
        "cycle": np.arange(rows),
        "utc_ns": 1_790_000_000_000_000_001 + 20_000_000 * np.arange(rows),
        "j1.angle": np.rad2deg(q),
        "j1.piston": 1e3 * 0.1 * (q + 1.2),
        "j1.head": 60 + 20 * np.sin(t) + 0.1 * rng.standard_normal(rows),
        "j1.rod": 30 + 10 * np.cos(t) + 0.1 * rng.standard_normal(rows),
        "oil": 45.0 + 0.1 * rng.standard_normal(rows),
        "j1.angle.quality": np.where(np.arange(rows) == 77, 3, 0).astype(np.uint8),
        "j1.angle.age": np.full(rows, 0.001),
    }


@pytest.fixture
def both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, pytest.MonkeyPatch]:
    """A recording of several row groups, and what makes it a long one."""
    path = tmp_path / "train.parquet"
    pq.write_table(pa.table(recorded(20_000)), path, row_group_size=3_001)
    return path, monkeypatch


def test_a_long_recording_is_read_by_row_groups_and_is_the_same(both: tuple[Path, pytest.MonkeyPatch]) -> None:
    path, monkeypatch = both
    whole = read_recording(path, MACHINE, "train")
    monkeypatch.setattr(recording_files, "LONG_VALUES", 1000)
    long = read_recording(path, MACHINE, "train")
    assert isinstance(whole.values, dict) and isinstance(long.values, ScratchColumns)
    assert whole.sha256 == long.sha256 and np.array_equal(whole.time, long.time)
    assert long.utc_ns is not None and np.array_equal(whole.utc_ns, long.utc_ns)  # beyond what a float holds
    assert long.cycle is not None and long.cycle.dtype == np.int64
    for kind in ("values", "age", "quality"):
        first, second = getattr(whole, kind), getattr(long, kind)
        assert set(first) == set(second)
        for name in first:
            assert first[name].dtype == second[name].dtype
            assert np.array_equal(first[name], second[name], equal_nan=kind != "quality")
    assert np.isnan(long.values["j1.angle"][77])
    assert whole.segments() == long.segments()
    part = long.cut(slice(5000, 5100))
    assert len(part) == 100 and np.array_equal(part.values["j1.rod"], whole.values["j1.rod"][5000:5100])
    assert part.cycle is not None and part.cycle[0] == 5000 and part.quality["j1.angle"].dtype == np.uint8


def test_numbers_without_a_value_become_nan_whatever_their_type(both: tuple[Path, pytest.MonkeyPatch]) -> None:
    path, monkeypatch = both
    columns = {"a": pa.array([1, None, 3] * 500, pa.int32()), "b": pa.array([1, 2, 3] * 500, pa.int16())}
    pq.write_table(pa.table(columns), path)
    first = read_table(path)
    monkeypatch.setattr(recording_files, "LONG_VALUES", 1000)
    second = read_table(path)
    for name in columns:
        assert first.columns[name].dtype == second.columns[name].dtype
        assert np.array_equal(first.columns[name], second.columns[name], equal_nan=True)


def test_a_long_recording_is_refused_for_the_same_reasons_as_a_short_one(both: tuple[Path, pytest.MonkeyPatch]) -> None:
    path, monkeypatch = both
    monkeypatch.setattr(recording_files, "LONG_VALUES", 1000)
    pq.write_table(pa.table({**recorded(2000), "oil": pa.array(["warm"] * 2000)}), path)
    with pytest.raises(RecordingError, match="oil: holds string, not numbers"):
        read_recording(path, MACHINE, "train")
    pq.write_table(pa.table(recorded(20_000)), path)
    damaged = bytearray(path.read_bytes())
    damaged[4:64] = b"\xff" * 60  # the header of the first page
    path.write_bytes(damaged)
    with pytest.raises(RecordingError, match="cut short or damaged"):
        read_recording(path, MACHINE, "train")


@pytest.mark.parametrize("columns", [2**40, 2**60])
def test_what_memory_never_holds_is_refused_before_the_disk_is_filled(
    both: tuple[Path, pytest.MonkeyPatch], columns: int
) -> None:
    path, monkeypatch = both
    written: list[object] = []
    monkeypatch.setattr(recording_files, "LONG_VALUES", 1000)
    monkeypatch.setattr(recording_files, "_COLUMNS_AT_ONCE", columns)
    monkeypatch.setattr(Scratch, "write", lambda *what: written.append(what))
    with pytest.raises(MemoryError):
        read_recording(path, MACHINE, "train")
    assert written == []


def test_arrays_by_number_are_kept_and_replaced() -> None:
    arrays = ScratchArrays()
    first, second = np.arange(6.0).reshape(2, 3), np.ones((2, 3))
    arrays[None], arrays[3] = first, second
    assert len(arrays) == 2 and list(arrays) == [None, 3]
    taken = arrays[None]
    taken[0] = 9.0  # what was read belongs to the reader
    assert np.array_equal(arrays[None], first)
    arrays[None] = taken
    assert np.array_equal(arrays[None], taken) and np.array_equal(arrays[3], second)
    arrays.put_rows(3, 1, np.full((1, 3), 7.0))
    assert np.array_equal(arrays[3], [[1.0] * 3, [7.0] * 3]) and np.array_equal(
        arrays.rows(3, slice(1, 2)), [[7.0] * 3]
    )
    arrays.put_rows(3, 1, np.ones((1, 3)))
    arrays[None] = np.zeros((4, 1))
    assert arrays[None].shape == (4, 1) and np.array_equal(arrays[3], second)
    del arrays[3]
    assert list(arrays) == [None]
