"""The journal of a recording under way: batches of rows, synced to disk every second, sealed when it is complete.

A killed process leaves ``<file>.journal`` behind, and :func:`recover` seals it. The journal of a recording that is
still under way is locked, and is left alone. A journal is a row of records::

    mark (8 bytes) | kind 's' or 'b' | length u32 | CRC-32 of the rest u32 | Arrow schema, or record batch

The schema comes first, twice. A batch that was damaged on disk does not pass its check sum and costs itself: reading
goes on at the next mark. Older journals are plain Arrow streams, which are read up to the first damage.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import json
import mmap
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.ipc

from daq.acquisition.ledger import ledger_of
from daq.errors import DiskFullError, HilfitError, RecordingError, StorageError
from daq.messages import Sentence
from daq.recordings.recording_files import ARROW_STREAM_MAGIC, JOURNAL_MARK, numbers_of, read_table, write_table

JOURNAL_SUFFIX = ".journal"
#: What a journal is called when its rows are in a recording: nothing that a crash left behind is deleted by a program.
DONE_SUFFIX = ".recovered"
_HEAD = struct.Struct("<8scII")
_SCHEMA, _BATCH = b"s", b"b"


def journal_path(path: Path) -> Path:
    """Return the path of the journal of the recording ``path``."""
    return path.with_name(path.name + JOURNAL_SUFFIX)


def _storage_error(path: Path, operation: str, error: OSError, advice: str) -> StorageError:
    """Make one line of a failure; a full disk is an error of its own."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    reason = "the disk is full" if full else error.strerror or str(error)
    kind = DiskFullError if full else StorageError
    return kind(Sentence("daq.storage_failed", path=path, operation=operation, reason=reason, advice=advice), operation)


