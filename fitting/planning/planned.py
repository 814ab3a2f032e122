"""Planned motions as if they had been recorded: what an experiment will tell, before anybody makes it.

A motion program goes through the same filters as a recording, so its columns are those that the regression will have.
Only the measured efforts are missing, and nothing here needs them: information is a matter of columns and noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.motion_files import Motion
from fitting.arm.linkage import piston_motion
from fitting.arrays import BoolArray, FloatArray
from fitting.signals.filters import FilterBank
from fitting.signals.preparation import REST_SPEED, PositionNoise, Segment, long_rests, motion_segment

#: Position, speed and acceleration, each (N, n).
States = tuple[FloatArray, FloatArray, FloatArray]

ROLE = "planned"


def planned_segment(
    machine: Machine, bank: FilterBank, noise: Sequence[PositionNoise], motion: Motion, recording: int = 0
) -> Segment:
    """Return the segment that preparation would make of a recorded motion, without noise and efforts.

    Parameters
    ----------
    machine, bank : the machine, and the filters of the identification
    noise : position noise per joint: below some times its own noise a speed counts as rest
    motion : the motion program; joints without a column are mid-range
    recording : number that the recording will have

    Raises
    ------
    InputError
        If the motion is shorter than the filters.
    """
    length = round(motion.seconds * bank.rate_hz) + 1
    least = 2 * (bank.margin + bank.half) + 4 * bank.decimation
    if length <= least:
        raise InputError("fitting.motion_shorter_filters", seconds=motion.seconds, least=least / bank.rate_hz)
    time = np.arange(length) / bank.rate_hz
    samples = length - 2 * bank.margin
    moved: dict[str, tuple[FloatArray, FloatArray, FloatArray]] = {
        name: bank.smooth(_resampled(motion.time, column, time)) for name, column in motion.columns.items()
    }
    still = np.zeros(samples)
    parked = [(still + sum(joint.limits.position) / 2, still, still) for joint in machine.joints]
    if motion.rods == "pinned":
        turning = [moved.get(joint.name, parked[j]) for j, joint in enumerate(machine.joints)]
        return segment_of_states(machine, bank, noise, _stacked(turning), recording)
    driving = [
        moved.get(
            joint.name, parked[j] if joint.cylinder is None else piston_motion(joint.cylinder.linkage, *parked[j])
        )
        for j, joint in enumerate(machine.joints)
    ]
    return segment_of_states(machine, bank, noise, _stacked(parked), recording, _stacked(driving), loaded=False)


def segment_of_states(
    machine: Machine,
    bank: FilterBank,
    noise: Sequence[PositionNoise],
    turning: States,
    recording: int = 0,
    driving: States | tuple[()] = (),
    loaded: bool = True,
) -> Segment:
    """Make :func:`planned_segment` from the states of all joints at the machine's rate; of the pistons if given."""
    time = (bank.margin + np.arange(len(turning[0]))) / bank.rate_hz
    planned = {"recording": recording, "role": ROLE, "start": bank.margin, "loaded": loaded}
    moved = motion_segment(machine, time, turning, driving, **planned)
    rests = [_rest(moved.v[:, j], noise[j].speed, bank.rate_hz) for j in range(len(machine.joints))]
    return replace(moved, rest=np.stack(rests, axis=1))


def _stacked(columns: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> States:
    position, speed, acceleration = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
    return position, speed, acceleration


def _resampled(time: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    if len(time) == len(wanted) and np.allclose(time, wanted, rtol=0, atol=1e-9):
        return values
    return np.asarray(make_interp_spline(time, values, k=5)(np.minimum(wanted, time[-1])))


def _rest(speed: FloatArray, noise: float, rate_hz: float) -> BoolArray:
    """Return where an element is at rest, as in preparation; without noise as well."""
    return long_rests(np.abs(speed) <= max(REST_SPEED * noise, 1e-12), rate_hz)
