"""Recordings that begin before the pumps run: no chamber has pressure there, and each has afterwards.

Nothing leaves such rows out: valves may hold the arm meanwhile, which no pressure then tells of.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, finding_of

#: A cylinder has no pressure where both chambers together have less than this share of what they have later (all but a
#: twentieth of the time), which has to be so much at least, Pa; and that for so many seconds, up to this share of the
#: recording.
_NOTHING, _LATER_PA, _LEAST_S, _MOST = 0.1, 2e5, 0.2, 0.3


def beginning_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """A finding for each recording, in SI, that begins before the pumps run."""
    found = []
    for recording in recordings:
        rows = _rows_without_pressure(machine, recording)
        if rows < max(_LEAST_S * recording.rate_hz, 1):
            continue
        until = recording.time[rows] - recording.time[0]
        found.append(finding_of("no_pressure", recording=recording.file, before=float(until), unit="s", strength=3.0))
    return found


def _rows_without_pressure(machine: Machine, recording: Recording) -> int:
    """How many rows at the beginning have no pressure in any cylinder; 0 where that is not the beginning alone."""
    rows = len(recording)
    cylinders = 0
    for joint in machine.joints:
        channels = [machine.channel(quantity, joint.name) for quantity in ("head_pressure", "rod_pressure")]
        values = [recording.values[c.name] for c in channels if c is not None and c.name in recording.values]
        if not values:
            continue
        cylinders += 1
        rows = min(rows, _without_pressure(np.sum(values, axis=0)))
    return rows if cylinders and rows < _MOST * len(recording) else 0


def _without_pressure(total: FloatArray) -> int:
    """Rows before a cylinder's pressures, both chambers together, are what they are later."""
    later = total[round(_MOST * len(total)) :]
    later = later[np.isfinite(later)]
    usual = float(np.percentile(later, 5)) if len(later) else 0.0
    if usual < _LATER_PA:
        return 0
    there = np.flatnonzero(~(total < _NOTHING * usual))  # a missing value is no pressure that is nothing
    return int(there[0]) if len(there) else len(total)
