"""What can go wrong while a recording is written: typed, one line, and nothing that was acknowledged is lost."""

from __future__ import annotations

import errno
import json
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bench_machines import plain
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import DiskFullError, HilfitError, Quality, RecordingError, StorageError, parse_machine
from daq.acquisition.journal import JOURNAL_SUFFIX, Journal, journal_path, recover
from daq.acquisition.ledger import OVERWRITTEN, SKIPPED
from daq.acquisition.recorder import Recorder, RecordingSummary
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.frames.channels import channel_table
from daq.frames.events import EventLog, RecordedEvents, events_path
from daq.frames.frame import Frame, row_from_frame
from daq.recordings.recording import recording_table
from daq.recordings.recording_files import read_table

MACHINE = parse_machine(plain())
NAMES = tuple(channel.name for channel in MACHINE.channels)
DTYPE = channel_table(MACHINE).dtype
N = len(NAMES)


def table(first: int, rows: int) -> pa.Table:
    numbers = np.arange(first, first + rows, dtype=float)
    return recording_table(MACHINE, "train", numbers / 50, dict.fromkeys(NAMES, numbers), cycle=numbers)


def written(directory: Path, batches: int = 3) -> Path:
    """The journal of a recorder that died, in batches of ten rows."""
    made = Journal(directory / "r.parquet", table(0, 0).schema, overwrite=True)
    for number in range(batches):
        made.append(table(10 * number, 10))
    made.abandon()
    return journal_path(directory / "r.parquet")


# The disk refuses, at the n-th call of each kind, for every n


class Refusal:
    """Lets the n-th call fail; counts calls."""

    def __init__(self, n: int, number: int = errno.EIO) -> None:
        self.left, self.calls, self.number = n, 0, number

    def of(self, original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            self.calls += 1
            if self.calls == self.left:
                raise OSError(self.number, os.strerror(self.number))
            return original(*arguments, **options)

        return call


class Weak:
    """A file whose write may fail."""

    def __init__(self, file: Any, refusal: Refusal) -> None:
        self._file = file
        self.write = refusal.of(file.write)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def attempt(
    directory: Path, refusal: Refusal, kind: str, patch: pytest.MonkeyPatch
) -> tuple[int, HilfitError | None, Any]:
    """Write three batches and seal; rows acknowledged before, the error, and what seal said."""
    acknowledged = 0
    if kind == "write":
        opened = Path.open

        def weak(path: Path, mode: str = "r", *more: Any, **options: Any) -> Any:
            file = opened(path, mode, *more, **options)
            return Weak(file, refusal) if mode == "xb" else file

        patch.setattr(Path, "open", weak)
    elif kind == "sync":
        patch.setattr(os, "fdatasync", refusal.of(os.fdatasync))
    elif kind == "fsync":
        patch.setattr(os, "fsync", refusal.of(os.fsync))
    elif kind == "rename":
        patch.setattr(Path, "replace", refusal.of(Path.replace))
    else:
        patch.setattr(Path, "unlink", refusal.of(Path.unlink))
    journal = None
    try:
        journal = Journal(directory / "r.parquet", table(0, 0).schema)
        for number in range(3):
            journal.append(table(10 * number, 10))
            acknowledged = journal.rows
        return acknowledged, None, journal.seal({})
    except HilfitError as error:
        if journal is not None:
            journal.abandon()
        return acknowledged, error, None
    finally:
        patch.undo()


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC])
@pytest.mark.parametrize("kind", ["write", "sync", "fsync", "rename", "unlink"])
def test_whatever_the_disk_refuses_nothing_acknowledged_is_lost(kind: str, number: int, tmp_path: Path) -> None:
    for n in range(1, 20):
        directory = tmp_path / f"{n}"
        directory.mkdir()
        refusal = Refusal(n, number)
        with pytest.MonkeyPatch.context() as patch:
            acknowledged, error, said = attempt(directory, refusal, kind, patch)
        if refusal.calls < n:
            assert n > 1, "the fault was never met"
            assert error is None and said is None
            return
        if error is None:
            assert kind == "unlink"  # what is left to remove spoils no recording
        else:
            assert isinstance(error, DiskFullError if number == errno.ENOSPC else StorageError), error
            assert "\n" not in str(error) and str(directory) in str(error)
        assert not list(directory.glob(".*")), "something half-written was left"
        recover(directory)
        if acknowledged:
            found = read_table(directory / "r.parquet")
            np.testing.assert_array_equal(found.columns["cycle"][:acknowledged], np.arange(acknowledged))
    raise AssertionError("the fault never ended")


