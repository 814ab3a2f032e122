"""One piece of work on one file, in a process of its own (:mod:`server.platform.processes.file_children`).

It is told ``WHAT SOURCE TARGET MACHINE_FILE SHOWN``. ``WHAT`` is ``parquet``, ``csv``, ``mdf4`` or ``mcap`` (write
SOURCE as that), ``import`` or ``import-resampled`` (write SOURCE, a file of another tool, as a recording in Parquet; a
map of its columns stands beside it if there is one) or ``statistics`` (JSON into TARGET). Speaks the protocol of
:mod:`server.platform.processes.children`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daq import Quality, load_machine
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.recordings.column_map import load_map
from daq.recordings.recording_exports import WRITERS
from daq.recordings.recording_files import Table, read_table, write_columns
from daq.recordings.recording_source import import_file
from server.platform.processes.child_limits import RECORDING_CPU_S, limit_child
from server.platform.processes.child_speech import ended, send
from server.recordings.formats import IMPORTS, map_beside
from server.recordings.formats.declared_size import refuse_bombs


def statistics(table: Table, machine: Machine) -> dict[str, Any]:
    """Compute rows, time, and per channel range, mean, deviation, and frames of each quality.

    In the units of the file. A channel that the file does not have is left out; all values null where none is finite.
    """
    time = np.asarray(table.columns["time"], dtype=np.float64)
    steps = np.diff(time)
    channels = {}
    for channel in machine.channels:
        if channel.name not in table.columns:
            continue
        values = np.asarray(table.columns[channel.name], dtype=np.float64)
        flags = table.columns.get(f"{channel.name}.quality")
        finite = values[np.isfinite(values)]
        some = len(finite) > 0
        channels[channel.name] = {
            "minimum": float(finite.min()) if some else None,
            "maximum": float(finite.max()) if some else None,
            "mean": float(finite.mean()) if some else None,
            "std": float(finite.std()) if some else None,
            "missing": len(values) - len(finite),
            "quality": {}
            if flags is None
            else {q.name.lower(): int(np.sum(flags == q)) for q in Quality if np.any(flags == q)},
        }
    return {
        "rows": len(time),
        "seconds": float(time[-1] - time[0]) if len(time) else 0.0,
        "rate_hz": machine.rate_hz,
        "gaps": int(np.sum(steps > 1.5 / machine.rate_hz)),
        "channels": channels,
    }


#: Library and extra that a form needs.
NEEDS = {"asammdf": "export", "mcap": "export"}


def do(what: str, source: Path, target: Path, machine_file: Path, shown: str) -> None:
    """Do one piece of work.

    Raises
    ------
    InputError
        One line: what is wrong with the file.
    """
    machine = load_machine(machine_file)
    refuse_bombs(source, shown)
    if what in IMPORTS:
        written = map_beside(source)
        columns = load_map(written, machine, "the map of columns") if written.is_file() else None
        import_file(source, machine, target, columns, resampled=what == IMPORTS[1], shown=shown)
        return
    table = read_table(source)
    if what == "statistics":
        target.write_text(json.dumps(statistics(table, machine)), encoding="utf-8")
    elif what in ("parquet", "csv"):
        write_columns(target, table)
    else:
        WRITERS[target.suffix](table, units_of(table, machine), target)


def units_of(table: Table, machine: Machine) -> dict[str, str]:
    """Return units of the columns: the file's own, else what the machine file declares."""
    return {**{c.name: c.unit for c in machine.channels}, **table.units}


def main(arguments: Sequence[str], do: Callable[..., None] = do) -> int:
    """Run the process, which is limited to what such a file may take; return the exit code.

    Parameters
    ----------
    do : the work
    """
    what, source, target, machine_file, shown, *rest = arguments
    limit_child(RECORDING_CPU_S, Path(source).stat().st_size)
    too_much = Sentence("server.needs_memory", shown=shown)
    try:
        return ended(lambda: do(what, Path(source), Path(target), Path(machine_file), shown, *rest), too_much)
    except ModuleNotFoundError as error:
        extra = NEEDS.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        send(error=Sentence("server.needs_extra", error=error.name, extra=extra))
        return 1
