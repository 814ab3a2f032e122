"""The recorder: from the ring buffer to a file that a kill -9 in mid-recording does not lose.

It is a reader of the ring like any other and runs in any process. Rows go to a journal that is synced each second
(:mod:`daq.acquisition.journal`); at the end the journal becomes the recording.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from daq.acquisition.journal import Journal
from daq.acquisition.ledger import FRAME, LOST, SKIP, Ledger
from daq.acquisition.ring import RingReader
from daq.arrays import FlagArray, FloatArray, RowArray
from daq.errors import AcquisitionError, HilfitError
from daq.frames.channels import channel_table
from daq.frames.events import RecordedEvents
from daq.frames.frame import row_dtype
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.quality import Quality
from daq.recordings.recording import recording_table
from daq.recordings.recording_files import arrow_array, numbers_of

SYNC_SECONDS = 1.0
SILENCE_SECONDS = 10.0  # without a frame: acquisition hangs
UNMEASURED = (Quality.STALE, Quality.MISSING, Quality.BUS_ERROR, Quality.INVALID, Quality.HELD)

#: Called with rows that are safe on disk, and how many there will be (None: until it is stopped).
Progress = Callable[[int, int | None], None]


@dataclass(frozen=True)
class RecordingSummary:
    """Result of a recorder.

    Attributes
    ----------
    path : the sealed file
    rows : its rows, one per cycle, missed cycles included
    seconds : of machine time
    missed_cycles : rows that stand for cycles of which nothing is known
    quality : per channel, rows of each quality other than fresh
    ledger : per channel, ``produced``, ``stored`` and ``dropped`` by place and reason (:mod:`daq.acquisition.ledger`)
    events : what happened to devices and buses meanwhile (:class:`daq.frames.events.Event`), in the file's metadata too
    warnings : one line each
    """

    path: Path
    rows: int
    seconds: float
    missed_cycles: int
    quality: dict[str, dict[str, int]] = field(default_factory=dict)
    ledger: dict[str, dict[str, Any]] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)
    warnings: tuple[str, ...] = ()


class Recorder:
    """Records one machine from its ring buffer.

    Parameters
    ----------
    ring_name : ring of a running acquisition of this machine
    machine : the machine
    role : role of the recording (see :data:`daq.recordings.recording.ROLES`)
    path : ``.parquet`` or ``.csv``
    overwrite : replace a file of that name

    Either call :meth:`record`, which returns when it is done; or :meth:`start` and later :meth:`stop`.
    """

    def __init__(
        self, ring_name: str, machine: Machine, role: str, path: str | Path, *, overwrite: bool = False
    ) -> None:
        self._ring_name = ring_name
        self._machine = machine
        self._role = role
        self._path = Path(path)
        self._overwrite = overwrite
        self._stop = threading.Event()
        # Not Thread.join: one that Ctrl-C interrupts takes the thread for ended ever after (bpo-45274).
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._error: HilfitError | None = None
        self._summary: RecordingSummary | None = None
        self._rows = 0

    @property
    def rows(self) -> int:
        """Rows that are safe on disk."""
        return self._rows

    def record(self, seconds: float | None, progress: Progress | None = None) -> RecordingSummary:
        """Record ``seconds`` of machine time (None: until :meth:`stop`) from the next frame on, and seal the file.

        Raises
        ------
        RecordingError
            If the place cannot be written to.
        StorageError
            If the disk refuses later; rows that were acknowledged are in the journal, for ``hilfit recover``.
        AcquisitionError
            If acquisition ended before; what had come until then is sealed all the same.
        """
        total = None if seconds is None else max(1, round(seconds * self._machine.rate_hz))
        dtype = row_dtype(len(self._machine.channels))
        table = channel_table(self._machine)
        with RingReader(self._ring_name) as ring:
            if ring.dtype != dtype:
                raise AcquisitionError(
                    "daq.ring_buffer_not_machine", ring_name=self._ring_name, machine=self._machine.name
                )
            writer = _Writer(self._machine, self._role, self._path, table.names, self._overwrite)
            events = RecordedEvents(self._path)
            try:
                failure = self._follow(ring, writer, events, total, progress)
                summary = writer.seal(events)
            except BaseException:
                writer.journal.abandon()
                raise
        if failure is not None:
            raise AcquisitionError("daq.rows_until_then", failure=failure, rows=summary.rows, path=self._path)
        return summary

    def _follow(
        self,
        ring: RingReader,
        writer: _Writer,
        events: RecordedEvents,
        total: int | None,
        progress: Progress | None,
    ) -> str | None:
        """Copy rows until there are enough; returns why not, if acquisition ended before."""
        last_frame = time.monotonic()
        next_sync = last_frame  # at once: whoever watches sees that it follows the ring now
        while True:
            rows = ring.read()
            now = time.monotonic()
            if len(rows.rows):
                last_frame = now
                writer.take(rows.rows, total, rows.missed)
            complete = total is not None and writer.rows >= total
            ended = complete or self._stop.is_set()
            failure = None
            if not ended and not len(rows.rows):
                if ring.closed or not ring.writer_alive:
                    failure = Sentence("daq.acquisition_ended", machine=self._machine.name)
                elif now - last_frame > SILENCE_SECONDS:
                    failure = Sentence(
                        "daq.acquisition_sends_nothing", machine=self._machine.name, silence_seconds=SILENCE_SECONDS
                    )
            if ended or failure or now >= next_sync:
                next_sync = now + SYNC_SECONDS
                writer.sync()
                events.take(ring.info().get("events", ()), writer.first_utc_ns)
                self._rows = writer.journal.rows
                if progress is not None:
                    progress(self._rows, total)
            if ended or failure:
                return failure
            ring.wait(min(0.2, max(0.0, next_sync - now)), poll=0.01)

    def start(self, seconds: float | None = None, progress: Progress | None = None) -> None:
        """Record in a thread of this process until :meth:`stop`, or for ``seconds``."""

        def run() -> None:
            try:
                self._summary = self.record(seconds, progress)
            except HilfitError as error:
                self._error = error
            except Exception as error:  # who waits for the thread has to hear of a bug as well
                self._error = AcquisitionError(
                    "daq.recording_broke", path=self._path, name=type(error).__name__, error=error
                )
                raise
            finally:
                self._ended.set()

        self._thread = threading.Thread(target=run, name=f"recorder-{self._path.name}", daemon=True)
        self._thread.start()

    @property
    def active(self) -> bool:
        """True while the thread of :meth:`start` is recording."""
        return self._thread is not None and not self._ended.is_set()

    def stop(self) -> RecordingSummary:
        """End a recording begun by :meth:`start`; returns its summary or raises what :meth:`record` would have."""
        self._stop.set()
        return self.wait()

    def wait(self) -> RecordingSummary:
        """Wait for the end of a recording begun by :meth:`start`; as :meth:`stop`."""
        if self._thread is not None:
            self._ended.wait()
        if self._error is not None:
            raise self._error
        if self._summary is None:
            raise AcquisitionError("daq.recording_not_started", path=self._path)
        return self._summary


def rows_table(machine: Machine, role: str, rows: RowArray, time_s: FloatArray) -> pa.Table:
    """Build the recording's table of (N,) rows of the ring, at (N,) seconds."""
    values = np.where(np.isin(rows["quality"], UNMEASURED), np.nan, rows["values"])
    columns = [(i, channel.name) for i, channel in enumerate(machine.channels)]
    return recording_table(
        machine,
        role,
        time_s,
        {name: values[:, i] for i, name in columns},
        cycle=rows["cycle"],
        utc_ns=rows["utc_ns"],
        age={name: rows["ages"][:, i] for i, name in columns},
        quality={name: rows["quality"][:, i] for i, name in columns},
    )


