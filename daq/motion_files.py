"""Motion files: what the arm's own controller is asked to do.

A motion file is a CSV table::

    # hilfit/motion/1 machine=folding-arm rods=pinned
    time,joint1,joint2
    0,0.1,-0.2
    0.02,0.100013,-0.200021

``rods=pinned``: joint positions in rad (m), columns named after the joints. ``rods=unpinned``: the rods are
taken off the arm, and the columns are piston positions in m, named ``<joint>.piston``. Time starts at 0 and
rises, for an hour at most; a motion starts and ends at rest. Joints without a column hold still.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from daq.arrays import FloatArray
from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.whole_files import write_whole

Rods = Literal["pinned", "unpinned"]

SCHEMA = "hilfit/motion/1"
#: s: the longest motion, and the least between two rows, whose sixth power a quintic spline divides by.
LONGEST_S, LEAST_STEP_S = 3600.0, 1e-6
_PISTON = ".piston"


@dataclass(frozen=True)
class Motion:
    """A motion program.

    Attributes
    ----------
    machine : name of the machine that it was made for
    rods : ``pinned``: the columns are joint positions; ``unpinned``: piston positions of free cylinders
    time : shape (N,), s, from 0
    columns : per joint name, positions of shape (N,): rad (m) of the joint, or m of its piston
    """

    machine: str
    rods: Rods
    time: FloatArray
    columns: Mapping[str, FloatArray]

    @property
    def seconds(self) -> float:
        """Duration in s."""
        return float(self.time[-1])

    def joint_positions(self, machine: Machine) -> FloatArray:
        """Return positions of all joints, (N, n); those without a column hold still in the middle of their range."""
        still = {joint.name: np.full(self.time.shape, sum(joint.limits.position) / 2) for joint in machine.joints}
        return np.column_stack([self.columns.get(name, held) for name, held in still.items()])


def write_motion(path: str | Path, motion: Motion) -> None:
    """Write a motion file; the file appears whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    path = Path(path)
    suffix = _PISTON if motion.rods == "unpinned" else ""
    lines = [
        f"# {SCHEMA} machine={motion.machine} rods={motion.rods}",
        ",".join(["time", *(name + suffix for name in motion.columns)]),
    ]
    table = np.column_stack([motion.time, *motion.columns.values()])
    lines += [",".join(f"{value:.9g}" for value in row) for row in table]
    try:
        path.parent.stat()  # no folder is made: its name may be mistyped
        with suppress(FileNotFoundError):
            path.stat()  # in a file that is taken for a folder: says so
        write_whole(path, ("\n".join(lines) + "\n").encode())  # a controller may watch the folder
    except OSError as error:
        raise InputError("daq.not_writable_here", path=path, reason=error.strerror) from None


def read_motion(path: str | Path, machine: Machine | None = None, *, slack: float = 1e-6) -> Motion:
    """Read a motion file; with ``machine``, check that it was made for it.

    Parameters
    ----------
    slack : of a joint's or piston's range, by which a position may be beyond its ends

    Raises
    ------
    InputError
        With one line: file, line or column, what is wrong and what to do.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise InputError("daq.no_such_file_hilfit", path=path) from None
    except UnicodeDecodeError:
        raise InputError("daq.not_text_file_give", path=path) from None
    except OSError as error:
        raise InputError("daq.cannot_read_give", path=path, reason=error.strerror) from None
    name, rods = _first_line(path, lines[0] if lines else "")
    header = lines[1].split(",") if len(lines) > 1 else []
    if header[:1] != ["time"] or len(header) < 2 or len(set(header)) != len(header):
        raise InputError("daq.must_name_time_column", path=path)
    table = _numbers(path, lines[2:], header)
    suffix = _PISTON if rods == "unpinned" else ""
    joints = []
    for column in header[1:]:
        if suffix and not column.endswith(suffix):
            raise InputError("daq.column_must_end_because", path=path, column=column, piston=_PISTON)
        joints.append(column.removesuffix(suffix))
    motion = Motion(name, rods, table[:, 0], {joint: table[:, k + 1] for k, joint in enumerate(joints)})
    if machine is not None:
        _fits(path, motion, machine, slack)
    return motion


def _first_line(path: Path, line: str) -> tuple[str, Rods]:
    words = line.split()
    fields = dict(word.split("=", 1) for word in words[2:] if "=" in word)
    rods = fields.get("rods")
    if words[:2] != ["#", SCHEMA] or "machine" not in fields:
        raise InputError("daq.not_motion_file", path=path, schema=SCHEMA)
    if rods == "pinned":
        return fields["machine"], "pinned"
    if rods == "unpinned":
        return fields["machine"], "unpinned"
    raise InputError("daq.motion_rods_unknown", path=path, rods=f"{rods!r}")


def _numbers(path: Path, lines: list[str], header: list[str]) -> FloatArray:
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=3):
        cells = line.split(",")
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise InputError("daq.not_numbers", path=path, number=number, line=line[:40]) from None
        if len(row) != len(header):
            raise InputError("daq.motion_columns_differ", path=path, number=number, count=len(row), count_2=len(header))
        rows.append(row)
    if len(rows) < 6:
        raise InputError("daq.motion_too_short", path=path, count=len(rows))
    table = np.array(rows)
    if not np.isfinite(table).all():
        bad = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise InputError("daq.holds_value_not_finite", path=path, bad=bad + 3)
    if table[0, 0] != 0.0 or np.any(np.diff(table[:, 0]) < LEAST_STEP_S) or table[-1, 0] > LONGEST_S:
        raise InputError("daq.time_must_start_rise", path=path)
    return table


def _fits(path: Path, motion: Motion, machine: Machine, slack: float) -> None:
    if motion.machine != machine.name:
        raise InputError("daq.motion_machine_not", path=path, machine=motion.machine, machine_2=machine.name)
    for name, positions in motion.columns.items():
        joint = next((joint for joint in machine.joints if joint.name == name), None)
        if joint is None:
            raise InputError("daq.no_joint", path=path, name=name, machine=machine.name)
        if motion.rods == "unpinned" and joint.cylinder is None:
            raise InputError("daq.no_cylinder_no_piston", path=path, name=name)
        if motion.rods == "pinned" or joint.cylinder is None:
            (low, high), unit = joint.limits.position, "rad" if joint.type == "revolute" else "m"
        else:
            low, high, unit = 0.0, joint.cylinder.stroke, "m"
        more = slack * (high - low)
        if positions.min() < low - more or positions.max() > high + more:
            raise InputError(
                "daq.goes_beyond",
                path=path,
                name=name,
                positions=positions.min(),
                positions_2=positions.max(),
                unit=unit,
                low=low,
                high=high,
            )
