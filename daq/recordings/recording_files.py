"""Tables on disk: Parquet and CSV, read whole, written whole or not at all.

Nothing here knows what a column means; :mod:`daq.recordings.recording` does.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from daq.arrays import FloatArray, IntArray
from daq.errors import RecordingError
from daq.recordings.csv_files import names_differ, read_csv
from daq.scratch import Scratch, ScratchColumns
from daq.whole_files import digest_of, replacing

PARQUET_MAGIC = b"PAR1"
ARROW_STREAM_MAGIC = b"\xff\xff\xff\xff"
JOURNAL_MARK = b"hilfitJ1"  # before every record of a journal
SUFFIXES = (".parquet", ".csv")
UNITS = "hilfit.units"  # in the metadata: a JSON object, by column
#: Values of a Parquet file above which its columns are not kept in memory (32 MB; half an hour of six joints at 50 Hz).
LONG_VALUES = 4_000_000
_BATCH_ROWS = 1 << 13
#: Columns that a check holds at once: time, its steps, and what is checked.
_COLUMNS_AT_ONCE = 3
_BUFFER = 1 << 20


@dataclass(frozen=True)
class Table:
    """Columns of a file, all of one length, in file order, and the file's metadata."""

    columns: Mapping[str, FloatArray | IntArray]
    metadata: Mapping[str, str]
    sha256: str

    @property
    def units(self) -> dict[str, str]:
        """Units of columns, as far as the metadata give them (ValueError where they are damaged)."""
        units = json.loads(self.metadata.get(UNITS, "{}"))
        if not isinstance(units, dict):
            raise ValueError("no units")
        return {str(name): str(unit) for name, unit in units.items()}

    @property
    def rows(self) -> int:
        """Number of rows."""
        return 0 if not self.columns else len(next(iter(self.columns.values())))


def read_table(path: Path) -> Table:
    """Read a Parquet or CSV file; integers remain integers (exact), all else becomes float64, null becomes NaN.

    Columns have the file's own names (:func:`daq.recordings.column_map.in_channels` finds channels); a CSV's moments
    remain text.

    Raises
    ------
    RecordingError
        If the file is absent, empty, torn, no table, or has a column that is not numeric.
    """
    if path.is_dir():
        raise RecordingError("daq.recording_is_directory", path=path)
    try:
        with path.open("rb") as file:
            head = file.read(4096)
        digest = digest_of(path)
    except FileNotFoundError:
        raise RecordingError("daq.no_such_file_give_path", path=path) from None
    except OSError as error:
        raise RecordingError("daq.not_readable", place=path, reason=error.strerror) from None
    if not head:
        raise RecordingError("daq.recording_empty", path=path)
    if head.startswith((ARROW_STREAM_MAGIC, JOURNAL_MARK)):
        raise RecordingError("daq.journal_unfinished_recording", path=path)
    if head.startswith(PARQUET_MAGIC):
        with _whole_parquet(path):
            file = pa.parquet.ParquetFile(path, buffer_size=_BUFFER)
        if file.metadata.num_rows * file.metadata.num_columns > LONG_VALUES:
            long = _read_long(path, file, digest)
            # A file keeps its last row group, and Arrow what it no longer needs: 150 MB of ten hours.
            del file
            pa.default_memory_pool().release_unused()
            return long
        with _whole_parquet(path):
            table = _moments_counted(file.read())  # one file: read_table would merge a directory's partitions
    elif path.suffix.lower() == ".parquet":
        raise RecordingError("daq.not_parquet_file_although", path=path)
    else:
        table, units = read_csv(path, head)
        metadata = {UNITS: json.dumps(units)} if units else {}
        columns = {
            name: column.to_numpy() if pa.types.is_string(column.type) else _numeric(path, name, column)
            for name, column in zip(table.column_names, table.columns, strict=True)
        }
        return Table(columns, metadata, digest)
    names_differ(path, table.column_names)
    columns = {name: _numeric(path, name, table.column(name)) for name in table.column_names}
    return Table(columns, _metadata(table.schema), digest)


def _moments_counted(table: pa.Table) -> pa.Table:
    """Convert a data frame's moments or durations to whole nanoseconds, and their unit to metadata."""
    units = {}
    for number, entry in enumerate(table.schema):
        if pa.types.is_timestamp(entry.type) or pa.types.is_duration(entry.type):
            kind = pa.timestamp("ns") if pa.types.is_timestamp(entry.type) else pa.duration("ns")
            units[entry.name] = "ns"
            table = table.set_column(number, entry.name, table.column(number).cast(kind).cast(pa.int64()))
    if not units or UNITS.encode() in (table.schema.metadata or {}):
        return table
    return table.replace_schema_metadata({**(table.schema.metadata or {}), UNITS: json.dumps(units)})


def _metadata(schema: pa.Schema) -> dict[str, str]:
    raw = schema.metadata or {}
    return {key.decode(errors="replace"): value.decode(errors="replace") for key, value in raw.items()}


@contextmanager
def _whole_parquet(path: Path) -> Iterator[None]:
    """Word for people what goes wrong while a Parquet file is read."""
    try:
        yield
    except (pa.ArrowException, OSError):
        raise RecordingError("daq.parquet_file_cut_short", path=path) from None