# Damage


@pytest.mark.slow
@given(places=st.lists(st.floats(0, 0.999), min_size=1, max_size=4), flips=st.integers(1, 255))
@settings(max_examples=40, deadline=None)
def test_a_damaged_batch_costs_itself(
    places: list[float], flips: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    directory = tmp_path_factory.mktemp("damaged")
    journal = written(directory, batches=6)
    data = bytearray(journal.read_bytes())
    for place in places:
        data[int(place * len(data))] ^= flips
    journal.write_bytes(data)
    (result,) = recover(directory)
    if result.left:
        assert journal.exists()
        return
    cycles = np.arange(0) if result.file is None else read_table(result.file).columns["cycle"]
    assert len(cycles) == result.rows >= 60 - 10 * len(places)
    assert set(cycles.tolist()) <= set(range(60))
    whole = cycles.reshape(-1, 10)
    np.testing.assert_array_equal(whole - whole[:, :1], np.tile(np.arange(10), (len(whole), 1)))


def test_a_recovered_file_carries_its_ledger(tmp_path: Path) -> None:
    """The killed recorder's own, but for rows without any value, of which a journal does not say why."""
    quality = dict.fromkeys(NAMES, np.arange(10) % 2 * Quality.STALE)
    made = Journal(tmp_path / "r.parquet", flagged(0, quality).schema)
    for number in range(4):
        made.append(flagged(10 * number, quality))
    made.abandon()
    journal = journal_path(tmp_path / "r.parquet")
    (result,) = recover(tmp_path)
    assert result.file is not None
    ledger = json.loads(read_table(result.file).metadata["hilfit.ledger"])
    assert ledger
    for entry in ledger.values():
        assert entry == {"produced": 40, "stored": 20, "dropped": {"bus: nothing came": 20}}
    data = bytearray(Path(f"{journal}.recovered").read_bytes())
    at = len(data) * 6 // 10  # a batch in the middle
    data[at] ^= 0xFF
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / journal.name).write_bytes(data)
    (result,) = recover(tmp_path / "damaged")
    assert result.file is not None and result.rows == 30
    ledger = json.loads(read_table(result.file).metadata["hilfit.ledger"])
    for entry in ledger.values():
        assert entry["produced"] == 40 == entry["stored"] + sum(entry["dropped"].values())
        assert entry["dropped"]["recovered: damaged batch"] == 10


def flagged(first: int, quality: dict[str, np.ndarray]) -> pa.Table:
    """Ten rows with flags; a stale one has no number."""
    numbers = np.arange(first, first + 10, dtype=float)
    values = {name: np.where(flags == Quality.STALE, np.nan, numbers) for name, flags in quality.items()}
    return recording_table(MACHINE, "train", numbers / 50, values, cycle=numbers, quality=quality)


def test_a_journal_whose_first_schema_is_damaged_is_recovered_by_the_second(tmp_path: Path) -> None:
    journal = written(tmp_path)
    data = bytearray(journal.read_bytes())
    data[100] ^= 0xFF  # inside the first one
    journal.write_bytes(data)
    (result,) = recover(tmp_path)
    assert (result.rows, result.damaged) == (30, 1)
    assert "1 damaged" in read_table(tmp_path / "r.parquet").metadata["hilfit.recovered"]


