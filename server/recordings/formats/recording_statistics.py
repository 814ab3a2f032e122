"""What a recording holds, channel by channel."""

from __future__ import annotations

from typing import Any

import numpy as np

from daq import Quality
from daq.machine.machine_file import Machine
from daq.recordings.recording_files import Table


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
