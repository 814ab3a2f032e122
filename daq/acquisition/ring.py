"""Ring buffer in shared memory: one writer, any number of readers in any process, readers know what they missed.

Layout::

    header | info text | slot 0 | slot 1 | ... | slot n-1        slot = | before u64 | row | after u64 |

Row ``k`` (counted from 0 since the ring was made) lives in slot ``k mod n``. The writer stores ``k + 1`` in
``before``, then the row, then ``k + 1`` in ``after``, then ``k + 1`` in the header. A reader checks
``after``, copies the row, then checks
``before``: both being ``k + 1``, nobody wrote in between. The writer never waits for anyone. The order of the stores
is the interpreter's; on processors that reorder stores (not x86) a copy may be taken for torn, and is read again.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import resource_tracker, shared_memory
from pathlib import Path
from typing import Any, Self

import numpy as np
import orjson

from daq.arrays import RowArray
from daq.errors import AcquisitionError
from daq.frames.frame import Frame, row_dtype
from daq.messages import put_together, with_their_messages

MAGIC = b"hilfit/ring/2"
INFO_BYTES = 65536
_HEADER = np.dtype(
    [
        ("magic", "S16"),
        ("slots", np.uint64),
        ("channels", np.uint64),  # of a row (:func:`daq.frames.frame.row_dtype`)
        ("written", np.uint64),
        ("closed", np.uint64),
        ("writer_pid", np.uint64),
        ("info_before", np.uint64),
        ("info_bytes", np.uint64),
        ("info_after", np.uint64),
    ]
)
_START = (_HEADER.itemsize + INFO_BYTES + 63) // 64 * 64  # of the first slot
_ATTACHING = threading.Lock()


@dataclass(frozen=True)
class Rows:
    """Result of one read: rows in order, and the number before the first of them that is lost for good."""

    rows: RowArray
    missed: int


class _Ring:
    """The mapped memory; views are released before the mapping is."""

    def __init__(self, memory: shared_memory.SharedMemory) -> None:
        self._memory = memory
        buffer = _buffer(memory)
        self._header: RowArray = np.ndarray((1,), dtype=_HEADER, buffer=buffer)
        if self._header["magic"][0] != MAGIC:
            self.close()
            raise AcquisitionError("daq.shared_memory_no_ring", memory=memory.name)
        self._written = self._header["written"]
        self._slots = int(self._header["slots"][0])
        self.dtype = row_dtype(int(self._header["channels"][0]))
        self._slot: RowArray = np.ndarray((self._slots,), dtype=_slot_dtype(self.dtype), buffer=buffer, offset=_START)
        self._before = self._slot["before"]
        self._after = self._slot["after"]
        self._row = self._slot["row"]

    @property
    def name(self) -> str:
        """The name by which other processes attach."""
        return self._memory.name

    @property
    def written(self) -> int:
        """Rows ever written."""
        return int(self._written[0])

    @property
    def closed(self) -> bool:
        """True once the writer announced that no more will come."""
        return bool(self._header["closed"][0])

    @property
    def writer_alive(self) -> bool:
        """True while the writer's process is there (false also before it attached)."""
        pid = self.writer_pid
        if pid == 0:
            return False
        try:
            os.kill(pid, 0)
            # One that was killed is still there until its parent looks: field 3 of proc_pid_stat(5).
            return (
                Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(") ")[2][:1]
                not in "ZX"
            )
        except ProcessLookupError:
            return False
        except OSError:
            return True

    @property
    def writer_pid(self) -> int:
        """The writer's process; 0 before it attached."""
        return int(self._header["writer_pid"][0])

    def info(self) -> dict[str, Any]:
        """Read the writer's last statistics, or an empty dictionary."""
        start = _HEADER.itemsize
        for _ in range(100):
            after = int(self._header["info_after"][0])
            text = bytes(_buffer(self._memory)[start : start + int(self._header["info_bytes"][0])])
            if int(self._header["info_before"][0]) == after:
                return put_together(json.loads(text)) if text else {}
            time.sleep(0.0005)
        return {}

    def close(self) -> None:
        """Release the memory; it exists until its maker unlinks it."""
        for name in ("_header", "_written", "_slot", "_before", "_after", "_row", "_columns"):
            self.__dict__.pop(name, None)
        self._memory.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()


class RingWriter(_Ring):
    """The one writer of a ring."""

    def __init__(self, name: str) -> None:
        super().__init__(_attach(name))
        self._next = self.written
        self._columns = {name: self._row[name] for name in self.dtype.names or ()}
        self._header["writer_pid"] = os.getpid()
        self._header["closed"] = 0

    def write(self, frame: Frame) -> None:
        """Append a frame; the oldest row goes if the ring is full."""
        sequence = self._next + 1
        slot = self._next % self._slots
        column = self._columns
        self._before[slot] = sequence
        column["cycle"][slot], column["time"][slot] = frame.cycle, frame.time
        column["monotonic_ns"][slot], column["utc_ns"][slot] = frame.monotonic_ns, frame.utc_ns
        column["values"][slot], column["ages"][slot], column["quality"][slot] = frame.values, frame.ages, frame.quality
        self._after[slot] = sequence
        self._written[0] = sequence
        self._next = sequence

    def set_info(self, info: dict[str, Any]) -> bool:
        """Publish statistics for whoever reads; False, and nothing published, if they do not fit."""
        texts = (orjson.dumps(content) for content in (with_their_messages(info), info))
        text = next((text for text in texts if len(text) <= INFO_BYTES), None)
        if text is None:
            return False
        count = int(self._header["info_before"][0]) + 1
        self._header["info_before"] = count
        start = _HEADER.itemsize
        _buffer(self._memory)[start : start + len(text)] = text
        self._header["info_bytes"] = len(text)
        self._header["info_after"] = count
        return True

    def finish(self) -> None:
        """Signal the readers that no more will come."""
        self._header["closed"] = 1


