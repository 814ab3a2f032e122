"""Work on a recording's file for looking at it, in a process of its own: the file may come from outside.

``python -m server.traces.recording_child WHAT SOURCE TARGET MACHINE_FILE ROLE [START END]``

``WHAT`` is ``signals`` (columns that can be read one by one, and the events, into TARGET, .npz), ``findings`` (what the
checks find, JSON) or ``cut`` (rows from START to END, s since the first row, as a recording). Speaks the protocol of
:mod:`server.platform.processes.children`.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import numpy.typing as npt

from daq import load_machine, read_recording
from daq.errors import RecordingError
from daq.machine.machine_file import Machine
from daq.quality import MEASURED, Quality
from daq.recordings.recorded_events import recorded_events
from daq.recordings.recording_files import Table, read_table, write_columns
from server.platform.processes.child_limits import RECORDING_CPU_S, limit_child
from server.platform.processes.child_speech import ended
from server.recordings.formats.conversion_child import units_of
from server.recordings.inspect_recording import findings_on


def write_signals(source: Path, target: Path, machine: Machine) -> None:
    """Channels as single precision, whether each value was measured in its row, events; uncompressed."""
    table = read_table(source)
    time = np.asarray(table.columns["time"], dtype=np.float64)
    names = [channel.name for channel in machine.channels if channel.name in table.columns]
    units = units_of(table, machine)
    utc = _utc_ns(table)
    about = {
        "channels": names,
        "units": [units[name] for name in names],
        "first_utc": None if utc is None else float(utc[0]) / 1e9,
        "events": [asdict(event) for event in recorded_events(table.metadata, utc)],
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


def _utc_ns(table: Table) -> npt.NDArray[np.int64] | None:
    column = table.columns.get("utc_ns")
    if column is None or not len(column) or column.dtype != np.int64:
        return None
    return np.asarray(column, dtype=np.int64)


def write_cut(source: Path, target: Path, start: float, end: float) -> None:
    """Rows from ``start`` to ``end`` with all columns and the metadata; events stay what they are.

    Raises
    ------
    RecordingError
        If no row is in it.
    """
    table = read_table(source)
    time = np.asarray(table.columns["time"], dtype=np.float64)
    first, behind = np.searchsorted(time - time[0], [start, end]) if len(time) else (0, 0)
    if behind - first < 2:
        raise RecordingError(f"{source}: has no rows from {start:g} s to {end:g} s; choose a part that it has")
    part = slice(int(first), int(behind))
    write_columns(target, Table({n: c[part] for n, c in table.columns.items()}, table.metadata, ""))


def do(what: str, source: Path, target: Path, machine_file: Path, rest: list[str]) -> None:
    """One piece of work; InputError if the file is no good."""
    if what == "cut":
        write_cut(source, target, *map(float, rest[1:]))
        return
    machine = load_machine(machine_file)
    if what == "signals":
        write_signals(source, target, machine)
    else:
        found = findings_on(machine, read_recording(source, machine, rest[0]), machine_file)
        target.write_text(json.dumps(found), encoding="utf-8")


def main(arguments: list[str]) -> int:
    """Entry of the process."""
    what, source, target, machine_file, *rest = arguments
    limit_child(RECORDING_CPU_S, Path(source).stat().st_size)
    too_much = f"{source}: needs too much memory; use a shorter recording"
    return ended(lambda: do(what, Path(source), Path(target), Path(machine_file), rest), too_much)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
