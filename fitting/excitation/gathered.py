"""What is gathered already: information of motions and of recordings, which new motions then complement."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.motion_files import Motion
from daq.recordings.recording import Recording
from fitting.arm.base_parameters import BaseParameters, base_regressor
from fitting.arm.joint_side import at_joints
from fitting.arrays import FloatArray
from fitting.excitation.objective import information
from fitting.signals.filters import filter_bank
from fitting.signals.preparation import position_noise, segments_of

_BANDWIDTH = 3.0  # Hz, at most an eighth of the rate: smooth enough for accelerations of slow motions


def information_of(machine: Machine, base: BaseParameters, motion: Motion) -> FloatArray:
    """Information ``W'W`` (nb, nb) of a motion file: what it has gathered once it is recorded.

    Speeds and accelerations are those of a quintic spline through the positions, at rest at both ends, sampled at
    the machine's rate.

    Raises
    ------
    InputError
        If it is a motion of free cylinders.
    """
    if motion.rods != "pinned":
        raise InputError(f"a motion with rods=unpinned tells nothing about the links of {machine.name}; leave it out")
    rest: Any = [(order, np.zeros(len(machine.joints))) for order in (1, 2)]
    law = make_interp_spline(motion.time, motion.joint_positions(machine), k=5, bc_type=(rest, rest))
    count = round(motion.seconds * machine.rate_hz)
    time = np.linspace(0.0, motion.seconds, count + 1)
    Y = base_regressor(machine, base, law(time), law.derivative(1)(time), law.derivative(2)(time))
    return information(Y) * len(time)


def information_of_recording(machine: Machine, base: BaseParameters, recording: Recording) -> FloatArray:
    """Information ``W'W`` (nb, nb) of a recording with pinned rods, from its measured motion.

    A joint that rests has noise for a speed and an acceleration, which would pass for excitation: zero is taken there.

    Raises
    ------
    InputError
        If it was recorded with unpinned rods; RecordingError if no stretch of it is longer than the filters.
    """
    if recording.role == "unloaded":
        raise InputError(f"{recording.file}: was recorded with rods unpinned and tells nothing about the links")
    machine, (recording,) = at_joints(machine, (recording,))
    bank = filter_bank(machine.rate_hz, min(_BANDWIDTH, machine.rate_hz / 8))
    noise = position_noise(machine, (recording,), bank)
    total = np.zeros((len(base), len(base)))
    for segment in segments_of(machine, (recording,), bank, noise=noise):
        qd, qdd = (np.where(segment.rest, 0.0, values) for values in (segment.qd, segment.qdd))
        total += information(base_regressor(machine, base, segment.q, qd, qdd)) * len(segment)
    return total