def test_journals_of_older_versions_are_read(tmp_path: Path) -> None:
    path = tmp_path / "old.parquet.journal"
    with path.open("wb") as file, pa.ipc.new_stream(file, table(0, 0).schema) as stream:
        for batch in table(0, 10).to_batches():
            stream.write_batch(batch)
    assert recover(tmp_path)[0].rows == 10
    with pytest.raises(RecordingError, match="journal of an unfinished recording"):
        read_table(tmp_path / "old.parquet.journal.recovered")


# Nothing is deleted


@pytest.mark.parametrize(
    "content", [b"", b"SQLite format 3\0" + bytes(100), bytes(range(256)), b"\xff\xff\xff\xff", b"hilfitJ1 cut"]
)
def test_what_is_not_ours_is_named_and_left(content: bytes, tmp_path: Path) -> None:
    below = tmp_path / "elsewhere"
    below.mkdir()
    stranger = below / "main.journal"
    stranger.write_bytes(content)
    (below / "folder.journal").mkdir()
    written(tmp_path)
    by_name = {found.journal.name: found for found in recover(tmp_path)}
    assert by_name["main.journal"].left and by_name["main.journal"].file is None
    assert stranger.read_bytes() == content
    assert by_name["r.parquet.journal"].rows == 30
    assert recover(tmp_path) == (by_name["main.journal"],)  # and the same again


def test_recovery_removes_no_file_and_changes_none(tmp_path: Path) -> None:
    for number in range(3):  # the same name three times over: nothing is replaced
        before = {path: path.read_bytes() for path in tmp_path.iterdir()}
        journal = written(tmp_path, batches=1 + number)
        content = journal.read_bytes()
        assert recover(tmp_path)[0].rows == 10 * (1 + number)
        after = {path: path.read_bytes() for path in tmp_path.iterdir()}
        assert before.items() <= after.items()
        assert content in after.values()
    assert not list(tmp_path.glob("*" + JOURNAL_SUFFIX))


# The ledger


def frame(cycle: int, flags: list[int]) -> Frame:
    values = np.where(np.isin(flags, (Quality.MISSING, Quality.BUS_ERROR, Quality.INVALID)), np.nan, 1.0 + cycle)
    return Frame(cycle, cycle, 1000 + cycle, cycle / 50, values, np.zeros(N), np.array(flags, dtype=np.uint8))


@pytest.fixture
def feed() -> Iterator[tuple[str, RingWriter]]:
    with ring_buffer(DTYPE, 512) as name, RingWriter(name) as writer:
        yield name, writer


def recorded(name: str, writer: RingWriter, frames: list[Frame], path: Path, info: Any = None) -> RecordingSummary:
    recorder = Recorder(name, MACHINE, "operation", path)
    started = threading.Event()
    recorder.start(progress=lambda rows, total: started.set())
    assert started.wait(30)
    for one in frames:
        writer.write(one)
    if info is not None:
        writer.set_info(info)
    return recorder.stop()


