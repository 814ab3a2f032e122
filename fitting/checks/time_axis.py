"""The time column: its unit, its rate, rows that are lost, and clocks that jump.

A recorded speed agrees with the change of the position beside it to a few per cent, whatever the machine does. If they
disagree by one factor at every joint, the rows are not as far apart as in the time column; at one joint among others,
that channel has another unit or scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import RATE_TOLERANCE, regular_steps, uneven_steps
from fitting.arm.linkage import joint_position
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, Severity, finding_of
from fitting.signals.filters import filter_bank
from fitting.signals.lost_rows import repeated_rows
from fitting.signals.position_sensors import position_channel

#: What a time in another unit is too large by.
_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
_UNITS |= {1 / 60: "minutes", 1 / 3600: "hours", 1 / 86400: "days"}
#: Share of the time that may be lost before it is more than a remark, in gaps longer than so many s (shorter ones are
#: bridged) and in all; s of a pause.
_LOST, _LONG_S, _LOST_IN_ALL, _PAUSE_S = 0.05, 0.12, 0.25, 2.0
_CONTINUES = 4.0


def repaired_time(time: FloatArray, rate_hz: float) -> FloatArray:
    """Compute the time in s for the rest of the checks: another unit converted, another rate taken as meant."""
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
    """Check a time column; ``values`` show whether the machine moved on over a jump."""
    steps = np.diff(time)
    if len(steps) == 0 or not np.all(np.isfinite(time)):
        return []
    return _backwards(file, time, steps) or _other_rate(machine, file, steps) or _holes(machine, file, time, values)


def repeated_findings(recording: Recording) -> list[Finding]:
    """Report rows that repeat the one before in every channel."""
    rows = np.flatnonzero(repeated_rows(recording))
    if not len(rows):
        return []
    details = {"count": len(rows), "at": recording.time[rows[0]]}
    return [finding_of("lost_rows/repeated", recording=recording.file, severity="note", strength=4.0, **details)]


def _backwards(file: str, time: FloatArray, steps: FloatArray) -> list[Finding]:
    backwards = np.flatnonzero(steps <= 0)
    if not len(backwards):
        return []
    row = int(backwards[0])
    details: dict[str, Any] = {"earlier": time[row], "later": time[row + 1], "row": row + 2, "more": len(backwards) - 1}
    key = "time_jump/often" if details["more"] else "time_jump/backwards"
    return [finding_of(key, recording=file, strength=9.0, **details)]


def _other_rate(machine: Machine, file: str, steps: FloatArray) -> list[Finding]:
    rate = machine.rate_hz
    ratio = float(np.median(steps)) * rate
    if abs(ratio - 1) <= RATE_TOLERANCE:
        return []
    for size, name in _UNITS.items():
        if abs(ratio / size - 1) < 0.02:
            key = "time_unit/larger" if size > 1 else "time_unit/smaller"
            details: dict[str, Any] = {"says": name, "step": np.median(steps), "size": size}
            return [finding_of(key, recording=file, factor=1 / size, strength=9.0, **details)]
    return [finding_of("wrong_rate/steps", recording=file, before=rate / ratio, after=rate, unit="Hz", strength=9.0)]


def _holes(machine: Machine, file: str, time: FloatArray, values: dict[str, FloatArray]) -> list[Finding]:
    """Report a clock that was set, and rows that are lost."""
    rate, steps, found = machine.rate_hz, np.diff(time), list[Finding]()
    odd = np.flatnonzero(~regular_steps(time, rate))
    if len(odd) == 0:
        return []
    lost = float(np.sum(steps[odd] - 1 / rate))
    went_on = [k for k in odd if steps[k] > _PAUSE_S and _goes_on(values, int(k))]
    if went_on:
        k = int(went_on[0])
        details: dict[str, Any] = {"at": time[k], "recording": file, "before": float(steps[k]), "unit": "s"}
        found.append(finding_of("time_jump/clock_set", strength=8.0, **details))
        lost -= float(np.sum(steps[went_on]))
        odd = np.setdiff1d(odd, went_on)
    if len(odd):
        share = lost / float(time[-1] - time[0])
        long = odd[steps[odd] > _LONG_S + 1 / rate]
        in_long = float(np.sum(steps[long] - 1 / rate)) / float(time[-1] - time[0])
        many = in_long > _LOST or share > _LOST_IN_ALL or len(uneven_steps(time, rate)) > 0
        details = {"gaps": len(odd), "seconds": max(lost, 0.0), "at": time[odd[0]]}
        severity: Severity = "mistake" if many else "note"
        key = "lost_rows/many" if many else "lost_rows/few"
        found.append(finding_of(key, recording=file, severity=severity, before=share, strength=6.0, **details))
    return found


def _goes_on(values: dict[str, FloatArray], row: int) -> bool:
    """Return whether every moving signal is continuous over a step of time as between rows."""
    judged = 0
    for own in values.values():
        steps = np.abs(np.diff(own))
        ordinary = float(np.nanpercentile(steps, 95)) if np.isfinite(steps).any() else 0.0
        if ordinary > 0 and np.isfinite(steps[row]):
            judged += 1
            if steps[row] > _CONTINUES * ordinary:
                return False
    return judged > 0


#: Correlation from which a speed is that of the position; share that its size may be off; and that joints agree within.
_ALIKE, _OFF, _AGREE = 0.9, 0.1, 0.1
#: Of the rate, up to which both are compared.
_BAND = 0.125


def speed_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Check clocks and speed channels; ``recordings`` in SI at the machine's rate."""
    found: list[Finding] = []
    for recording in recordings:
        ratios = {
            joint.name: ratio
            for joint in machine.joints
            if (ratio := _ratio(machine, joint.name, recording)) is not None
        }
        off = {name: ratio for name, ratio in ratios.items() if abs(abs(ratio) - 1.0) > _OFF}
        if not off:
            continue
        middle = float(np.median(list(ratios.values())))
        if len(off) == len(ratios) and all(abs(ratio / middle - 1.0) < _AGREE for ratio in ratios.values()):
            found.append(_of_clock(recording, middle, len(ratios)))
            continue
        for name, ratio in off.items():
            channel = machine.channel("joint_velocity", name)
            assert channel is not None  # it has a ratio
            who: dict[str, Any] = {"joint": name, "channel": channel.name, "recording": recording.file}
            found.append(finding_of("scale", ratio=ratio, factor=1.0 / ratio, strength=6.0, **who))
    return found


