"""MDF4 (ASAM MDF 4.1): a measurement as a file with channels and one time base, what engineers of vehicles expect.

The file's start is the recording's: UTC of its time 0, from the moments of its SYNCs. A recording that does not know
them (another tool's) begins in 1970: the moment of the export says nothing about it.

asammdf is under the LGPL. It is imported here and in :mod:`daq.recordings.foreign_files` (which reads MDF) only, when
it is used, and is not part of this distribution: whoever wants the format installs the extra ``export``.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from daq.recordings.recording_files import Table

VERSION = "4.10"


def _started(table: Table) -> datetime:
    """Return UTC of the recording's time 0; 1970 if undeclared."""
    time, utc_ns = np.asarray(table.columns["time"], dtype=np.float64), table.columns.get("utc_ns")
    if utc_ns is None:
        return datetime.fromtimestamp(0, UTC)
    stamps = np.asarray(utc_ns, dtype=np.float64)
    known = np.flatnonzero((stamps > 0) & np.isfinite(time))  # cycles that never happened have none
    if not len(known):
        return datetime.fromtimestamp(0, UTC)
    first = int(known[0])
    return datetime.fromtimestamp(0, UTC) + timedelta(microseconds=float(stamps[first] / 1e3 - time[first] * 1e6))


def write(table: Table, units: dict[str, str], target: Path) -> None:
    """Write a recording's table as one group of channels over ``time``.

    Parameters
    ----------
    units : per channel, for the columns that have one
    """
    from asammdf import MDF, Signal

    time = np.asarray(table.columns["time"], dtype=np.float64)
    signals = [
        Signal(samples=np.asarray(values), timestamps=time, name=name, unit=units.get(name, ""))
        for name, values in table.columns.items()
        if name != "time"
    ]
    with MDF(version=VERSION) as file:
        file.start_time = _started(table)
        file.append(signals, comment=json.dumps(dict(table.metadata)), common_timebase=True)
        named = target.with_suffix(".mf4")  # it writes nowhere else
        try:
            file.save(named, overwrite=True, compression=2)
            named.replace(target)
        finally:
            if named != target:
                named.unlink(missing_ok=True)