def backdated(table: pa.Table, names: Sequence[str]) -> tuple[pa.Table, dict[str, int]]:
    """Mark frozen values of a recording from their beginning, and count how many more that is per channel.

    Live detection needs a while, so the first equal values of a sensor that hangs are called fresh. Here they are
    marked as well: every value equal to the one before it, back to the last change. The first value of such a run was
    a measurement, and remains one.

    Parameters
    ----------
    table : with a column ``<name>`` and ``<name>.quality`` for each of ``names``
    """
    added: dict[str, int] = {}
    for name in names:
        index = table.schema.get_field_index(f"{name}.quality")
        quality = numbers_of(table.column(index)).copy()
        marked = _mark(numbers_of(table.column(name)), quality)
        if marked:
            added[name] = marked
            field = table.schema.field(index)
            table = table.set_column(index, field, arrow_array(quality))
    return table, added


def _mark(values: FloatArray, quality: npt.NDArray[np.integer]) -> int:
    """Mark one channel, in place; how many."""
    frozen = quality == Quality.FROZEN
    count = 0
    for start in np.flatnonzero(frozen & ~np.concatenate(([False], frozen[:-1]))):
        row = int(start) - 1
        while row > 0 and quality[row] == Quality.FRESH and values[row] == values[start] == values[row - 1]:
            quality[row] = Quality.FROZEN
            count += 1
            row -= 1
    return count


