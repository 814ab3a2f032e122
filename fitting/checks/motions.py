"""Recordings against one another: `repeat` that does not repeat, `validate` that is `train`, joints that are parked.

And recordings that begin before the pumps run. Nothing leaves such rows out: valves may hold the arm meanwhile, which
no pressure shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from daq.machine.machine_file import Joint, Machine
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, finding_of
from fitting.checks.mistakes.samples import POSITIONS, PRESSURES
from fitting.checks.signal_faults import track
from fitting.signals.filters import lag_between
from fitting.signals.preparation import STILL

_MOST_LAG_S = 4.0
#: Rows that are compared.
_ROWS = 600
#: Two motions are the same below the first share of their spread (the identification pairs repeats below 2 %), and
#: another from the second on.
_SAME, _OTHER = 0.02, 0.2
#: Efforts of the same motion on the same day differ by less than this share: otherwise something else was changed.
_SAME_EFFORT = 0.15


def motion_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Check pairs of recordings, and joints that do not move."""
    found: list[Finding] = []
    for number, recording in enumerate(recordings):
        for earlier in recordings[:number]:
            if earlier.sha256 == recording.sha256 and recording.sha256:
                details: dict[str, Any] = {"earlier": earlier.file, "first_role": earlier.role, "role": recording.role}
                found.append(finding_of("same_recording", recording=recording.file, strength=9.0, **details))
    trains = [r for r in recordings if r.role == "train"]
    for recording in recordings:
        others = [(_apart(machine, t, recording), t) for t in trains if t.sha256 != recording.sha256 or not t.sha256]
        if recording.role not in ("repeat", "validate") or not others:
            continue
        (motion, effort), nearest = min(others, key=lambda item: item[0][0])
        if recording.role == "repeat" and motion > _OTHER:
            found.append(finding_of("no_repeat", recording=recording.file, before=motion, strength=6.0))
        if recording.role == "validate" and motion < _SAME and effort < _SAME_EFFORT:
            details = {"nearest": nearest.file, "effort": effort, "recording": recording.file}
            found.append(finding_of("same_motion", before=motion, strength=6.0, **details))
    return found + _parked(machine, recordings)


def _apart(machine: Machine, first: Recording, second: Recording) -> tuple[float, float]:
    """Compute how far two motions (of the joint that differs most) and all efforts differ, over their spread."""
    step = max(1, min(len(first), len(second)) // _ROWS)
    motion: list[float] = []
    effort: list[tuple[float, float]] = []
    still = {j.name for j in machine.joints if all(_stationary(machine, j, recording) for recording in (first, second))}
    columns = [
        c.name
        for c in machine.channels
        if c.quantity in POSITIONS and c.joint not in still and c.name in first.values and c.name in second.values
    ]
    spreads = {name: float(np.nanstd(first.values[name])) for name in columns}
    columns = [name for name in columns if spreads[name] > 0]
    if not columns:
        return np.inf, np.inf
    a, b = (np.stack([_without_gaps(r.values[n])[::step] for n in columns], axis=1) for r in (first, second))
    lag = lag_between(a, b, max(1, int(_MOST_LAG_S * machine.rate_hz / step)))
    for channel in machine.channels:
        if channel.name not in first.values or channel.name not in second.values or channel.joint in {None, *still}:
            continue
        left, right = first.values[channel.name][::step], second.values[channel.name][::step]
        left, right = left[max(0, -lag) :], right[max(0, lag) :]
        length = min(len(left), len(right))
        spread = float(np.nanstd(left))
        if spread <= 0 or length < 20:
            continue
        difference = left[:length] - right[:length]
        # One lost stretch or spike must not make another motion of it.
        own = float(np.sqrt(np.nanpercentile((difference - np.nanmedian(difference)) ** 2, 80))) / spread
        if channel.quantity.endswith("position"):
            motion.append(own)
        else:
            effort.append((float(np.nanstd(difference)), spread))
    # Over all of them: small ones are noise in good part.
    together = float(np.divide(*np.linalg.norm(np.array(effort), axis=0))) if effort else np.inf
    return max(motion, default=np.inf), together


def _without_gaps(values: FloatArray) -> FloatArray:
    """Fill missing values (N,) with straight lines."""
    known = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), known, values[known]) if len(known) else np.zeros(len(values))


def _stationary(machine: Machine, joint: Joint, recording: Recording) -> bool:
    """Return whether a joint moves at most a small share of its reach in a recording, single wrong values aside."""
    own = track(machine, joint, recording)
    return own is not None and float(np.subtract(*np.percentile(own[0], [99, 1]))) < STILL * own[1]


def _parked(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Report joints that do not move in any loaded recording, as a remark only."""
    loaded = [r for r in recordings if r.role != "unloaded"]
    return [
        finding_of("parked", joint=joint.name, severity="note")
        for joint in machine.joints
        if loaded and all(_stationary(machine, joint, recording) for recording in loaded)
    ]


#: A cylinder has no pressure where both chambers together have less than this share of what they have later (all but a
#: twentieth of the time), which has to be so much at least, Pa; and that for so many seconds, up to this share of the
#: recording.
_NOTHING, _LATER_PA, _LEAST_S, _MOST = 0.1, 2e5, 0.2, 0.3


def beginning_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Report each recording, in SI, that begins before the pumps run."""
    found = []
    for recording in recordings:
        rows = _rows_without_pressure(machine, recording)
        if rows < max(_LEAST_S * recording.rate_hz, 1):
            continue
        until = recording.time[rows] - recording.time[0]
        found.append(finding_of("no_pressure", recording=recording.file, before=float(until), unit="s", strength=3.0))
    return found


def _rows_without_pressure(machine: Machine, recording: Recording) -> int:
    """Count initial rows without pressure in any cylinder; 0 where that is not the beginning alone."""
    rows = len(recording)
    cylinders = 0
    for joint in machine.joints:
        channels = [machine.channel(quantity, joint.name) for quantity in PRESSURES]
        values = [recording.values[c.name] for c in channels if c is not None and c.name in recording.values]
        if not values:
            continue
        cylinders += 1
        rows = min(rows, _without_pressure(np.sum(values, axis=0)))
    return rows if cylinders and rows < _MOST * len(recording) else 0


def _without_pressure(total: FloatArray) -> int:
    """Count rows before a cylinder's pressures, both chambers together, are what they are later."""
    later = total[round(_MOST * len(total)) :]
    later = later[np.isfinite(later)]
    usual = float(np.percentile(later, 5)) if len(later) else 0.0
    if usual < _LATER_PA:
        return 0
    there = np.flatnonzero(~(total < _NOTHING * usual))  # a missing value is no pressure that is nothing
    return int(there[0]) if len(there) else len(total)
