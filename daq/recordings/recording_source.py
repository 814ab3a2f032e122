"""From a file of any tool to one table in a machine's channels, at the machine's rate if that is asked for.

``read_table`` or ``read_rasters`` (what the file holds), ``in_channels`` (which column is what), then
:func:`load_table` puts rasters together: as they are where there is one at the machine's rate, else resampled, never
silently.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, MutableMapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from daq.arrays import FlagArray, FloatArray, IntArray
from daq.errors import RecordingError
from daq.machine.machine_file import Channel, Machine
from daq.messages import Sentence, listed
from daq.quality import MEASURED, Quality
from daq.recordings import recording_checks as checks
from daq.recordings.column_map import ColumnMap, in_channels, mapped_columns_are_there, wanted_columns
from daq.recordings.foreign_files import is_foreign, read_rasters
from daq.recordings.recording_files import UNITS, Table, arrow_table, read_table, write_table
from daq.recordings.resampling import PASSBAND, Resampled, grid, resample
from daq.units import Conversion, conversion

SCHEMA = "hilfit/recording/1"


def load_table(
    path: Path,
    machine: Machine,
    columns: ColumnMap | None = None,
    *,
    resampled: bool = False,
    role: str | None = None,
) -> tuple[Table, tuple[str, ...]]:
    """Load a file's table in the machine's channels, and lines on what was done to it.

    Channels of no joint that the file does not have are there, marked missing in every row.

    Parameters
    ----------
    path : CSV, Parquet, MDF4, MAT or a ROS 2 bag, recognised by content
    columns : which column is which channel, where names are ambiguous
    resampled : whether another rate than the machine's may be brought to it (:mod:`daq.recordings.resampling`)
    role : what the recording is to be used as; None where that is not decided

    Raises
    ------
    RecordingError
        One line: file, column, what to do.
    """
    table, notes = _loaded(path, machine, columns, resampled=resampled, role=role)
    absent = [channel.name for channel in machine.channels if channel.name not in table.columns]
    if not absent or table.rows == 0:
        return table, notes
    filled = table.columns if isinstance(table.columns, MutableMapping) else dict(table.columns)
    for name in absent:
        filled[name] = np.full(table.rows, np.nan)
        filled[f"{name}.quality"] = np.full(table.rows, int(Quality.MISSING), dtype=np.int64)
    note = Sentence("daq.no_channels_marked", path=path.name, absent=absent)
    return Table(filled, table.metadata, table.sha256), (*notes, note)


def _loaded(
    path: Path, machine: Machine, columns: ColumnMap | None, *, resampled: bool, role: str | None
) -> tuple[Table, tuple[str, ...]]:
    """Load as :func:`load_table`, with the channels that the file has."""
    if not is_foreign(path):
        found = read_table(path)
        as_role = role or found.metadata.get("hilfit.role", "operation")
        checks.metadata_fits(path, found.metadata, machine, as_role)
        table = in_channels(path, found, machine, columns)
        checks.columns_fit(path, table, machine, list(found.columns))
        tables = [table]
    else:
        tables = _of_rasters(path, machine, columns)
    if any(table.rows == 0 for table in tables):
        return tables[0], ()
    if len(tables) == 1 and not (resampled and _is_other(tables[0], machine.rate_hz)):
        return tables[0], ()
    if not resampled:
        first, second = (next(name for name in table.columns if name != "time") for table in tables[:2])
        raise RecordingError("daq.stands_other_times", path=path, second=second, first=first)
    return _resampled(path, machine, tables)


def _of_rasters(path: Path, machine: Machine, columns: ColumnMap | None) -> list[Table]:
    """Choose tables with a channel of the machine in a file of several time bases; each channel once."""
    names = {channel.name for channel in machine.channels}
    rasters = _merged(read_rasters(path, wanted_columns(machine, columns)))
    mapped_columns_are_there(path, columns, [name for raster in rasters for name in raster.columns])
    tables = [in_channels(path, raster, machine, columns, all_known=False) for raster in rasters]
    tables = [table for table in tables if names & set(table.columns)]
    if not tables:
        raise RecordingError("daq.no_channel", path=path, machine=machine.name)
    together: dict[str, object] = {}
    for table in tables:
        for name in table.columns:
            if name in together and name != "time":
                raise RecordingError("daq.two_time_bases", path=path, name=name)
            together[name] = None
    checks.columns_fit(path, Table(dict.fromkeys(together, np.zeros(0)), {}, ""), machine)
    return tables


def _merged(rasters: Sequence[Table]) -> list[Table]:
    """Merge tables of one clock."""
    result: list[Table] = []
    for raster in rasters:
        time = raster.columns.get("time")
        same = [n for n, t in enumerate(result) if time is not None and np.array_equal(t.columns.get("time", ()), time)]
        if not same:
            result.append(raster)
            continue
        first = result[same[0]]
        columns, units = {**raster.columns, **first.columns}, json.dumps(first.units | raster.units)
        result[same[0]] = Table(columns, {**first.metadata, UNITS: units}, first.sha256)
    return result


def _is_other(table: Table, rate_hz: float) -> bool:
    """Return whether a table is of another rate, or of a too uneven clock."""
    time = np.asarray(table.columns["time"], dtype=np.float64)
    return len(time) > 2 and bool(np.all(np.diff(time) > 0)) and not checks.runs_at(time, rate_hz)


def _resampled(path: Path, machine: Machine, tables: Sequence[Table]) -> tuple[Table, tuple[str, ...]]:
    times = []
    for table in tables:
        time = np.asarray(table.columns["time"], dtype=np.float64)
        checks.time_increases(path, time)
        if len(time) < 3:
            raise RecordingError("daq.time_rows_too_few", path=path, count=len(time))
        times.append(time)
    at = grid(times, machine.rate_hz)
    if len(at) < 2:
        raise RecordingError("daq.channels_not_recorded_same", path=path)
    done = [
        resample(time, _measured(path, table, machine, time), machine.rate_hz, at)
        for time, table in zip(times, tables, strict=True)
    ]
    values = {name: column for part in done for name, column in part.values.items()}
    known = np.flatnonzero(np.any([np.isfinite(column) for column in values.values()], axis=0))
    kept = slice(int(known[0]), int(known[-1]) + 1) if len(known) else slice(0, 0)
    result: dict[str, FloatArray | IntArray] = {"time": at[kept]}
    for channel in machine.channels:
        if channel.name not in values:
            continue  # of no joint, and in no table
        column = values[channel.name][kept]
        result[channel.name] = column
        if not np.all(np.isfinite(column)):
            result[f"{channel.name}.quality"] = np.where(
                np.isfinite(column), int(Quality.FRESH), int(Quality.MISSING)
            ).astype(np.int64)
    units = {name: unit for table in tables for name, unit in table.units.items()}
    metadata = {**tables[0].metadata, UNITS: json.dumps(units)}
    return Table(result, metadata, tables[0].sha256), (_note(path, machine, done),)


def channel_columns(
    path: Path, table: Table, machine: Machine, time: FloatArray
) -> Iterator[tuple[Channel, FloatArray, FlagArray | None, Conversion]]:
    """Iterate over a table's channels: values (N,) as on disk, qualities (N,) where there are any, and unit.

    The unit is the one that the file carries, else the one that the machine file declares.

    Raises
    ------
    RecordingError
        If one holds what cannot be, or has a unit of something else.
    """
    try:
        units = table.units
    except ValueError:
        raise RecordingError("daq.metadata_hilfit_units_damaged", path=path) from None
    for channel in machine.channels:
        name = channel.name
        if name not in table.columns:
            continue
        try:
            to_si = conversion(units.get(name, channel.unit), machine.si_unit(channel))
        except ValueError as error:
            raise RecordingError("daq.correct_file_metadata_hilfit", path=path, name=name, error=error) from None
        values = np.asarray(table.columns[name], dtype=np.float64)
        found, flags = table.columns.get(f"{name}.quality"), None
        if found is not None:
            if not np.all(np.isfinite(found)) or np.any((found < 0) | (found > 255)) or np.any(found % 1 != 0):
                raise RecordingError("daq.quality_holds_something_no", path=path, name=name)
            flags = np.asarray(found).astype(np.uint8)
        checks.values_are_numbers(path, name, values, time, flags)
        yield channel, values, flags, to_si


def _measured(path: Path, table: Table, machine: Machine, time: FloatArray) -> dict[str, FloatArray]:
    """Return a table's channels as measured, NaN where not; what a low pass would hide is checked first."""
    found = {}
    for channel, raw, flags, to_si in channel_columns(path, table, machine, time):
        values = raw if flags is None else np.where(np.isin(flags, MEASURED), raw, np.nan)
        checks.not_saturated(path, channel, machine, to_si.to_si(values), time)
        found[channel.name] = values
    return found


