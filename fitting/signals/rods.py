"""Rows in which the rods are not where the recording's role states: on the arm, or off it (`unloaded`).

A recording is often started before the pins are in, or before the last one is out. Where a joint and its piston are
both measured, that shows: a piston on the arm is where the linkage states; and a cylinder that is free holds nothing.
Such rows belong to another machine, and a few of them are larger than anything that the loop looks for, so they are
left out, and reported.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from daq.errors import RecordingError
from daq.machine.machine_file import Joint, Machine
from daq.messages import Sentence
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import runs
from fitting.arm.linkage import cylinder_of
from fitting.arrays import BoolArray, FloatArray
from fitting.signals.preparation import drive_effort

#: A rod is off where its piston is farther from its usual place than this share of the stroke (linkage and encoder
#: errors, play and latency stay below it) and than so many robust deviations of that distance (they are part of those).
_APART, _DEVIATIONS = 0.02, 20.0
#: It is off before and after that, too, until the distance is an ordinary one again, and for so many seconds more.
_ORDINARY, _GUARD_S = 5.0, 0.5
#: s; a shorter one is a fault of a sensor.
_LEAST_S = 0.2
#: A piston that moves by this share of its stroke shows whether its joint follows: what is left of its motion then is
#: less than the first share if the rod is on, and more than the second if it is off.
_MOVES, _FOLLOWS, _ALONE = 0.01, 0.2, 0.5
#: An effort at the beginning or end of an `unloaded` recording is the arm's where it is farther from the middle of the
#: moving cylinder's than so many times their range (all but a fifth of them): at rest a free cylinder needs no more.
_HELD = 2.5
#: s, in which motion is looked at.
_WINDOW_S = 0.5


def with_declared_rods(
    machine: Machine, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """Cut rows with rods unlike the role out of recordings, with a line about each that has some.

    Parameters
    ----------
    machine : joints of which one position is measured only are not checked
    recordings : of that machine, in SI; those rows get a missing value, all others are kept

    Raises
    ------
    RecordingError
        If the rods are not as in the role in all of a recording in which anything shows it.
    """
    kept, lines = [], []
    for recording in recordings:
        wrong, joints, apart = np.zeros(len(recording), dtype=bool), list[str](), 0.0
        for joint in machine.joints:
            piston = machine.channel("piston_position", joint.name)
            if joint.cylinder is None or piston is None:
                continue
            if recording.role == "unloaded":
                found = _still_on(machine, joint, recording)
            else:
                found, farthest = _off(machine, joint, recording)
                apart = max(apart, farthest)
            if found.any():
                joints.append(joint.name)
                wrong |= found
        if not wrong.any():
            kept.append(recording)
            continue
        channel = machine.channel("piston_position", joints[0])
        assert channel is not None
        values = np.where(wrong, np.nan, recording.values[channel.name])
        kept.append(replace(recording, values=ChainMap({channel.name: values}, recording.values)))  # type: ignore[arg-type]
        lines.append(_line(recording, wrong, joints, apart))
    return tuple(kept), tuple(lines)


def _positions(machine: Machine, joint: Joint, recording: Recording) -> tuple[FloatArray, FloatArray | None]:
    """Return piston position and its distance from the linkage's, m; None if only one is measured."""
    angle = machine.channel("joint_position", joint.name)
    piston = machine.channel("piston_position", joint.name)
    assert piston is not None
    x = recording.values[piston.name]
    if angle is None:
        return x, None
    return x, np.asarray(x - cylinder_of(joint).linkage.piston_position(recording.values[angle.name]))


