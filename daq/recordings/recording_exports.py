"""Recordings in the forms that other tools read, by the file's suffix.

- ``.mf4``: MDF4 (ASAM MDF 4.1), what engineers of vehicles expect; needs asammdf
- ``.mcap``: MCAP (mcap.dev) with JSON messages, what tools of robotics read; needs mcap
- ``.mat``: MATLAB's MAT files
- Parquet and CSV: :mod:`daq.recordings.recording_files`

asammdf is under the LGPL. It is imported here and in :mod:`daq.recordings.foreign_files` (which reads MDF) only, when
it is used, and is not part of this distribution: whoever wants the format installs the extra ``export``.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from daq.errors import InputError, RecordingError
from daq.recordings.recording_files import Table, write_columns
from daq.whole_files import replacing

MDF_VERSION = "4.10"
MCAP_TOPIC = "/hilfit/frame"
LONGEST = 63  # characters of a variable's name in MATLAB


def export(table: Table, target: Path, units: Mapping[str, str]) -> None:
    """Write a recording's table in the format of the target's suffix, whole or not at all.

    Parameters
    ----------
    units : per column, for those that have one

    Raises
    ------
    RecordingError
        If the suffix is another one, the table has no ``time``, or the place cannot be written.
    InputError
        If the form needs a package that is not installed.
    """
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise RecordingError("daq.unknown_kind_of_file", target=target, suffix=suffix, suffixes=SUFFIXES)
    if suffix not in WRITERS:
        write_columns(target, table)
        return
    if "time" not in table.columns:
        raise RecordingError("daq.recording_without_time", target=target, suffix=suffix)
    try:
        with replacing(target) as temporary:
            WRITERS[suffix](table, units, temporary)
    except ModuleNotFoundError as error:
        raise InputError("daq.export_needs", target=target, error=error.name) from None
    except OSError as error:
        raise RecordingError("daq.not_writable", trace=target, error=error.strerror or error) from None


def _mdf4(table: Table, units: Mapping[str, str], target: Path) -> None:
    """Write one group of channels over ``time``; the file's start is the recording's."""
    from asammdf import MDF, Signal

    time = np.asarray(table.columns["time"], dtype=np.float64)
    signals = [
        Signal(samples=np.asarray(values), timestamps=time, name=name, unit=units.get(name, ""))
        for name, values in table.columns.items()
        if name != "time"
    ]
    with MDF(version=MDF_VERSION) as file:
        file.start_time = _started(table)
        file.append(signals, comment=json.dumps(dict(table.metadata)), common_timebase=True)
        named = target.with_suffix(".mf4")  # it writes nowhere else
        try:
            file.save(named, overwrite=True, compression=2)
            named.replace(target)
        finally:
            if named != target:
                named.unlink(missing_ok=True)


def _started(table: Table) -> datetime:
    """Return UTC of the recording's time 0, from the moments of its SYNCs.

    A recording that does not know them (another tool's) begins in 1970: the moment of the export says nothing about it.
    """
    time, utc_ns = np.asarray(table.columns["time"], dtype=np.float64), table.columns.get("utc_ns")
    if utc_ns is None:
        return datetime.fromtimestamp(0, UTC)
    stamps = np.asarray(utc_ns, dtype=np.float64)
    known = np.flatnonzero((stamps > 0) & np.isfinite(time))  # cycles that never happened have none
    if not len(known):
        return datetime.fromtimestamp(0, UTC)
    first = int(known[0])
    return datetime.fromtimestamp(0, UTC) + timedelta(microseconds=float(stamps[first] / 1e3 - time[first] * 1e6))


def _mcap(table: Table, units: Mapping[str, str], target: Path) -> None:
    """Write one JSON message per row; its log time is UTC of its SYNC where known, else the recording's time.

    Units are kept as the file's metadata and in the schema.
    """
    from mcap.writer import Writer

    names = list(table.columns)
    properties: dict[str, Any] = {
        name: {"type": ["number", "null"], **({"description": units[name]} if name in units else {})} for name in names
    }
    schema = {"type": "object", "title": "hilfit.Frame", "properties": properties}
    stamps = np.asarray(table.columns.get("utc_ns", np.round(np.asarray(table.columns["time"]) * 1e9)), dtype=np.int64)
    lists = [np.asarray(table.columns[name]).tolist() for name in names]
    with target.open("wb") as file:
        writer: Any = Writer(file)  # its methods are not annotated
        writer.start(profile="", library="hilfit")
        schema_id = writer.register_schema(name="hilfit.Frame", encoding="jsonschema", data=json.dumps(schema).encode())
        channel_id = writer.register_channel(topic=MCAP_TOPIC, message_encoding="json", schema_id=schema_id)
        writer.add_metadata("hilfit", {**dict(table.metadata), "units": json.dumps(dict(units))})
        for number, (stamp, row) in enumerate(zip(stamps.tolist(), zip(*lists, strict=True), strict=True)):
            content = {
                name: None if isinstance(value, float) and not math.isfinite(value) else value
                for name, value in zip(names, row, strict=True)
            }
            writer.add_message(channel_id, stamp, orjson.dumps(content), max(stamp, 0), number)
        writer.finish()


def _mat(table: Table, units: Mapping[str, str], target: Path) -> None:
    """Write a MAT file (version 5, by scipy): a variable per column, and what they are.

    A channel's name is no variable's name: ``boom.head_pressure`` becomes ``boom_head_pressure``. The names as they are
    stand in ``hilfit_columns``, in the order of ``hilfit_variables``, with ``hilfit_units``; the rest of what the file
    says about itself in ``hilfit_metadata``, as JSON.
    """
    from scipy.io import savemat

    names = variables(table.columns)
    content = {names[column]: np.asarray(values)[:, None] for column, values in table.columns.items()}
    cells = {
        "hilfit_columns": list(names),
        "hilfit_variables": list(names.values()),
        "hilfit_units": [units.get(column, "") for column in names],
    }
    for name, texts in cells.items():
        content[name] = np.array(texts, dtype=object)[:, None]
    content["hilfit_metadata"] = np.array(json.dumps(dict(table.metadata)))
    savemat(str(target), content, appendmat=False, long_field_names=True, do_compression=True)


def variables(columns: Iterable[str]) -> dict[str, str]:
    """Make names of MATLAB's variables for names of columns, all different."""
    made: dict[str, str] = {}
    for column in columns:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", column)
        plain = (plain if re.match(r"[A-Za-z]", plain) else f"x{plain}")[:LONGEST]
        name, number = plain, 2
        while name in made.values():
            end = f"_{number}"
            name, number = plain[: LONGEST - len(end)] + end, number + 1
        made[column] = name
    return made


#: Per suffix what writes a table in the form, with the units of those columns that have one, into a file.
WRITERS: dict[str, Callable[[Table, Mapping[str, str], Path], None]] = {".mf4": _mdf4, ".mcap": _mcap, ".mat": _mat}
#: Of the forms that :func:`export` writes.
SUFFIXES = (".parquet", ".csv", *WRITERS)
