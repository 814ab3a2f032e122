"""MDF4 (ASAM MDF 4.1): a measurement as a file with channels and one time base, what engineers of vehicles expect.

asammdf is under the LGPL. It is imported here and nowhere else, when it is used, and is not part of this distribution:
whoever wants the format installs the extra ``export``.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import RecordingError
from daq.recording_files import Table

VERSION = "4.10"


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
        file.append(signals, comment=json.dumps(dict(table.metadata)), common_timebase=True)
        file.save(target, overwrite=True, compression=2)


def read(path: Path, wanted: Collection[str], shown: str) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns of an MDF file and their units.

    Parameters
    ----------
    wanted : names of the channels that are looked for; others are left where they are
    shown : the file's name for people

    Raises
    ------
    RecordingError
        If it is no MDF file, or its channels stand on different times: nothing is interpolated.
    """
    from asammdf import MDF

    try:
        with MDF(path) as file:
            names = [name for name in file.channels_db if name in wanted]
            signals = {name: file.get(name, ignore_invalidation_bits=True) for name in names}
    except MemoryError:
        raise
    except Exception:  # a library that reads any bytes as offsets raises anything
        raise RecordingError(f"{shown}: is no MDF file that can be read, or is damaged; export it again") from None
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    time: Any = None
    for name, signal in signals.items():
        samples = np.asarray(signal.samples)
        if samples.ndim != 1 or not np.issubdtype(samples.dtype, np.number):
            raise RecordingError(f"{shown}: {name}: is no channel of numbers; export the measured values")
        stamps = np.asarray(signal.timestamps, dtype=np.float64)
        if time is None:
            time = stamps
        elif len(stamps) != len(time) or not np.array_equal(stamps, time):
            raise RecordingError(
                f"{shown}: {name}: stands on other times than {next(iter(signals))}; export all channels on one raster"
            )
        columns[name] = samples
        if signal.unit:
            units[name] = str(signal.unit)
    if time is None:
        raise RecordingError(f"{shown}: has no channel of this machine; name the channels as the machine file does")
    return {"time": time, **columns}, units
