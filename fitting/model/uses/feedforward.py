"""Feedforward of a motion file: what the drives have to do for it, to be played beside the positions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from daq.errors import InputError
from daq.motion_files import Motion, read_motion
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.prediction import write_joints


@dataclass(frozen=True)
class Trajectory:
    """A motion of all joints, (N, n) each, at the model's rate.

    Attributes
    ----------
    t : (N,) s from 0
    q, qd, qdd : positions, speeds, accelerations
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray


@dataclass(frozen=True)
class Feedforward:
    """Efforts and pressures that a motion takes, (N, n) each.

    Attributes
    ----------
    joints, units : names, and units of the joint efforts
    path : the motion
    effort, std : joint efforts, and the standard deviation of a measured one; N m or N
    force : efforts of the drives, N at a piston
    head, rod : chamber pressures, Pa; NaN where there is no cylinder, or no pressure was measured
    left_out : a line for each term of the model that is not in it
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    path: Trajectory
    effort: FloatArray
    std: FloatArray
    force: FloatArray
    head: FloatArray
    rod: FloatArray
    left_out: tuple[str, ...]


def path_of(model: ArmModel, program: Motion) -> Trajectory:
    """Interpolate a motion program: quintic splines, at rest at both ends; other joints hold mid-range.

    Raises
    ------
    InputError
        If the program is one of free pistons.
    """
    if program.rods != "pinned":
        raise InputError("fitting.motion_of_free_pistons")
    positions = program.joint_positions(model.machine)
    still = np.zeros(positions.shape[1])
    rest: Any = ([(1, still), (2, still)], [(1, still), (2, still)])
    law = scipy.interpolate.make_interp_spline(program.time, positions, k=5, bc_type=rest)
    t = np.arange(int(np.floor(program.seconds * model.machine.rate_hz + 1e-9)) + 1) / model.machine.rate_hz
    q, qd, qdd = (np.asarray(law(t, order)) for order in range(3))
    return Trajectory(t, q, qd, qdd)


def read_path(model: ArmModel, file: Path) -> Trajectory:
    """Read the motion of a motion file.

    Raises
    ------
    InputError
        One line about the file.
    """
    return path_of(model, read_motion(file, model.machine))


def feedforward(
    model: ArmModel, path: Trajectory, rod: float | None = None, *, temperature: float | None = None
) -> Feedforward:
    """Compute efforts and pressures of a motion.

    Parameters
    ----------
    rod : rod pressure that the machine keeps, Pa; the one that the recordings show at such a motion if None
    temperature : of the oil, K, for laws of it
    """
    found = motion.on_motion(model, path.q, path.qd, path.qdd, path.t, temperature=temperature)
    head, second = motion.pressures_of(found, rod)
    gone = motion.left_out(model)
    return Feedforward(
        joints=model.joints,
        units=model.joint_units,
        path=path,
        effort=found.joint_effort(0),
        std=found.joint_std(0),
        force=found.drive_effort(0),
        head=head,
        rod=second,
        left_out=tuple(
            f"{model.terms[k].id}: it belongs to the sensors, or to single recordings" for k in sorted(gone)
        ),
    )


def write_feedforward(path: Path, found: Feedforward) -> None:
    """Write a feedforward as a table, ``.csv`` or ``.parquet``, whole or not at all.

    Columns: ``time`` (s), and of each joint ``position``, ``effort``, ``std``, ``force``, and where it has a cylinder
    with pressures ``head_pressure`` and ``rod_pressure`` (Pa).

    Raises
    ------
    RecordingError
        If the suffix is another one or the place cannot be written.
    """
    parts = {"position": found.path.q, "effort": found.effort, "std": found.std, "force": found.force}
    parts |= {"head_pressure": found.head, "rod_pressure": found.rod}
    write_joints(path, found.path.t, found.joints, parts)