def _off(machine: Machine, joint: Joint, recording: Recording) -> tuple[BoolArray, float]:
    """Find rows with the rod off, and the piston's distance there, m."""
    nowhere = np.zeros(len(recording), dtype=bool)
    x, distance = _positions(machine, joint, recording)
    if distance is None or not np.isfinite(distance).any():
        return nowhere, 0.0
    stroke = cylinder_of(joint).stroke
    if _range(x) > 2 * _MOVES * stroke and _range(distance) > _ALONE * _range(x):
        raise RecordingError(
            "fitting.piston_moves_joint_not", file=recording.file, joint=joint.name, role=recording.role
        )
    away = np.abs(distance - np.nanmedian(distance))
    usual = 1.4826 * float(np.nanmedian(away))
    hard = away > max(_APART * stroke, _DEVIATIONS * usual)
    if not hard.any():
        return nowhere, 0.0
    least = round(_LEAST_S * recording.rate_hz)
    guard = round(_GUARD_S * recording.rate_hz)
    off = nowhere
    for run in runs(~(away <= max(_ORDINARY * usual, 1e-9))):  # a missing value ends nothing
        if np.count_nonzero(hard[run]) >= least:
            off[max(run.start - guard, 0) : run.stop + guard] = True
    return off, float(np.nanmax(away[off], initial=0.0))


def _still_on(machine: Machine, joint: Joint, recording: Recording) -> BoolArray:
    """Find rows with the rod on: joint and piston move together, or an end holds what no free cylinder needs."""
    x, distance = _positions(machine, joint, recording)
    on, moving = np.zeros(len(recording), dtype=bool), np.zeros(len(recording), dtype=bool)
    window, least = round(_WINDOW_S * recording.rate_hz), _MOVES * cylinder_of(joint).stroke
    alone = False
    for start in range(0, len(recording) - window + 1, window):
        part = slice(start, start + window)
        moved = _span(x[part])
        if moved <= least:
            continue
        if distance is not None and _span(distance[part]) < _FOLLOWS * moved:
            on[max(start - window, 0) : start + 2 * window] = True
            continue
        moving[part] = True
        alone = alone or (distance is not None and _span(distance[part]) > _ALONE * moved)
    if on.any() and not alone:
        raise RecordingError("fitting.moves_piston_rod_arm", file=recording.file, joint=joint.name)
    return np.asarray(on | _loaded_ends(machine, joint, recording, moving))


def _loaded_ends(machine: Machine, joint: Joint, recording: Recording, moving: BoolArray) -> BoolArray:
    """Find rows at either end whose effort is far outside the ``moving`` rows'."""

    def channel(quantity: str) -> FloatArray | None:
        found = machine.channel(quantity, joint.name)
        return None if found is None else recording.values[found.name]

    loaded, effort = np.zeros(len(recording), dtype=bool), drive_effort(joint, channel)
    if effort is None or not moving.any():
        return loaded
    low, high = np.nanpercentile(effort[moving], [10, 90])
    outside = ~(np.abs(effort - (low + high) / 2) <= _HELD * (high - low))
    guard, least = (round(seconds * recording.rate_hz) for seconds in (_GUARD_S, _LEAST_S))
    for run in runs(outside):
        if run.stop - run.start >= least and (run.start == 0 or run.stop == len(outside)):
            loaded[max(run.start - guard, 0) : run.stop + guard] = True
    return loaded


def _range(values: FloatArray) -> float:
    """Compute the range of all but a tenth of the values."""
    low, high = np.nanpercentile(values, [5, 95])
    return float(high - low)


def _span(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if len(finite) else 0.0


def _line(recording: Recording, wrong: BoolArray, joints: Sequence[str], apart: float) -> str:
    parts = runs(wrong)
    times = [
        Sentence("fitting.from_to_seconds", start=recording.time[p.start], end=recording.time[p.stop - 1])
        for p in parts[:3]
    ]
    why = (
        Sentence("fitting.cylinders_hold_move_arm")
        if recording.role == "unloaded"
        else Sentence("fitting.piston_up_mm_where", apart=1e3 * apart)
    )
    # A report may go further than the place where recordings are kept.
    return Sentence(
        "fitting.left_out",
        file=Path(recording.file).name,
        role=recording.role,
        times=times,
        more=_others(len(parts)),
        why=why,
        joints=joints[:3],
        others=_others(len(joints)),
    )


def _others(count: int) -> str:
    """Word how many more there are than the three that are named."""
    return Sentence("fitting.and_others", count=count - 3) if count > 3 else ""
