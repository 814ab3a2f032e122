"""Recordings: tables of time and one column per channel, in SI inside and in declared units on disk.

A recording that our recorder made also has the cycle counter, UTC, and per channel a quality and an age
(``<channel>.quality``, ``<channel>.age``); a foreign one needs only ``time`` and the channels.
:func:`read_recording` refuses what an identification would silently get wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from daq.arrays import BoolArray, FlagArray, FloatArray, IntArray
from daq.errors import RecordingError
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.quality import MEASURED
from daq.recordings import recording_checks as checks
from daq.recordings.column_map import ColumnMap
from daq.recordings.encoder_wraps import unwrapped, wrap_text
from daq.recordings.recorded_events import RecordedEvent, recorded_events
from daq.recordings.recording_files import Table, arrow_table, write_table
from daq.recordings.recording_source import channel_columns, load_table, recording_metadata, stored_notes
from daq.scratch import ScratchColumns

#: ``unloaded``: rods unpinned, F_l = 0. ``train``, ``repeat`` (the same motion again), ``validate`` (another
#: motion, nothing is ever selected on it), ``operation`` (whatever the machine did).
ROLES = ("unloaded", "train", "repeat", "validate", "operation")
#: s; what is shorter holds no motion. How much a motion tells is for the identification to say, not for a clock.
MINIMUM_SECONDS = 1.0

_Kind = TypeVar("_Kind", bound=np.generic)


@dataclass(frozen=True)
class Recording:
    """A recording that passed every check; ``N`` rows, SI units.

    Columns of a long one are read from a scratch file at each look (:mod:`daq.scratch`); :meth:`cut` gives rows of all.

    Attributes
    ----------
    machine : name of the machine it belongs to
    role : one of :data:`ROLES`
    file : path as given
    sha256 : of the file's bytes
    rate_hz : nominal rate, 1/s of machine time
    time : (N,) s of machine time, strictly increasing
    values : per channel (N,) in SI; NaN where the value was not measured in this row's cycle
    age : per channel (N,) s, age of the value at SYNC, if the file had it
    quality : per channel (N,) :class:`daq.quality.Quality`, if the file had it
    cycle : (N,) cycle counter, if the file had it
    utc_ns : (N,) ns since 1970 of SYNC, if the file had it
    notes : lines that say what was done to the file's values on the way here
    events : what happened to devices and buses meanwhile, where the recorder wrote it down
    bridged : (N,) True in rows of which a value was not measured and stands between measured ones; None: in none
    """

    machine: str
    role: str
    file: str
    sha256: str
    rate_hz: float
    time: FloatArray
    values: Mapping[str, FloatArray]
    age: Mapping[str, FloatArray] = field(default_factory=dict)
    quality: Mapping[str, FlagArray] = field(default_factory=dict)
    cycle: IntArray | None = None
    utc_ns: IntArray | None = None
    notes: tuple[str, ...] = ()
    events: tuple[RecordedEvent, ...] = ()
    bridged: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def duration(self) -> float:
        """Seconds of machine time from the first row to the end of the last one."""
        return float(self.time[-1] - self.time[0]) + 1.0 / self.rate_hz

    def cut(self, part: slice) -> Recording:
        """Cut some rows as a recording of their own, in memory."""
        return replace(
            self,
            time=self.time[part],
            values=_cut(self.values, part),
            age=_cut(self.age, part),
            quality=_cut(self.quality, part),
            cycle=None if self.cycle is None else self.cycle[part],
            utc_ns=None if self.utc_ns is None else self.utc_ns[part],
            bridged=None if self.bridged is None else self.bridged[part],
        )

    @property
    def joined(self) -> BoolArray:
        """For every step between rows (N-1,) whether it is one period of the clock and of the counter."""
        joined = checks.regular_steps(self.time, self.rate_hz)
        return joined if self.cycle is None else joined & (np.diff(self.cycle) == 1)

    def segments(self, channels: tuple[str, ...] | list[str] | None = None) -> tuple[slice, ...]:
        """Find maximal runs of rows without a missing value in ``channels`` (default: all) or a missing cycle.

        Filters and derivatives are to be taken inside one segment only.
        """
        present = np.ones(len(self.time), dtype=bool)
        for name in self.values if channels is None else channels:
            present &= np.isfinite(self.values[name])
        return checks.runs(present, self.joined)


def read_recording(
    path: str | Path,
    machine: Machine,
    role: str,
    *,
    minimum_seconds: float = MINIMUM_SECONDS,
    columns: ColumnMap | None = None,
    resample: bool = False,
) -> Recording:
    """Read a recording of ``machine`` and refuse it if it cannot be used in ``role``.

    Parameters
    ----------
    path : Parquet, CSV, MDF4, MAT or a ROS 2 bag, recognised by content
    machine : its channels have to be the file's columns, no fewer and no more
    role : one of :data:`ROLES`
    minimum_seconds : of rows in which every channel of a joint was measured
    columns : which column is which channel, where the file's names are ambiguous (:mod:`daq.recordings.column_map`)
    resample : whether a file of another rate is brought to the machine's (:mod:`daq.recordings.resampling`); ``notes``
        then report it

    Raises
    ------
    RecordingError
        One line: file, channel, place, what to do.
    """
    path = Path(path)
    _known_role(role)
    table, notes = load_table(path, machine, columns, resampled=resample, role=role)
    if table.rows == 0:
        raise RecordingError("daq.header_but_no_rows", path=path, minimum_seconds=minimum_seconds)
    time = np.asarray(table.columns["time"], dtype=np.float64)
    checks.time_runs(path, time, machine.rate_hz)
    values: MutableMapping[str, FloatArray] = _shelf(table)
    quality: MutableMapping[str, FlagArray] = _shelf(table)
    age: MutableMapping[str, FloatArray] = _shelf(table)
    for channel, raw, flags, to_si in channel_columns(path, table, machine, time):
        name = channel.name
        value = to_si.to_si(raw)
        if flags is not None:
            quality[name] = _frozen(flags, np.uint8)
            value = np.where(np.isin(flags, MEASURED), value, np.nan)
        if f"{name}.age" in table.columns:
            age[name] = _frozen(table.columns[f"{name}.age"], np.float64)
        value, wraps = unwrapped(machine, channel, value)
        if len(wraps):
            notes = (*notes, Sentence("daq.turns_put_back", path=wrap_text(path, name, wraps, time)))
        values[name] = _frozen(value, np.float64)
    utc_ns = _integers(path, "utc_ns", table)
    recording = Recording(
        machine=machine.name,
        role=role,
        file=str(path),
        sha256=table.sha256,
        rate_hz=machine.rate_hz,
        time=_frozen(time, np.float64),
        values=values,
        age=age,
        quality=quality,
        cycle=_integers(path, "cycle", table),
        utc_ns=utc_ns,
        notes=(*stored_notes(table), *notes),
        events=recorded_events(table.metadata, utc_ns),
    )
    if recording.cycle is not None:
        checks.counter_runs(path, recording.cycle, time)
    checks.long_enough(path, recording.values, machine, minimum_seconds)
    for channel in machine.channels:
        checks.not_saturated(path, channel, machine, recording.values[channel.name], time)
    checks.nothing_constant(path, machine, role, recording.values)
    checks.positions_agree(path, machine, role, recording.values)
    return recording


def write_recording(
    path: str | Path,
    machine: Machine,
    role: str,
    time: npt.ArrayLike,
    values_si: Mapping[str, npt.ArrayLike],
    *,
    cycle: npt.ArrayLike | None = None,
    utc_ns: npt.ArrayLike | None = None,
    age: Mapping[str, npt.ArrayLike] | None = None,
    quality: Mapping[str, npt.ArrayLike] | None = None,
) -> Path:
    """Write a recording by its suffix (``.parquet`` or ``.csv``), whole or not at all.

    Parameters
    ----------
    time : (N,) s
    values_si : per channel of ``machine`` (N,) in SI; stored in the channel's declared unit
    cycle, utc_ns : (N,) integers
    age, quality : per channel (N,) s and :class:`daq.quality.Quality`

    Raises
    ------
    RecordingError
        If a channel is absent or unknown, lengths differ, or the file cannot be written.
    """
    path = Path(path)
    _known_role(role)
    table = recording_table(
        machine, role, time, values_si, cycle=cycle, utc_ns=utc_ns, age=age, quality=quality, name=str(path)
    )
    write_table(path, table)
    return path


def recording_table(
    machine: Machine,
    role: str,
    time: npt.ArrayLike,
    values_si: Mapping[str, npt.ArrayLike],
    *,
    cycle: npt.ArrayLike | None = None,
    utc_ns: npt.ArrayLike | None = None,
    age: Mapping[str, npt.ArrayLike] | None = None,
    quality: Mapping[str, npt.ArrayLike] | None = None,
    name: str = "recording",
) -> pa.Table:
    """Build the Arrow table of :func:`write_recording`, with its metadata."""
    names = [channel.name for channel in machine.channels]
    for given in (values_si, age or {}, quality or {}):
        for key in given:
            if key not in names:
                raise RecordingError("daq.machine_no_such_channel", name=name, key=key, machine=machine.name)
    arrays: dict[str, npt.NDArray[np.generic]] = {"time": np.asarray(time, dtype=np.float64)}
    if cycle is not None:
        arrays["cycle"] = np.asarray(cycle, dtype=np.int64)
    if utc_ns is not None:
        arrays["utc_ns"] = np.asarray(utc_ns, dtype=np.int64)
    for channel in machine.channels:
        if channel.name not in values_si:
            raise RecordingError("daq.no_values_given_channel", name=name, channel=channel.name)
        arrays[channel.name] = machine.conversion(channel).from_si(values_si[channel.name])
    for key, flags in (quality or {}).items():
        arrays[f"{key}.quality"] = np.asarray(flags, dtype=np.uint8)
    for key, ages in (age or {}).items():
        arrays[f"{key}.age"] = np.asarray(ages, dtype=np.float64)
    for key, array in arrays.items():
        if array.shape != arrays["time"].shape:
            raise RecordingError("daq.shape_time", name=name, key=key, shape=array.shape, shape_2=arrays["time"].shape)
    return arrow_table(arrays).replace_schema_metadata(recording_metadata(machine, role))


def _shelf(table: Table) -> MutableMapping[str, npt.NDArray[Any]]:
    """Return the shelf of columns: the table's own if it has one."""
    return ScratchColumns(table.columns.scratch) if isinstance(table.columns, ScratchColumns) else {}


def _cut(columns: Mapping[str, npt.NDArray[_Kind]], part: slice) -> Mapping[str, npt.NDArray[_Kind]]:
    """Cut some rows of every column."""
    if isinstance(columns, ScratchColumns):
        return columns.cut(part)
    return {name: column[part] for name, column in columns.items()}


def _known_role(role: str) -> None:
    if role not in ROLES:
        raise RecordingError("daq.role_unknown", role=role, roles=", ".join(ROLES))


def _integers(path: Path, name: str, table: Table) -> IntArray | None:
    column = table.columns.get(name)
    if column is None:
        return None
    if not np.all(np.isfinite(column)):
        raise RecordingError("daq.rows_without_number", path=path, name=name)
    return _frozen(column, np.int64)


def _frozen(values: npt.ArrayLike, kind: type[_Kind]) -> npt.NDArray[_Kind]:
    copied = np.array(values, dtype=kind)
    copied.flags.writeable = False
    return copied