@given(
    steps=st.lists(st.integers(1, 5), min_size=1, max_size=30),
    flags=st.lists(st.lists(st.sampled_from(Quality), min_size=N, max_size=N), min_size=31, max_size=31),
)
@settings(max_examples=10, deadline=None)
def test_every_value_is_stored_or_dropped_for_a_reason(
    steps: list[int], flags: list[list[int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("ledger") / "r.parquet"
    cycles = [100, *(100 + np.cumsum(steps)).tolist()]
    frames = [frame(int(cycle), flags[k]) for k, cycle in enumerate(cycles)]
    with ring_buffer(DTYPE, 512) as name, RingWriter(name) as writer:
        summary = recorded(name, writer, frames, path)
    found = read_table(path)
    assert json.loads(found.metadata["hilfit.ledger"]) == summary.ledger
    for index, channel in enumerate(NAMES):
        entry = summary.ledger[channel]
        given_flags = Counter(one.quality[index] for one in frames)
        assert entry["produced"] == cycles[-1] - 100 + 1 - given_flags[Quality.HELD]
        assert entry["produced"] == entry["stored"] + sum(entry["dropped"].values())
        assert entry["stored"] == np.isfinite(found.columns[channel]).sum()  # what the file really has
        assert entry["dropped"].get(SKIPPED, 0) == cycles[-1] - 100 + 1 - len(cycles) == summary.missed_cycles
        assert entry["dropped"].get("device: invalid", 0) == given_flags[Quality.INVALID]
        assert entry["dropped"].get("bus: down", 0) == given_flags[Quality.BUS_ERROR]
        absent = given_flags[Quality.STALE] + given_flags[Quality.MISSING]
        assert entry["dropped"].get("bus: nothing came", 0) == absent


def test_what_the_ring_lost_is_told_from_cycles_that_never_were(tmp_path: Path) -> None:
    from daq.acquisition.recorder import _Writer

    writer = _Writer(MACHINE, "operation", tmp_path / "r.parquet", NAMES, False)
    fresh = [0] * N

    def rows(*cycles: int) -> Any:
        return np.concatenate([row_from_frame(frame(cycle, fresh)) for cycle in cycles])

    writer.take(rows(10, 11), None, overwritten=7)  # before the recording began: none of its business
    writer.take(rows(20, 22), None, overwritten=5)  # of the eight between, three never were; and 21 was skipped
    writer.sync()
    summary = writer.seal(RecordedEvents(tmp_path / "r.parquet"))
    for entry in summary.ledger.values():
        assert entry == {"produced": 13, "stored": 4, "dropped": {SKIPPED: 4, OVERWRITTEN: 5}}


# Events


def test_events_go_with_the_recording(feed: tuple[str, RingWriter], tmp_path: Path) -> None:
    now = [0]
    log = EventLog(lambda: now[0], lambda: now[0])
    log.note("can0/node 3", "boot_up", "before the recording")
    log.begin("can0/node 4", "silent", "no heartbeat;\n check its power")
    now[0] = 1010
    log.note("can0/node 5", "emergency", "0x5000", count=3)
    info = {"events": log.published()}
    path = tmp_path / "r.parquet"
    summary = recorded(*feed, [frame(cycle, [0] * N) for cycle in range(5)], path, info)
    told = [(event["device"], event["what"], event["seconds"], event["count"]) for event in summary.events]
    assert told == [("can0/node 4", "silent", None, 1), ("can0/node 5", "emergency", 0.0, 3)]
    assert json.loads(read_table(path).metadata["hilfit.events"]) == summary.events
    assert json.loads(events_path(path).read_text()) == summary.events
    assert "\n" not in summary.events[0]["text"]


def test_events_say_how_long_something_lasted_and_storms_are_one_line() -> None:
    now = [0]
    log = EventLog(lambda: now[0], lambda: now[0])
    log.begin("a", "silent", "gone")
    for _ in range(5000):
        now[0] += 100_000
        log.note("b", "emergency", "0x1000")
    now[0] += 2_000_000_000
    log.note("b", "emergency", "0x1000")
    assert log.end("a", "silent") == pytest.approx(2.5)
    assert log.end("a", "silent") is None
    events = log.published()
    assert [(e["device"], e["count"]) for e in events] == [("a", 1), ("b", 5000), ("b", 1)]
    assert events[0]["seconds"] == pytest.approx(2.5)
    assert [e["number"] for e in events] == [1, 2, 3]


def test_what_lasts_stays_published_however_much_happens() -> None:
    now = [0]
    log = EventLog(lambda: now[0], lambda: now[0])
    log.begin("can0", "bus_down", "nothing answers")
    for number in range(500):
        now[0] += 2_000_000_000
        log.note(f"node {number}", "boot_up", "x" * 1000)
    events = log.published()
    assert len(events) == 64 and len(json.dumps(events)) < 32_000
    assert any(event["what"] == "bus_down" for event in events)
    log.end("can0", "bus_down")
    assert any(event["what"] == "bus_down" and event["seconds"] == 1000.0 for event in log.published())
