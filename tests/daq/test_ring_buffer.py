"""The ring buffer against a model, between processes, and with readers that are too slow."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from daq.acquisition.ring import RingReader, RingWriter, ring_buffer
from daq.errors import AcquisitionError
from daq.frames.frame import Frame, frame_from_row, row_dtype, row_from_frame
from daq.messages import Sentence, named

DTYPE = row_dtype(3)


def frame(number: int) -> Frame:
    """A frame in which every field says the same number, so that a torn row is seen."""
    made = np.zeros(1, dtype=DTYPE)
    made["cycle"] = made["monotonic_ns"] = made["utc_ns"] = made["time"] = number
    made["values"] = made["ages"] = number
    made["quality"] = number % 251
    return frame_from_row(made[0])


def numbers(rows: np.ndarray) -> list[int]:
    """The numbers of rows, after a look that none is torn."""
    cycles = rows["cycle"]
    for name in ("monotonic_ns", "utc_ns", "time"):
        np.testing.assert_array_equal(rows[name], cycles)
    for name in ("values", "ages"):
        np.testing.assert_array_equal(rows[name], np.repeat(cycles[:, None], 3, axis=1))
    np.testing.assert_array_equal(rows["quality"][:, 0], cycles % 251)
    return [int(cycle) for cycle in cycles]


@pytest.fixture
def ring() -> Iterator[str]:
    with ring_buffer(DTYPE, 16) as name:
        yield name


class RingAgainstModel(RuleBasedStateMachine):
    """One writer, three readers; the model is a list of all rows ever written."""

    CAPACITY = 7

    def __init__(self) -> None:
        super().__init__()
        self.stack = ExitStack()
        self.name = self.stack.enter_context(ring_buffer(DTYPE, self.CAPACITY))
        self.writer = self.stack.enter_context(RingWriter(self.name))
        self.readers = [self.stack.enter_context(RingReader(self.name)) for _ in range(3)]
        self.next = [0, 0, 0]
        self.written = 0

    @rule(count=st.integers(1, 20))
    def write(self, count: int) -> None:
        for _ in range(count):
            self.writer.write(frame(self.written))
            self.written += 1

    @rule(which=st.integers(0, 2), limit=st.none() | st.integers(1, 10))
    def read(self, which: int, limit: int | None) -> None:
        found = self.readers[which].read(limit)
        oldest = max(0, self.written - self.CAPACITY)
        missed = max(0, oldest - self.next[which])
        start = self.next[which] + missed
        stop = self.written if limit is None else min(self.written, start + limit)
        assert found.missed == missed
        assert numbers(found.rows) == list(range(start, stop))
        self.next[which] = stop

    @rule()
    def a_reader_comes_late(self) -> None:
        with RingReader(self.name) as new, RingReader(self.name, from_start=True) as old:
            assert len(new.read().rows) == 0
            assert numbers(old.read().rows) == list(range(max(0, self.written - self.CAPACITY), self.written))

    @invariant()
    def nothing_is_lost_untold(self) -> None:
        assert self.writer.written == self.written
        for reader, position in zip(self.readers, self.next, strict=True):
            assert reader.position == position

    @invariant()
    def the_newest_row_is_there(self) -> None:
        latest = self.readers[0].latest()
        assert latest is None if self.written == 0 else numbers(latest) == [self.written - 1]

    def teardown(self) -> None:
        self.stack.close()


TestRingAgainstModel = RingAgainstModel.TestCase
TestRingAgainstModel.settings = settings(max_examples=30, stateful_step_count=25, deadline=None)


def _write_rows(name: str, count: int) -> None:
    with RingWriter(name) as writer:
        for number in range(count):
            writer.write(frame(number))
        writer.finish()


@pytest.mark.slow
@pytest.mark.parametrize("slots", [4, 64])
def test_no_row_is_torn_between_processes(slots: int) -> None:
    count = 20_000
    with ring_buffer(DTYPE, slots) as name, RingReader(name) as reader:
        process = multiprocessing.get_context("spawn").Process(target=_write_rows, args=(name, count))
        process.start()
        seen: list[int] = []
        missed = 0
        while True:
            ended = reader.closed
            found = reader.read()
            missed += found.missed
            seen += numbers(found.rows)
            if ended and len(found.rows) == 0:
                break
            reader.wait(0.05)
        process.join()
        assert process.exitcode == 0
        assert seen == sorted(set(seen))
        assert len(seen) + missed == count  # what is not there is known to be lost
        assert seen[-1] == count - 1


def test_waiting_ends_with_a_row_or_with_the_writer(ring: str) -> None:
    with RingWriter(ring) as writer, RingReader(ring) as reader:
        assert not reader.wait(0.0)
        writer.write(frame(1))
        assert reader.wait(10.0)
        reader.read()
        writer.finish()
        assert not reader.wait(10.0)  # would take ten seconds if it did not know
        assert reader.closed


def test_the_ring_holds_information_about_its_writer(ring: str) -> None:
    with RingReader(ring) as reader:
        assert reader.info() == {}
        assert not reader.writer_alive
        with RingWriter(ring) as writer:
            assert writer.set_info({"cycles": 3})
            assert writer.set_info({"cycles": 4, "note": "ö"})
            assert reader.writer_alive
            assert not writer.set_info({"long": "x" * 100_000})  # what was there stays
        assert reader.info() == {"cycles": 4, "note": "ö"}


def test_statistics_keep_what_sentences_were_made_of_while_there_is_room(ring: str) -> None:
    line = named("can", "x" * 1000)
    with RingReader(ring) as reader, RingWriter(ring) as writer:
        assert writer.set_info({"warnings": [line]})
        assert isinstance(reader.info()["warnings"][0], Sentence)
        assert writer.set_info({"warnings": [line] * 60})
        assert reader.info()["warnings"] == [line] * 60
        longest = [named("can", f"{number}" + "x" * 1000) for number in range(50)]
        assert writer.set_info({"warnings": longest})
        assert not isinstance(reader.info()["warnings"][0], Sentence) and reader.info()["warnings"] == longest


def test_a_writer_that_comes_back_goes_on_counting(ring: str) -> None:
    with RingReader(ring) as reader:
        for number in range(2):
            with RingWriter(ring) as writer:
                writer.write(frame(number))
                writer.finish()
        assert numbers(reader.read().rows) == [0, 1]


def test_a_ring_that_is_not_there_or_is_taken(ring: str) -> None:
    with pytest.raises(AcquisitionError, match="no ring buffer 'hilfit-nowhere'"):
        RingReader("hilfit-nowhere")
    with pytest.raises(AcquisitionError, match="already"), ring_buffer(DTYPE, 4, ring):
        raise AssertionError("a second ring of the same name")


def test_a_reader_that_ends_does_not_take_the_memory_away(ring: str) -> None:
    # Python's resource tracker would unlink shared memory when any process that attached to it ends.
    program = f"from daq.acquisition.ring import RingReader\nwith RingReader({ring!r}) as ring: print(ring.written)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "0\n"
    assert done.stderr == ""
    with RingReader(ring) as reader:
        assert reader.written == 0


def test_a_frame_is_written_as_its_row(ring: str) -> None:
    one = Frame(7, 11, 12, 0.14, np.array([1.0, np.nan, -2.5]), np.array([0.0, 0.1, np.nan]), np.uint8([0, 2, 9]))
    with RingWriter(ring) as writer, RingReader(ring) as reader:
        writer.write(one)
        (read,) = reader.read().rows
    assert read.tobytes() == row_from_frame(one).tobytes()
