"""Raw traces of CAN buses: every frame as it came and as it was sent, by python-can's writers, one file per bus.

``trace.blf`` becomes ``trace-<bus>.blf``; a file that is full is renamed with moment and number, and the next one is
begun. Time stamps are UTC by this computer's clock, so that traces of several buses go together. Writing is done by a
thread of its own: a disk that waits must not keep frames from being received.
"""

from __future__ import annotations

import contextlib
import queue
import re
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import IO, Any

import can
from can.io.logger import SizedRotatingLogger

from daq.drivers.can.port import CanAccess
from daq.errors import InputError, first_line
from daq.frames.events import EventLog
from daq.messages import Sentence

SUFFIXES = (".blf", ".asc", ".log")  # Vector binary, Vector text, candump
FILE_BYTES = 64_000_000  # of one file; at 3000 frames per second about ten minutes of candump's text


def _blf(opened: IO[bytes]) -> can.BLFReader:
    if opened.read(4) != b"LOGG":  # it would say how many bytes it lacks
        raise ValueError("no BLF file")
    opened.seek(0)
    return can.BLFReader(opened)


_READERS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    ".blf": ("rb", _blf), ".asc": ("r", partial(can.ASCReader, relative_timestamp=False)),
    ".log": ("r", can.CanutilsLogReader), ".trc": ("r", can.TRCReader),
}  # fmt: skip
WAITING = 200_000  # frames that may wait for the disk; beyond, they are counted and lost


def bus_file(trace: Path, bus: str) -> Path:
    """Return the path of the file of one bus of a trace."""
    return trace.with_name(f"{trace.stem}-{bus}{trace.suffix}")


def check_trace(trace: Path) -> None:
    """Raise InputError if a trace cannot be written in that form."""
    if trace.suffix.lower() not in SUFFIXES:
        raise InputError("daq.unknown_kind_of_trace", trace=trace, suffix=trace.suffix, suffixes=SUFFIXES)


class TraceAccess(CanAccess):
    """Opens buses by their interfaces, and writes every frame."""

    def __init__(self, trace: Path, events: EventLog, file_bytes: int = FILE_BYTES) -> None:
        check_trace(trace)
        self._trace = trace
        self._events = events
        self._file_bytes = file_bytes
        self._waiting: queue.SimpleQueue[tuple[str, can.Message] | None] = queue.SimpleQueue()
        self._writers: dict[str, Any] = {}
        self._failed = False
        self._thread = threading.Thread(target=self._run, name="trace", daemon=True)
        self._thread.start()

    def noted(self, name: str) -> Callable[[can.Message], None]:
        """Return a callback for frames of a bus, in whatever thread they come."""

        def note(message: can.Message) -> None:
            if self._waiting.qsize() < WAITING:
                self._waiting.put((name, message))
            else:
                self._events.note(name, "trace_lost", Sentence("daq.disk_too_slow_trace", trace=self._trace))

        return note

    def _run(self) -> None:
        while (item := self._waiting.get()) is not None:
            if self._failed:
                continue
            name, message = item
            try:
                message.channel = 0  # a file is of one bus, and BLF knows channels by numbers only
                self._writer(name).on_message_received(message)
            except (OSError, ValueError) as error:
                self._failed = True
                self._events.begin(
                    name, "trace_failed", Sentence("daq.not_writable", trace=bus_file(self._trace, name), error=error)
                )
        for writer in self._writers.values():
            with contextlib.suppress(OSError, ValueError):
                writer.stop()

    def _writer(self, name: str) -> Any:
        if name not in self._writers:
            path = bus_file(self._trace, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writers[name] = SizedRotatingLogger(str(path), max_bytes=self._file_bytes)
        return self._writers[name]

    def close(self) -> None:
        """Write what waits, and close the files."""
        self._waiting.put(None)
        self._thread.join(timeout=10.0)


def trace_files(path: Path) -> list[Path]:
    """List a bus's files in the order in which they were written: full ones, then the last one."""
    pattern = re.compile(re.escape(path.stem) + r"_\d{4}-\d\d-\d\dT\d{6}_#(\d+)" + re.escape(path.suffix))
    numbered = [(int(match[1]), other) for other in path.parent.iterdir() if (match := pattern.fullmatch(other.name))]
    return [*(other for _, other in sorted(numbered)), *([path] if path.is_file() else [])]


def read_trace(path: Path) -> Iterator[can.Message]:
    """Read all frames of a bus's files.

    Raises
    ------
    InputError
        If one is no trace.
    """
    for file in trace_files(path):
        try:
            # Opened here: a reader that does not like how a file begins would leave it open.
            mode, reader = _READERS[file.suffix.lower()]
            with file.open(mode) as opened, reader(opened) as frames:
                yield from frames
        except Exception as error:  # python-can's readers let out whatever becomes of a file that contradicts itself
            line = first_line(error)
            raise InputError("daq.not_a_trace", file=file, line=line) from None
