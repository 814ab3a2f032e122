"""The recorder: rows from the ring, gaps marked, and nothing lost that was acknowledged, whatever kills it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bench_machines import plain
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import AcquisitionError, Quality, RecordingError, parse_machine, read_recording
from daq.acquisition.journal import Journal, journal_path, recover
from daq.acquisition.recorder import Recorder
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.frames.channels import channel_table
from daq.frames.frame import Frame
from daq.recordings.recording import recording_table
from daq.recordings.recording_files import Table, read_table

MACHINE = parse_machine(plain())
NAMES = [channel.name for channel in MACHINE.channels]
DTYPE = channel_table(MACHINE).dtype


def frame(cycle: int, quality: int = Quality.FRESH) -> Frame:
    """A frame whose values follow from its cycle: a motion that read_recording accepts."""
    q = 0.5 * np.sin(0.05 * cycle)
    noise = np.sin(1000.0 * cycle)  # deterministic, and never twice the same
    values = np.array([q, 0.1 * (q + 1.2), 6e6 + 1e6 * q + 1e3 * noise, 3e6 - 1e6 * q + 1e3 * noise, 320.0])
    flags = np.full(5, quality, dtype=np.uint8)
    ages = np.zeros(5) if quality == Quality.FRESH else np.full(5, np.nan)
    return Frame(cycle, cycle, 1_700_000_000_000_000_000 + 20_000_000 * cycle, cycle / 50, values, ages, flags)


class Feed:
    """A ring, and a writer of frames into it."""

    def __init__(self, name: str, writer: RingWriter) -> None:
        self.name = name
        self.writer = writer
        self.cycle = 0

    def write(self, count: int, quality: int = Quality.FRESH) -> None:
        for _ in range(count):
            self.writer.write(frame(self.cycle, quality))
            self.cycle += 1


@pytest.fixture
def feed() -> Iterator[Feed]:
    with ring_buffer(DTYPE, 4096) as name, RingWriter(name) as writer:
        yield Feed(name, writer)


class Writing:
    """Frames in the background until the block ends."""

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._stop.wait(0.002):
            self._feed.write(1)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


@pytest.mark.slow
def test_a_recording_has_as_many_rows_as_seconds_times_rate(feed: Feed, tmp_path: Path) -> None:
    acknowledged: list[tuple[int, int | None]] = []
    with Writing(feed):
        recorder = Recorder(feed.name, MACHINE, "train", tmp_path / "r.parquet")
        summary = recorder.record(10.0, lambda rows, total: acknowledged.append((rows, total)))
    assert (summary.rows, summary.seconds, summary.missed_cycles) == (500, 10.0, 0)
    assert summary.quality == {}
    assert acknowledged[-1] == (500, 500)
    assert recorder.rows == 500
    assert list(tmp_path.iterdir()) == [tmp_path / "r.parquet"]
    recording = read_recording(summary.path, MACHINE, "train")
    assert recording.cycle is not None and recording.utc_ns is not None
    first = int(recording.cycle[0])
    np.testing.assert_array_equal(recording.cycle, first + np.arange(500))
    np.testing.assert_allclose(recording.time, np.arange(500) / 50)
    expected = np.array([frame(int(cycle)).values for cycle in recording.cycle]).T
    for name, values in zip(NAMES, expected, strict=True):
        np.testing.assert_allclose(recording.values[name], values, rtol=1e-12)
    assert recording.utc_ns[0] == frame(first).utc_ns
    assert set(recording.quality) == set(recording.age) == set(NAMES)


def sealed(feed: Feed, path: Path, cycles: list[int], quality: int = Quality.FRESH) -> Table:
    """Record exactly these cycles."""
    recorder = Recorder(feed.name, MACHINE, "operation", path, overwrite=True)
    started = threading.Event()
    recorder.start(progress=lambda rows, total: started.set())
    assert started.wait(30)  # it follows the ring from its first look on
    for cycle in cycles:
        feed.writer.write(frame(cycle, quality))
    recorder.stop()
    return read_table(path)


@given(steps=st.lists(st.integers(1, 6), min_size=1, max_size=40))
@settings(max_examples=8, deadline=None)
def test_missed_cycles_become_rows_marked_missing(steps: list[int], tmp_path_factory: pytest.TempPathFactory) -> None:
    cycles = [1000, *(1000 + np.cumsum(steps))]
    path = tmp_path_factory.mktemp("gaps") / "r.parquet"
    with ring_buffer(DTYPE, 64) as name, RingWriter(name) as writer:
        table = sealed(Feed(name, writer), path, cycles)
    every = np.arange(1000, cycles[-1] + 1)
    np.testing.assert_array_equal(table.columns["cycle"], every)
    np.testing.assert_allclose(table.columns["time"], (every - 1000) / 50)
    known = np.isin(every, cycles)
    for name in NAMES:
        np.testing.assert_array_equal(np.isfinite(table.columns[name]), known)
        np.testing.assert_array_equal(table.columns[f"{name}.quality"] == Quality.FRESH, known)
        np.testing.assert_array_equal(table.columns[f"{name}.quality"] == Quality.MISSING, ~known)
    utc = table.columns["utc_ns"]
    np.testing.assert_allclose(np.diff(utc), 20_000_000, atol=1)


@pytest.mark.parametrize(
    ("quality", "kept"),
    [(Quality.STALE, False), (Quality.BUS_ERROR, False), (Quality.LATE, True), (Quality.EMERGENCY, True)],
)
def test_held_values_are_not_recorded_as_measured(feed: Feed, tmp_path: Path, quality: int, kept: bool) -> None:
    table = sealed(feed, tmp_path / "r.parquet", [1, 2, 3], quality)
    assert np.isfinite(table.columns["j1.head"]).tolist() == [kept] * 3
    assert table.columns["j1.head.quality"].tolist() == [quality] * 3


def test_csv_is_sealed_as_csv(feed: Feed, tmp_path: Path) -> None:
    table = sealed(feed, tmp_path / "r.csv", [5, 6, 7])
    assert (tmp_path / "r.csv").read_text().startswith('"time","cycle","utc_ns","j1.angle"')
    assert table.columns["cycle"].tolist() == [5, 6, 7]


def test_an_acquisition_that_ends_leaves_what_came_until_then(feed: Feed, tmp_path: Path) -> None:
    path = tmp_path / "r.parquet"
    recorder = Recorder(feed.name, MACHINE, "operation", path)
    started = threading.Event()
    recorder.start(10.0, lambda rows, total: started.set())
    assert started.wait(30)
    feed.write(20)
    feed.writer.finish()
    with pytest.raises(AcquisitionError, match="'bench' ended; 20 rows until then are in"):
        recorder.wait()
    assert read_table(path).rows == 20


def test_files_are_not_overwritten_by_accident(feed: Feed, tmp_path: Path) -> None:
    path = tmp_path / "r.parquet"
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match=r"r\.parquet: is there already"):
        Recorder(feed.name, MACHINE, "train", path).record(1.0)
    assert path.read_bytes() == b"precious"
    path.unlink()
    journal_path(path).touch()
    with pytest.raises(RecordingError, match="hilfit recover"):
        Recorder(feed.name, MACHINE, "train", path).record(1.0)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(RecordingError, match="cannot be written"):
        Recorder(feed.name, MACHINE, "train", file / "r.parquet").record(1.0)


def test_a_ring_of_another_machine_is_refused(feed: Feed, tmp_path: Path) -> None:
    other = parse_machine(plain().replace("- {name: oil, quantity: oil_temperature, unit: degC}\n", ""))
    with pytest.raises(AcquisitionError, match="not of machine 'bench'"):
        Recorder(feed.name, other, "train", tmp_path / "r.parquet").record(1.0)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_without_a_row_leaves_no_file(feed: Feed, tmp_path: Path) -> None:
    recorder = Recorder(feed.name, MACHINE, "train", tmp_path / "r.parquet")
    recorder.start()
    assert recorder.stop().rows == 0
    assert not recorder.active
    assert list(tmp_path.iterdir()) == []


CHILD = """
import sys
from daq import load_machine
from daq.acquisition.recorder import Recorder
machine = load_machine(sys.argv[1])
Recorder(sys.argv[2], machine, "train", sys.argv[3]).record(600.0, lambda rows, total: print(rows, flush=True))
"""


def killed(feed: Feed, tmp_path: Path, name: str, syncs: int = 2) -> int:
    """Let a recorder in another process sync ``syncs`` times, kill it with SIGKILL; rows that it had acknowledged."""
    machine_file = tmp_path / "machine.yaml"
    machine_file.write_text(plain())
    arguments = [sys.executable, "-c", CHILD, str(machine_file), feed.name, str(tmp_path / name)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process, Writing(feed):
        assert process.stdout is not None
        acknowledged = 0
        while syncs:
            acknowledged = int(process.stdout.readline())
            syncs -= acknowledged > 0
        os.kill(process.pid, signal.SIGKILL)
    return acknowledged


@pytest.mark.slow
def test_a_kill_loses_nothing_that_was_acknowledged(feed: Feed, tmp_path: Path) -> None:
    acknowledged = killed(feed, tmp_path, "r.parquet")
    assert acknowledged > 0
    assert not (tmp_path / "r.parquet").exists()  # never half a file
    (result,) = recover(tmp_path)
    assert result.file == tmp_path / "r.parquet"
    assert result.rows >= acknowledged
    assert [path.name for path in tmp_path.glob("*.journal*")] == ["r.parquet.journal.recovered"]  # nothing is deleted
    table = read_table(tmp_path / "r.parquet")
    assert table.metadata["hilfit.machine"] == "bench"
    assert table.metadata["hilfit.role"] == "train"
    cycles = table.columns["cycle"]
    np.testing.assert_array_equal(np.diff(cycles), 1)
    expected = [float(np.rad2deg(frame(int(cycle)).values[0])) for cycle in cycles]
    np.testing.assert_allclose(table.columns["j1.angle"], expected, rtol=1e-12, atol=1e-15)
    assert recover(tmp_path) == ()


def journal(directory: Path, rows: int = 30) -> Path:
    """The journal of a recorder that died, in batches of ten rows."""
    path = directory / "r.parquet"
    values = np.array([frame(cycle).values for cycle in range(rows)]).T
    whole = recording_table(MACHINE, "train", np.arange(rows) / 50, dict(zip(NAMES, values, strict=True)))
    made = Journal(path, whole.schema)
    for start in range(0, rows, 10):
        made.append(whole.slice(start, 10))
    made.abandon()
    return journal_path(path)


@given(cut=st.floats(0, 1))
@settings(max_examples=15, deadline=None)
def test_every_whole_batch_of_a_torn_journal_survives(cut: float, tmp_path_factory: pytest.TempPathFactory) -> None:
    tmp_path = tmp_path_factory.mktemp("torn")
    torn = journal(tmp_path)
    os.truncate(torn, int(cut * torn.stat().st_size))
    (result,) = recover(tmp_path)
    assert result.rows in (0, 10, 20, 30)
    assert (result.file is None) == (result.rows == 0)
    assert torn.exists() == bool(result.left)  # what holds nothing that can be read stays where it is
    if cut == 1:
        assert result.rows == 30
    if result.file is not None:
        assert read_table(result.file).rows == result.rows


def test_recovery_spares_living_recorders_and_other_recordings(feed: Feed, tmp_path: Path) -> None:
    recorder = Recorder(feed.name, MACHINE, "train", tmp_path / "live.parquet")
    started = threading.Event()
    recorder.start(progress=lambda rows, total: started.set())
    assert started.wait(30)
    feed.write(5)
    assert recover(tmp_path) == ()
    assert recorder.stop().rows == 5
    journal(tmp_path)
    (tmp_path / "r.parquet").write_bytes((tmp_path / "live.parquet").read_bytes())
    (result,) = recover(tmp_path)
    assert result.file == tmp_path / "r.recovered.parquet"
    assert read_table(tmp_path / "r.parquet").rows == 5
    # Killed after the rename and before the journal was removed: the recording is there already.
    journal(tmp_path / "again")
    assert recover(tmp_path)[0].rows == 30
    (tmp_path / "again" / "r.parquet").rename(tmp_path / "kept")
    journal(tmp_path / "again")
    (tmp_path / "kept").rename(tmp_path / "again" / "r.parquet")
    assert recover(tmp_path)[0].file == tmp_path / "again" / "r.parquet"
    with pytest.raises(RecordingError, match="no such directory"):
        recover(tmp_path / "nowhere")