class Journal:
    """The journal of one recording; ``append`` returns when the rows are on disk.

    Raises
    ------
    RecordingError
        If the recording or its journal is there already, or the place cannot be written to.
    """

    def __init__(self, path: Path, schema: pa.Schema, *, overwrite: bool = False) -> None:
        if path.exists() and not overwrite:
            raise RecordingError("daq.there_already", path=path)
        self.path = path
        self.rows = 0
        self._journal = journal_path(path)
        try:
            if not path.parent.is_dir():
                path.parent.mkdir(parents=True)
            self._file = self._journal.open("xb")
        except FileExistsError as error:
            if error.filename != str(self._journal):
                raise RecordingError("daq.place_no_directory", path=path) from None
            raise RecordingError("daq.journal_there_already", path=path) from None
        except OSError as error:
            raise RecordingError("daq.not_writable_here", path=path, reason=error.strerror) from None
        fcntl.flock(self._file, fcntl.LOCK_EX)
        try:
            described = schema.serialize().to_pybytes()
            self._write(_SCHEMA, described)
            self._write(_SCHEMA, described)
        except StorageError:
            self.abandon()
            with contextlib.suppress(OSError):
                self._journal.unlink()  # there is no row in it
            raise

    def _write(self, kind: bytes, payload: bytes) -> None:
        head = _HEAD.pack(JOURNAL_MARK, kind, len(payload), zlib.crc32(payload))
        self._do("write", lambda: self._file.write(head + payload))

    def _do(self, operation: str, work: Callable[[], object]) -> None:
        try:
            work()
        except OSError as error:
            raise _storage_error(
                self._journal,
                operation,
                error,
                Sentence("daq.rows_safe_choose_disk", rows=self.rows),
            ) from None

    def append(self, table: pa.Table) -> None:
        """Write rows and sync them; when this returns they survive kill -9 and a power cut.

        Raises
        ------
        StorageError
            If the disk refuses; what was acknowledged before is safe.
        """
        for batch in table.combine_chunks().to_batches():
            self._write(_BATCH, batch.serialize().to_pybytes())
        self._do("write", self._file.flush)
        self._do("sync", lambda: os.fdatasync(self._file.fileno()))
        self.rows += table.num_rows

    def seal(
        self, metadata: Mapping[str, str] | None = None, finish: Callable[[pa.Table], pa.Table] = lambda table: table
    ) -> str | None:
        """Turn the journal into the recording, with more ``metadata``; without rows, nothing is left.

        ``finish`` is given all rows, and makes of them what is written.

        Returns
        -------
        str or None
            A line about a journal that could not be removed although its rows are in the recording.

        Raises
        ------
        StorageError
            If the recording cannot be written; the journal is kept.
        """
        try:
            if self.rows:
                found = _read(self._journal)
                if found.table.num_rows < self.rows:
                    raise StorageError(
                        Sentence(
                            "daq.rows_can_read_back",
                            journal=self._journal,
                            num_rows=found.table.num_rows,
                            rows=self.rows,
                        ),
                        "read",
                    )
                _seal(self.path, finish(found.table), metadata or {}, self._journal)
            try:
                self._journal.unlink()
            except OSError as error:
                return Sentence("daq.journal_not_removed", journal=self._journal, reason=error.strerror)
            return None
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close without sealing; what is in the journal is kept for :func:`recover`."""
        with contextlib.suppress(OSError):  # what could not be written was said before
            self._file.close()  # and with it the lock


def _seal(path: Path, table: pa.Table, metadata: Mapping[str, str], journal: Path) -> None:
    described = {**(table.schema.metadata or {}), **{key.encode(): text.encode() for key, text in metadata.items()}}
    advice = Sentence("daq.rows_safe_in", journal=journal.name)
    try:
        write_table(path, table.replace_schema_metadata(described))
    except OSError as error:
        raise _storage_error(path, "sealing", error, advice) from None
    except RecordingError as error:
        cause = error.__context__
        if not isinstance(cause, OSError):
            raise
        raise _storage_error(path, "sealing", cause, advice) from None


@dataclass(frozen=True)
class Recovered:
    """Outcome of recovering one journal.

    Attributes
    ----------
    journal : as it was found
    file : the sealed recording; None if there was none to seal
    rows : that are in it
    damaged : batches of which the check sum was wrong, or that were cut off
    left : why the journal was left as it is; empty if it was sealed, and then has the suffix ``.recovered``
    """

    journal: Path
    file: Path | None
    rows: int
    damaged: int = 0
    left: str = ""


def recover(directory: str | Path) -> tuple[Recovered, ...]:
    """Seal all journals in ``directory`` and below that no living process is writing; nothing is ever deleted.

    A recording of the same name that holds other rows is not touched: the recovered one is called ``<name>.recovered``.
    What is no journal of ours, or cannot be sealed, is named and left.

    Raises
    ------
    RecordingError
        If there is no such directory.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise RecordingError("daq.no_recordings_directory", directory=directory)
    results = []
    for journal in sorted(directory.rglob("*" + JOURNAL_SUFFIX)):
        if not journal.is_file():
            continue
        try:
            with journal.open("rb") as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    continue
                results.append(_recover_one(journal))
        except OSError as error:
            results.append(Recovered(journal, None, 0, left=f"cannot be read ({error.strerror})"))
        except HilfitError as error:
            results.append(Recovered(journal, None, 0, left=str(error)))
    return tuple(results)


def _recover_one(journal: Path) -> Recovered:
    path = journal.with_name(journal.name.removesuffix(JOURNAL_SUFFIX))
    found = _read(journal)
    if found.table.num_rows == 0:
        if not found.ours:
            return Recovered(journal, None, 0, found.damaged, "is no journal of hilfit")
        if found.damaged:
            return Recovered(journal, None, 0, found.damaged, "holds no row that can be read")
        _put_away(journal)
        return Recovered(journal, None, 0)
    # Killed between the rename and the removal of the journal, or another recording took the name since.
    if not (path.exists() and _same(path, found.table)):
        taken = path
        if path.exists():
            path = _free(lambda number: taken.with_name(f"{taken.stem}.recovered{number}{taken.suffix}"))
        _seal(path, found.table, _noted(found), journal)
    _put_away(journal)
    return Recovered(journal, path, found.table.num_rows, found.damaged)