def _read_long(path: Path, file: pa.parquet.ParquetFile, digest: str) -> Table:
    """Read by row groups into a scratch file: no more than some thousand rows in memory."""
    schema, rows = file.schema_arrow, file.metadata.num_rows
    names_differ(path, schema.names)
    columns = ScratchColumns(Scratch())
    places = {}
    for number, name in enumerate(schema.names):
        whole = _is_numeric(path, name, schema.field(name).type) and not _nulls(file.metadata, number)
        places[name] = columns.reserve(name, rows, np.int64 if whole else np.float64)
    _room_for(rows)
    start = 0
    with _whole_parquet(path):
        for batch in file.iter_batches(_BATCH_ROWS, use_threads=False):
            for name, place in places.items():
                values = batch.column(name).cast(pa.float64() if place.dtype == np.float64 else pa.int64())
                columns.scratch.write(place, _numbers(values), start)
            start += len(batch)
    return Table(columns, _metadata(schema), digest)


def _room_for(rows: int) -> None:
    """Raise MemoryError where the checks' arrays find no room: before a small file has filled the disk."""
    try:
        np.empty((_COLUMNS_AT_ONCE, rows))  # nothing is written there, so no memory is taken
    except ValueError:  # more than an address can say: whoever wrote the file made its number of rows up
        raise MemoryError from None


def _nulls(metadata: pa.parquet.FileMetaData, column: int) -> bool:
    """Return whether a column may have rows without a value."""
    found = [metadata.row_group(group).column(column).statistics for group in range(metadata.num_row_groups)]
    return any(entry is None or not entry.has_null_count or entry.null_count for entry in found)


def _is_numeric(path: Path, name: str, kind: pa.DataType) -> bool:
    """Return True for whole numbers, False for others; refuse what holds no numbers."""
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind)):
        raise RecordingError("daq.holds_not_numbers", path=path, name=name, kind=kind)
    return bool(pa.types.is_integer(kind))


def _numeric(path: Path, name: str, column: pa.ChunkedArray) -> FloatArray | IntArray:
    whole = _is_numeric(path, name, column.type)
    if not pa.types.is_floating(column.type) and not (whole and column.null_count == 0):
        column = column.cast(pa.float64())
    values = np.empty(len(column), column.type.to_pandas_dtype())
    start = 0
    for chunk in column.chunks:
        values[start : start + len(chunk)] = _numbers(chunk)
        start += len(chunk)
    beyond = values.dtype == np.uint64 and values.size and values.max() > np.iinfo(np.int64).max
    if values.dtype.kind == "f" or beyond:
        return np.asarray(values, dtype=np.float64)
    return np.asarray(values, dtype=np.int64)


def numbers_of(column: pa.ChunkedArray) -> npt.NDArray[Any]:
    """Convert a column of an Arrow table to an array (N,): whole numbers, or floats with NaN for nulls."""
    return np.concatenate([_numbers(chunk) for chunk in column.chunks]) if len(column) else np.empty(0)


def _numbers(values: pa.Array) -> npt.NDArray[Any]:
    """Convert to whole numbers without nulls, or floats with NaN for nulls.

    For ``to_numpy`` pyarrow loads pandas where that is installed: 0.15 s of each process that reads or records.
    """
    valid, content = values.buffers()
    if not len(values):
        return np.empty(0)
    kind = np.dtype(values.type.to_pandas_dtype())
    numbers = np.frombuffer(content, kind, len(values), values.offset * kind.itemsize)
    if not values.null_count:
        return numbers
    bits = np.unpackbits(np.frombuffer(valid, np.uint8), count=values.offset + len(values), bitorder="little")
    return np.where(bits[values.offset :], numbers, np.nan)


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table by its suffix (``.parquet``, ``.csv``), whole or not at all.

    Raises
    ------
    RecordingError
        If the suffix is another one or the place cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RecordingError("daq.unknown_kind_file_use", path=path, suffix=suffix)
    try:
        with replacing(path) as temporary:
            if suffix == ".csv":
                pa.csv.write_csv(table, temporary)
            else:
                pa.parquet.write_table(table, temporary, compression="zstd")
    except OSError as error:
        raise RecordingError("daq.not_writable", trace=path, error=error.strerror or error) from None


def write_columns(path: Path, table: Table) -> None:
    """Write a table that was read, with its metadata (errors as :func:`write_table`)."""
    write_table(path, arrow_table(table.columns).replace_schema_metadata(dict(table.metadata)))


def arrow_table(columns: Mapping[str, npt.NDArray[Any]]) -> pa.Table:
    """Build an Arrow table of columns (N,), numbers as they are in memory.

    Of numpy's arrays pyarrow loads pandas where that is installed: 0.15 s of each process that writes a recording.
    """
    return pa.table({name: arrow_array(np.asarray(values)) for name, values in columns.items()})


def arrow_array(values: npt.NDArray[Any]) -> pa.Array:
    """Build an Arrow array of values (N,) of their own type, as :func:`arrow_table` does."""
    if values.dtype.kind not in "iuf":
        return pa.array(values)
    content = np.ascontiguousarray(values)
    return pa.Array.from_buffers(pa.from_numpy_dtype(content.dtype), len(content), [None, pa.py_buffer(content)])
