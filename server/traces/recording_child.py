"""Work on a recording's file for looking at it, in a process of its own: the file may come from outside.

It is told what :mod:`server.recordings.formats.conversion_child` is, and what follows SHOWN. ``WHAT`` is ``signals``
(columns that can be read one by one, and the events, into TARGET, .npz), ``findings ROLE`` (what the checks find, JSON)
or ``cut START END`` (rows between two times, s since the first row, as a recording).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import numpy.typing as npt

from daq import load_machine, read_recording
from daq.arrays import IntArray
from daq.errors import RecordingError
from daq.machine.machine_file import Machine
from daq.messages import message_of
from daq.quality import MEASURED, Quality
from daq.recordings.recorded_events import recorded_events
from daq.recordings.recording_files import Table, read_table, write_columns
from server.recordings.formats import conversion_child
from server.recordings.formats.conversion_child import units_of
from server.recordings.inspect_recording import findings_on


def _write_signals(source: Path, target: Path, machine: Machine) -> None:
    """Write channels in single precision, whether each value was measured in its row, events; uncompressed."""
    table = read_table(source)
    time = np.asarray(table.columns["time"], dtype=np.float64)
    names = [channel.name for channel in machine.channels if channel.name in table.columns]
    units = units_of(table, machine)
    utc = _utc_ns(table)
    about = {
        "channels": names,
        "units": [units[name] for name in names],
        "first_utc": None if utc is None else float(utc[0]) / 1e9,
        "events": [
            asdict(event) | {"text_message": message_of(event.text)} for event in recorded_events(table.metadata, utc)
        ],
    }
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "time": time - time[0] if len(time) else time,
        "about": np.frombuffer(json.dumps(about).encode(), dtype=np.uint8),
    }
    for number, name in enumerate(names):
        values = np.asarray(table.columns[name], dtype=np.float32)
        flags = table.columns.get(f"{name}.quality")
        arrays[f"value{number}"] = values
        arrays[f"doubtful{number}"] = (
            np.isnan(values) if flags is None else ~np.isin(flags, (*MEASURED, Quality.HELD)) | np.isnan(values)
        )
    with target.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _utc_ns(table: Table) -> IntArray | None:
    column = table.columns.get("utc_ns")
    if column is None or not len(column) or column.dtype != np.int64:
        return None
    return np.asarray(column, dtype=np.int64)


def _write_cut(source: Path, target: Path, start: float, end: float) -> None:
    """Write rows from ``start`` to ``end`` with all columns and metadata; events are left as they are.

    Raises
    ------
    RecordingError
        If no row is in it.
    """
    table = read_table(source)
    time = np.asarray(table.columns["time"], dtype=np.float64)
    first, behind = np.searchsorted(time - time[0], [start, end]) if len(time) else (0, 0)
    if behind - first < 2:
        raise RecordingError("server.no_rows", source=source, start=start, end=end)
    part = slice(int(first), int(behind))
    write_columns(target, Table({n: c[part] for n, c in table.columns.items()}, table.metadata, ""))


def _do(what: str, source: Path, target: Path, machine_file: Path, shown: str, *rest: str) -> None:
    """Do one piece of work; InputError if the file is no good."""
    if what == "cut":
        _write_cut(source, target, *map(float, rest))
    elif what == "signals":
        _write_signals(source, target, load_machine(machine_file))
    else:
        machine = load_machine(machine_file)
        found = findings_on(machine, read_recording(source, machine, rest[0]), machine_file)
        target.write_text(json.dumps(found), encoding="utf-8")


def main(arguments: Sequence[str]) -> int:
    """Run the process; return the exit code."""
    return conversion_child.main(arguments, _do)