def _note(path: Path, machine: Machine, done: Sequence[Resampled]) -> str:
    rates = list(dict.fromkeys(f"{part.rate_hz:.5g}" for part in done))
    uneven = Sentence("daq.with_uneven_steps") if any(part.uneven for part in done) else ""
    slowest = min(part.rate_hz for part in done)
    kept = PASSBAND * 0.5 * min(slowest, machine.rate_hz)
    filtered = any(not checks.same_rate(part.rate_hz, machine.rate_hz) for part in done)
    low_pass = Sentence("daq.with_low_pass", kept=kept) if filtered else ""
    values = {"path": path.name, "rates": rates, "uneven": uneven, "rate_hz": machine.rate_hz, "low_pass": low_pass}
    remarks = [Sentence("daq.resampled_hz_hz", **values)]
    if slowest < machine.rate_hz and not checks.same_rate(slowest, machine.rate_hz):
        remarks.append(Sentence("daq.file_slower_machine_nothing", slowest=0.5 * slowest))
    lost = max(part.gap_seconds for part in done)
    if lost > 0:
        remarks.append(Sentence("daq.beside_gaps_ends_left", lost=lost))
    return listed(remarks)


def import_file(
    path: Path,
    machine: Machine,
    output: Path,
    columns: ColumnMap | None = None,
    *,
    resampled: bool = False,
    role: str | None = None,
    shown: str | None = None,
) -> tuple[int, tuple[str, ...]]:
    """Write a file of any tool as a recording in the machine's channels and units; rows, and what was done to it.

    Parameters
    ----------
    output : .parquet or .csv
    role : what it is for, kept in the recording; None leaves that to whoever uses it
    shown : the file's name for people, in what was done to it; its own if None

    Raises
    ------
    RecordingError
        One line: file, column, what to do. Nothing is written then.
    """
    table, notes = load_table(path, machine, columns, resampled=resampled)
    notes = (*stored_notes(table), *(note.replace(path.name, shown or path.name) for note in notes))
    if table.rows == 0:
        raise RecordingError("daq.header_but_no_rows_export", path=path)
    time = np.asarray(table.columns["time"], dtype=np.float64)
    checks.time_runs(path, time, machine.rate_hz)
    arrays: dict[str, npt.NDArray[np.generic]] = {"time": time}
    for channel, values, _, to_si in channel_columns(path, table, machine, time):
        arrays[channel.name] = machine.conversion(channel).from_si(to_si.to_si(values))
    for name in table.columns:
        if name not in arrays:
            kind = np.int64 if name in ("cycle", "utc_ns") else np.uint8 if name.endswith(".quality") else np.float64
            arrays[name] = np.asarray(table.columns[name]).astype(kind)
    metadata = recording_metadata(machine, role) | ({"hilfit.notes": json.dumps(notes)} if notes else {})
    write_table(output, arrow_table(arrays).replace_schema_metadata(metadata))
    return len(time), notes


def recording_metadata(machine: Machine, role: str | None) -> dict[str, str]:
    """Build the metadata of a recording's Arrow schema; ``role`` None: whoever uses it decides."""
    return {
        "hilfit.schema": SCHEMA,
        "hilfit.machine": machine.name,
        **({} if role is None else {"hilfit.role": role}),
        "hilfit.rate_hz": repr(machine.rate_hz),
        UNITS: json.dumps({channel.name: channel.unit for channel in machine.channels}),
    }


def stored_notes(table: Table) -> tuple[str, ...]:
    """Read an earlier import's lines on what it did in the file; others' texts are cut to a report's size."""
    try:
        notes = json.loads(table.metadata.get("hilfit.notes", "[]"))
    except ValueError:
        return ()
    texts = [note for note in notes if isinstance(note, str)] if isinstance(notes, list) else []
    return tuple(" ".join(note.split())[:400] for note in texts[:8])
