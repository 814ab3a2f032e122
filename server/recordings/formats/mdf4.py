"""MDF4 (ASAM MDF 4.1): a measurement as a file with channels and one time base, what engineers of vehicles expect.

asammdf is under the LGPL. It is imported here and in :mod:`daq.foreign_files` (which reads MDF) only, when it is used,
and is not part of this distribution: whoever wants the format installs the extra ``export``.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

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