def _ratio(machine: Machine, name: str, recording: Recording) -> float | None:
    """Fit the ratio of a joint's recorded speed to the change of its position; None where they do not match."""
    joint = machine.joint(name)
    speed = machine.channel("joint_velocity", name)
    place = position_channel(machine, joint)
    if speed is None or place is None or not {speed.name, place.name} <= set(recording.values):
        return None
    if recording.role == "unloaded" and joint.cylinder is not None:
        return None
    bank = filter_bank(recording.rate_hz, min(8.0, _BAND * recording.rate_hz))
    measured, derived = [], []
    for part in recording.segments([speed.name, place.name]):
        if part.stop - part.start > 4 * bank.margin:
            q = recording.values[place.name][part]
            q = joint_position(joint, q) if place.quantity == "piston_position" else q
            measured.append(bank.smoothed(recording.values[speed.name][part]))
            derived.append(bank.smooth(q)[1])
    if not measured:
        return None
    v, d = np.concatenate(measured), np.concatenate(derived)
    square = float(d @ d)
    if not square > 0 or abs(float(v @ d)) < _ALIKE * np.sqrt(square * float(v @ v)):
        return None
    return float(v @ d) / square


def _of_clock(recording: Recording, ratio: float, joints: int) -> Finding:
    alone = () if joints > 1 else (Sentence("fitting.unit_scale_speed_channel"),)
    return finding_of(
        "wrong_rate/speeds",
        times=abs(ratio),
        ms=1000.0 / (abs(ratio) * recording.rate_hz),
        expected_ms=1000.0 / recording.rate_hz,
        recording=recording.file,
        before=recording.rate_hz,
        after=abs(ratio) * recording.rate_hz,
        unit="Hz",
        factor=ratio,
        alternatives=alone,
        strength=9.0,
    )