class RingReader(_Ring):
    """A reader of its own position; ``from_start`` begins with the oldest row that is there, else with the next one."""

    def __init__(self, name: str, *, from_start: bool = False) -> None:
        super().__init__(_attach(name))
        written = self.written
        self._next = max(0, written - self._slots) if from_start else written

    @property
    def position(self) -> int:
        """Number of the row that comes next."""
        return self._next

    def read(self, limit: int | None = None) -> Rows:
        """Copy all rows that are there (at most ``limit``), and count those lost before them."""
        missed = 0
        while True:
            written = self.written
            oldest = written - self._slots
            if self._next < oldest:
                missed += self._skip_to(oldest)
            count = written - self._next
            if limit is not None:
                count = min(count, limit)
            if count <= 0:
                return Rows(np.empty(0, dtype=self.dtype), missed)
            sequences = np.arange(self._next, self._next + count, dtype=np.uint64)
            slots = sequences % np.uint64(self._slots)
            whole = self._after[slots] == sequences + np.uint64(1)
            rows = self._row[slots]  # fancy indexing copies
            whole &= self._before[slots] == sequences + np.uint64(1)
            if whole.all():
                self._next += count
                return Rows(rows, missed)
            # Only the oldest rows can be overwritten while they are copied: what follows the last torn one is whole.
            last_torn = int(np.flatnonzero(~whole)[-1])
            if last_torn + 1 < count:
                missed += self._skip_to(self._next + last_torn + 1)
                self._next += count - last_torn - 1
                return Rows(rows[last_torn + 1 :], missed)
            if self._next >= self.written - self._slots:
                time.sleep(0)  # the writer is inside the very slot: let it finish

    def _skip_to(self, row: int) -> int:
        lost = row - self._next
        self._next = row
        return lost

    def wait(self, timeout: float, poll: float = 0.002) -> bool:
        """Wait until a row is there (True), the writer finished, or ``timeout`` s passed (False)."""
        deadline = time.monotonic() + timeout
        while self.written <= self._next:
            if self.closed or time.monotonic() >= deadline:
                return False
            time.sleep(poll)
        return True

    def latest(self) -> RowArray | None:
        """Copy the newest row, shape (1,), without moving this reader; None before the first one."""
        while (written := self.written) > 0:
            slot = (written - 1) % self._slots
            whole = int(self._after[slot]) == written
            row = self._row[slot : slot + 1].copy()
            if whole and int(self._before[slot]) == written:
                return row
        return None


@contextlib.contextmanager
def ring_buffer(dtype: np.dtype[np.void], slots: int, name: str | None = None) -> Iterator[str]:
    """Make a ring for rows of ``dtype`` (:func:`daq.frames.frame.row_dtype`) and yield its name; gone with the block.

    Raises
    ------
    AcquisitionError
        If a ring of that name is there already.
    """
    size = _START + slots * _slot_dtype(dtype).itemsize
    try:
        memory = shared_memory.SharedMemory(name, create=True, size=size)
    except FileExistsError:
        raise AcquisitionError("daq.ring_buffer_there_already", name=name) from None
    try:
        header = np.ndarray((1,), dtype=_HEADER, buffer=_buffer(memory))
        header["slots"], header["channels"] = slots, dtype["values"].shape[0]
        header["magic"] = MAGIC
        del header  # a view that is alive would keep the memory from being closed
        yield memory.name
    finally:
        memory.close()
        memory.unlink()


def _attach(name: str) -> shared_memory.SharedMemory:
    """Attach without the resource tracker, which would remove the memory when this process ends (bpo-38119)."""
    with _ATTACHING:
        register = resource_tracker.register
        resource_tracker.register = lambda name, rtype: None
        try:
            return shared_memory.SharedMemory(name)
        except (FileNotFoundError, ValueError):
            raise AcquisitionError("daq.no_ring_buffer", name=name) from None
        finally:
            resource_tracker.register = register


def _buffer(memory: shared_memory.SharedMemory) -> memoryview:
    if memory.buf is None:
        raise AcquisitionError("daq.ring_buffer_closed", memory=memory.name)
    return memory.buf


def _slot_dtype(row: np.dtype[np.void]) -> np.dtype[np.void]:
    size = (row.itemsize + 7) // 8 * 8
    return np.dtype(
        {
            "names": ["before", "row", "after"],
            "formats": [np.uint64, row, np.uint64],
            "offsets": [0, 8, 8 + size],
            "itemsize": 16 + size,
        }
    )