class _Writer:
    """Rows of the ring to rows of the recording: one per cycle, gaps filled with rows marked missing."""

    def __init__(self, machine: Machine, role: str, path: Path, names: tuple[str, ...], overwrite: bool) -> None:
        self._machine = machine
        self._role = role
        self._names = names
        self._dtype = row_dtype(len(names))
        self._pending: list[tuple[RowArray, FlagArray]] = []
        self._counts = np.zeros((len(Quality), len(names)), dtype=np.int64)
        self._first_cycle: int | None = None
        self._last: RowArray | None = None
        self._ledger = Ledger(names)
        self.first_utc_ns: int | None = None
        self.rows = 0
        self.missed = 0
        empty = np.empty(0, dtype=self._dtype)
        self.journal = Journal(path, self._table(empty).schema, overwrite=overwrite)

    def take(self, rows: RowArray, total: int | None, overwritten: int = 0) -> None:
        """Append rows, at most up to ``total`` of them in all; so many before them the ring has lost."""
        if self._first_cycle is None:
            self._first_cycle, self.first_utc_ns = int(rows["cycle"][0]), int(rows["utc_ns"][0])
        rows, origin = self._fill(rows, overwritten)
        if total is not None:
            left = max(0, total - self.rows)
            rows, origin = rows[:left], origin[:left]
        if len(rows):
            self._pending.append((rows, origin))
            self._last = rows[-1:]
            self.rows += len(rows)
            self.missed += int(np.count_nonzero(origin != FRAME))

    def _fill(self, rows: RowArray, overwritten: int) -> tuple[RowArray, FlagArray]:
        """Insert a row, marked missing, for every cycle that is not among the rows; and return what each represents."""
        known = rows if self._last is None else np.concatenate([self._last, rows])
        cycles = np.arange(int(known["cycle"][0]), int(known["cycle"][-1]) + 1)
        origin = np.full(len(cycles), SKIP, dtype=np.uint8)
        at = known["cycle"] - cycles[0]
        if self._last is not None:
            gap = (
                int(at[1]) - 1
            )  # what the ring lost was before the first row; cycles may have been skipped there as well
            origin[1 : 1 + min(gap, overwritten)] = LOST
        origin[at] = FRAME
        if len(cycles) == len(known):
            return rows, origin[len(origin) - len(rows) :]
        filled = np.zeros(len(cycles), dtype=self._dtype)
        filled["values"] = filled["ages"] = np.nan
        filled["quality"] = Quality.MISSING
        filled["cycle"] = cycles
        filled["utc_ns"] = np.interp(cycles, known["cycle"], known["utc_ns"] - known["utc_ns"][0])
        filled["utc_ns"] += known["utc_ns"][0]
        filled[at] = known
        return (filled, origin) if self._last is None else (filled[1:], origin[1:])

    def sync(self) -> None:
        """Flush what is pending to disk."""
        if not self._pending:
            return
        rows = np.concatenate([rows for rows, _ in self._pending])
        origin = np.concatenate([origin for _, origin in self._pending])
        table = self._table(rows)
        self.journal.append(table)
        self._pending.clear()
        for quality in Quality:
            self._counts[quality] += (rows["quality"] == quality).sum(axis=0)
        stored = np.column_stack([np.isfinite(numbers_of(table.column(name))) for name in self._names])
        self._ledger.add(rows["quality"], stored, origin)

    def _table(self, rows: RowArray) -> pa.Table:
        time_s: FloatArray = (rows["cycle"] - (self._first_cycle or 0)) / self._machine.rate_hz
        return rows_table(self._machine, self._role, rows, time_s)

    def _backdated(self, table: pa.Table) -> pa.Table:
        """Mark frozen values from their beginning, unknown while they came."""
        table, added = backdated(table, self._names)
        for name, count in added.items():
            index = self._names.index(name)
            self._counts[Quality.FRESH, index] -= count
            self._counts[Quality.FROZEN, index] += count
        return table

    def seal(self, events: RecordedEvents) -> RecordingSummary:
        """Make the recording."""
        self._ledger.close(self._first_cycle, None if self._last is None else int(self._last["cycle"][0]))
        ledger = self._ledger.as_dict()
        metadata = {"hilfit.ledger": json.dumps(ledger), "hilfit.events": json.dumps(events.listed)}
        leftover = self.journal.seal(metadata, self._backdated)
        quality = {
            name: {q.name.lower(): int(self._counts[q, i]) for q in Quality if q and self._counts[q, i]}
            for i, name in enumerate(self._names)
        }
        return RecordingSummary(
            path=self.journal.path,
            rows=self.rows,
            seconds=self.rows / self._machine.rate_hz,
            missed_cycles=self.missed,
            quality={name: counts for name, counts in quality.items() if counts},
            ledger=ledger,
            events=events.listed,
            warnings=tuple(line for line in (leftover, events.warning) if line),
        )