def _same(path: Path, table: pa.Table) -> bool:
    """Return whether a recording holds the rows of a journal: same cycles, same times."""
    there = read_table(path)
    names = [name for name in ("time", "cycle", "utc_ns") if name in table.column_names]
    return there.rows == table.num_rows and all(
        name in there.columns and np.array_equal(there.columns[name], numbers_of(table.column(name))) for name in names
    )


def _noted(found: _Found) -> dict[str, str]:
    noted = {"hilfit.recovered": f"sealed after a kill; {found.damaged} damaged batches"}
    if "cycle" in found.table.column_names and any(name.endswith(".quality") for name in found.table.column_names):
        noted["hilfit.ledger"] = json.dumps(ledger_of(found.table))
    return noted


def _free(name: Callable[[str], Path]) -> Path:
    """Find the first free name; ``name`` makes one from its number, which the first does not show."""
    return next(
        path for number in itertools.count(1) if not (path := name("" if number == 1 else str(number))).exists()
    )


def _put_away(journal: Path) -> None:
    done = _free(lambda number: journal.with_name(f"{journal.name}{DONE_SUFFIX}{number}"))
    try:
        journal.rename(done)
    except OSError as error:
        raise _storage_error(journal, "rename", error, Sentence("daq.rows_in_recording")) from None


@dataclass(frozen=True)
class _Found:
    """Rows of a journal, how many batches were damaged, and whether it is a journal of ours at all."""

    table: pa.Table
    damaged: int
    ours: bool


def _read(journal: Path) -> _Found:
    """Read all whole batches of a journal, also of one that ends inside one."""
    if journal.stat().st_size == 0:
        return _Found(pa.table({}), 0, False)
    with journal.open("rb") as file:
        # Mapped, not read: hours of rows need not be in memory. Batches refer to the map and keep it.
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    if data[: len(ARROW_STREAM_MAGIC)] == ARROW_STREAM_MAGIC:
        return _read_stream(data)
    schema: pa.Schema | None = None
    batches: list[pa.RecordBatch] = []
    damaged = 0
    for kind, payload in _records(data):
        if payload is None:
            damaged += 1
            continue
        with contextlib.suppress(pa.ArrowException, OSError, ValueError):
            if kind == _SCHEMA and schema is None:
                schema = pa.ipc.read_schema(pa.py_buffer(payload))
            elif kind == _BATCH and schema is not None:
                batches.append(pa.ipc.read_record_batch(pa.py_buffer(payload), schema))
    if schema is None:
        return _Found(pa.table({}), damaged, data.find(JOURNAL_MARK) >= 0)
    return _Found(pa.Table.from_batches(batches, schema=schema), damaged, True)


def _records(data: mmap.mmap) -> Iterator[tuple[bytes, memoryview | None]]:
    """Read kind and content of each record; no content where the check sum is wrong."""
    view = memoryview(data)
    at = data.find(JOURNAL_MARK)
    while at >= 0:
        whole = False
        if at + _HEAD.size <= len(data):
            _, kind, length, checksum = _HEAD.unpack_from(data, at)
            end = at + _HEAD.size + length
            payload = view[at + _HEAD.size : end]
            whole = len(payload) == length and zlib.crc32(payload) == checksum
            yield kind, payload if whole else None
        else:
            yield b"", None
        at = data.find(JOURNAL_MARK, end if whole else at + 1)


def _read_stream(data: mmap.mmap) -> _Found:
    batches: list[pa.RecordBatch] = []
    schema = pa.schema([])
    with contextlib.suppress(pa.ArrowException, OSError, EOFError, StopIteration):
        stream = pa.ipc.open_stream(pa.py_buffer(data))
        schema = stream.schema
        while True:
            batches.append(stream.read_next_batch())
    return _Found(pa.Table.from_batches(batches, schema=schema), 0, bool(schema.names))
