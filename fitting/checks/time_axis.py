"""The time column: its unit, its rate, rows that are lost, and clocks that jump."""

from __future__ import annotations

from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import RATE_TOLERANCE, regular_steps, uneven_steps
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, Severity, finding_of
from fitting.signals.lost_rows import repeated_rows

#: What a time in another unit is too large by.
_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds", 1 / 60: "minutes", 1 / 3600: "hours"}
#: Share of the time that may be lost before it is more than a remark, in gaps longer than so many s (shorter ones are
#: bridged) and in all; s of a pause.
_LOST, _LONG_S, _LOST_IN_ALL, _PAUSE_S = 0.05, 0.12, 0.25, 2.0
_CONTINUES = 4.0


def repaired_time(time: FloatArray, rate_hz: float) -> FloatArray:
    """Time in s that the rest of the checks may use: another unit is converted, another rate taken as meant."""
    steps = np.diff(time)
    if len(steps) == 0 or not np.all(np.isfinite(time)):
        return np.arange(len(time)) / rate_hz
    step = float(np.median(steps))
    if step <= 0 or np.any(steps <= 0) or abs(step * rate_hz - 1) > RATE_TOLERANCE:
        ratio = step * rate_hz
        near = [unit for unit in _UNITS if step > 0 and abs(ratio / unit - 1) < 0.02]
        return time / near[0] if near and np.all(steps > 0) else np.arange(len(time)) / rate_hz
    return time


def time_findings(machine: Machine, file: str, time: FloatArray, values: dict[str, FloatArray]) -> list[Finding]:
    """What is wrong with a time column; ``values`` tell whether the machine went on over a jump."""
    steps = np.diff(time)
    if len(steps) == 0 or not np.all(np.isfinite(time)):
        return []
    return _backwards(file, time, steps) or _other_rate(machine, file, steps) or _holes(machine, file, time, values)


def repeated_findings(recording: Recording) -> list[Finding]:
    """A remark on rows that repeat the one before in every channel."""
    rows = np.flatnonzero(repeated_rows(recording))
    if not len(rows):
        return []
    said = {"count": len(rows), "at": recording.time[rows[0]]}
    return [finding_of("lost_rows/repeated", recording=recording.file, severity="note", strength=4.0, **said)]


def _backwards(file: str, time: FloatArray, steps: FloatArray) -> list[Finding]:
    backwards = np.flatnonzero(steps <= 0)
    if not len(backwards):
        return []
    row = int(backwards[0])
    said: dict[str, Any] = {"earlier": time[row], "later": time[row + 1], "row": row + 2, "more": len(backwards) - 1}
    key = "time_jump/often" if said["more"] else "time_jump/backwards"
    return [finding_of(key, recording=file, strength=9.0, **said)]


def _other_rate(machine: Machine, file: str, steps: FloatArray) -> list[Finding]:
    rate = machine.rate_hz
    ratio = float(np.median(steps)) * rate
    if abs(ratio - 1) <= RATE_TOLERANCE:
        return []
    for size, name in _UNITS.items():
        if abs(ratio / size - 1) < 0.02:
            key = "time_unit/larger" if size > 1 else "time_unit/smaller"
            said: dict[str, Any] = {"says": name, "step": np.median(steps), "size": size}
            return [finding_of(key, recording=file, factor=1 / size, strength=9.0, **said)]
    return [finding_of("wrong_rate/steps", recording=file, before=rate / ratio, after=rate, unit="Hz", strength=9.0)]


def _holes(machine: Machine, file: str, time: FloatArray, values: dict[str, FloatArray]) -> list[Finding]:
    """A clock that was set, and rows that are lost."""
    rate, steps, found = machine.rate_hz, np.diff(time), list[Finding]()
    odd = np.flatnonzero(~regular_steps(time, rate))
    if len(odd) == 0:
        return []
    lost = float(np.sum(steps[odd] - 1 / rate))
    went_on = [k for k in odd if steps[k] > _PAUSE_S and _goes_on(values, int(k))]
    if went_on:
        k = int(went_on[0])
        found.append(
            finding_of(
                "time_jump/clock_set", at=time[k], recording=file, before=float(steps[k]), unit="s", strength=8.0
            )
        )
        lost -= float(np.sum(steps[went_on]))
        odd = np.setdiff1d(odd, went_on)
    if len(odd):
        share = lost / float(time[-1] - time[0])
        long = odd[steps[odd] > _LONG_S + 1 / rate]
        in_long = float(np.sum(steps[long] - 1 / rate)) / float(time[-1] - time[0])
        many = in_long > _LOST or share > _LOST_IN_ALL or len(uneven_steps(time, rate)) > 0
        said: dict[str, Any] = {"gaps": len(odd), "seconds": max(lost, 0.0), "at": time[odd[0]]}
        severity: Severity = "mistake" if many else "note"
        key = "lost_rows/many" if many else "lost_rows/few"
        found.append(finding_of(key, recording=file, severity=severity, before=share, strength=6.0, **said))
    return found


def _goes_on(values: dict[str, FloatArray], row: int) -> bool:
    """Whether every moving signal goes on over a step of time as from one row to the next."""
    judged = 0
    for own in values.values():
        steps = np.abs(np.diff(own))
        ordinary = float(np.nanpercentile(steps, 95)) if np.isfinite(steps).any() else 0.0
        if ordinary > 0 and np.isfinite(steps[row]):
            judged += 1
            if steps[row] > _CONTINUES * ordinary:
                return False
    return judged > 0
