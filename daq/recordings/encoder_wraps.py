"""Encoders of one turn that begin anew within a motion: the turn is put back, and said.

Between two rows no joint makes a quarter of a turn, let alone a whole one: a step of a turn, give or take a quarter, is
the encoder's. Where the motion itself is so fast, or a jump is of another size (a counter that overflows, in m),
nothing is touched: that is for the checks to name.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq.arrays import FloatArray, IntArray
from daq.machine.machine_file import Channel, Machine
from daq.messages import Sentence

TURN = 2.0 * np.pi
#: Share of a turn that a step may be off a whole one, and that the usual largest step of the motion has to stay below.
_NEAR, _ORDINARY = 0.25, 0.1


def unwrapped(machine: Machine, channel: Channel, values: FloatArray) -> tuple[FloatArray, IntArray]:
    """Unwrap values (N,) in SI of a position, and return the rows before which there was a wrap.

    The turns are counted so that most of the motion lies where the joint can be; missing values are kept.
    """
    nothing = np.zeros(0, dtype=np.int64)
    if channel.quantity not in ("joint_position", "motor_position") or machine.si_unit(channel) != "rad":
        return values, nothing
    known = np.flatnonzero(np.isfinite(values))
    with np.errstate(over="ignore", invalid="ignore"):  # what no encoder can show has no rest of a turn
        steps = np.diff(values[known])
        turns = np.rint(steps / TURN)
        rest = np.abs(steps - TURN * turns)
        places = np.flatnonzero(turns)
        ordinary = float(np.percentile(rest, 99)) if len(steps) else 0.0
    if not len(places) or not ordinary <= _ORDINARY * TURN or not np.all(rest[places] <= _NEAR * TURN):
        return values, nothing
    out = values.copy()
    out[known[1:]] -= TURN * np.cumsum(turns)
    if channel.quantity == "joint_position":
        middle = float(np.mean(machine.joint(str(channel.joint)).limits.position))
        out += TURN * np.rint((middle - np.median(out[known])) / TURN)
    return out, known[places + 1]


def wrap_text(path: str | Path, channel: str, rows: IntArray, time: FloatArray) -> str:
    """Word the wraps: file, channel, how often, and the first row (counted from 1)."""
    row, seconds = int(rows[0]), float(time[rows[0]])
    return Sentence(
        "daq.encoder_wraps_times_first", path=path, channel=channel, count=len(rows), row=row + 1, seconds=seconds
    )
