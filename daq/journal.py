"""The journal of a recording under way: an Arrow IPC stream, synced to disk every second, sealed when it is complete.

A killed process leaves ``<file>.journal`` behind; every batch that was synced is in it whole, and
:func:`recover` seals it. The journal of a recording that is still under way is locked, and is left alone.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.ipc

from daq.errors import RecordingError
from daq.recording_files import read_table, write_table

JOURNAL_SUFFIX = ".journal"


def journal_path(path: Path) -> Path:
    """Where the journal of the recording ``path`` is."""
    return path.with_name(path.name + JOURNAL_SUFFIX)


class Journal:
    """The journal of one recording; ``append`` returns when the rows are on disk.

    Raises
    ------
    RecordingError
        If the recording or its journal is there already, or cannot be written.
    """

    def __init__(self, path: Path, schema: pa.Schema, *, overwrite: bool = False) -> None:
        if path.exists() and not overwrite:
            raise RecordingError(f"{path}: is there already; choose another name, or remove it first")
        self.path = path
        self.rows = 0
        self._journal = journal_path(path)
        try:
            if not path.parent.is_dir():
                path.parent.mkdir(parents=True)
            self._file = self._journal.open("xb")
        except FileExistsError as error:
            if error.filename != str(self._journal):
                raise RecordingError(f"{path}: cannot be written (not a directory); choose another place") from None
            raise RecordingError(
                f"{path}: its journal is there already: it is being recorded, or was left by a kill; run "
                "'hilfit recover'"
            ) from None
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror}); choose another place") from None
        fcntl.flock(self._file, fcntl.LOCK_EX)
        self._stream = pa.ipc.new_stream(self._file, schema)

    def append(self, table: pa.Table) -> None:
        """Write rows and sync them; when this returns they survive kill -9 and a power cut."""
        try:
            for batch in table.combine_chunks().to_batches():
                self._stream.write_batch(batch)
            self._file.flush()
            os.fdatasync(self._file.fileno())
        except OSError as error:
            raise RecordingError(f"{self._journal}: cannot be written ({error.strerror}); free some space") from None
        self.rows += table.num_rows

    def seal(self) -> None:
        """Turn the journal into the recording; without rows, nothing stays."""
        self._stream.close()
        self._file.flush()
        try:
            if self.rows:
                write_table(self.path, _read(self._journal))
            self._journal.unlink()
        finally:
            self._file.close()  # and with it the lock

    def abandon(self) -> None:
        """Close without sealing; what is in the journal stays for :func:`recover`."""
        with contextlib.suppress(pa.ArrowException, OSError):
            self._stream.close()
        self._file.close()


@dataclass(frozen=True)
class Recovered:
    """What became of one journal: the sealed file and its rows; None if the journal held no row."""

    journal: Path
    file: Path | None
    rows: int


def recover(directory: str | Path) -> tuple[Recovered, ...]:
    """Seal all journals in ``directory`` and below that no living process is writing.

    A recording of the same name that holds other rows is not touched: the recovered one is called ``<name>.recovered``.

    Raises
    ------
    RecordingError
        If there is no such directory, or a file cannot be written.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise RecordingError(f"{directory}: no such directory; give the one that recordings are written to")
    results = []
    for journal in sorted(directory.rglob("*" + JOURNAL_SUFFIX)):
        with journal.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            results.append(_recover_one(journal))
    return tuple(results)


def _recover_one(journal: Path) -> Recovered:
    path = journal.with_name(journal.name.removesuffix(JOURNAL_SUFFIX))
    table = _read(journal)
    if table.num_rows == 0:
        journal.unlink()
        return Recovered(journal, None, 0)
    if path.exists():
        # Killed between the rename and the removal of the journal, or another recording took the name since.
        if read_table(path).rows != table.num_rows:
            path = path.with_name(f"{path.stem}.recovered{path.suffix}")
            write_table(path, table)
    else:
        write_table(path, table)
    journal.unlink()
    return Recovered(journal, path, table.num_rows)


def _read(journal: Path) -> pa.Table:
    """All whole batches of a journal, also of one that ends in the middle of one."""
    batches: list[pa.RecordBatch] = []
    schema = pa.schema([])
    with journal.open("rb") as file, contextlib.suppress(pa.ArrowException, OSError, EOFError, StopIteration):
        stream = pa.ipc.open_stream(file)
        schema = stream.schema
        while True:
            batches.append(stream.read_next_batch())
    return pa.Table.from_batches(batches, schema=schema)
