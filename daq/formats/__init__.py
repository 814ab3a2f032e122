"""Recordings in the forms that other tools read, by the file's suffix.

- :mod:`daq.formats.mdf4`: measurement data format 4 (ASAM), what engineers of vehicles expect; needs asammdf
- :mod:`daq.formats.mcap_file`: MCAP with JSON messages, what tools of robotics read; needs mcap
- :mod:`daq.formats.mat`: MATLAB's MAT files
- Parquet and CSV: :mod:`daq.recordings.recording_files`
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path

from daq.errors import InputError, RecordingError
from daq.recordings.recording_files import Table, write_columns
from daq.whole_files import replacing

_MODULES = {".mf4": "mdf4", ".mcap": "mcap_file", ".mat": "mat"}
#: Of the forms that :func:`export` writes.
SUFFIXES = (".parquet", ".csv", *_MODULES)


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
    if suffix not in _MODULES:
        write_columns(target, table)
        return
    if "time" not in table.columns:
        raise RecordingError("daq.recording_without_time", target=target, suffix=suffix)
    try:
        with replacing(target) as temporary:
            importlib.import_module(f"daq.formats.{_MODULES[suffix]}").write(table, dict(units), temporary)
    except ModuleNotFoundError as error:
        raise InputError("daq.export_needs", target=target, error=error.name) from None
    except OSError as error:
        raise RecordingError("daq.not_writable", trace=target, error=error.strerror or error) from None
