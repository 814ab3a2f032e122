"""Valve motions (:mod:`daq.valve_motions`) as the simulated controller reads them, and what it refuses to play."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import get_args

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.valve_motions import VALVE_SCHEMA, Does, Step, ValveAxis, ValveMotion


def is_valve_motion(path: str | Path) -> bool:
    """Test whether a file begins as a valve motion does; False as well for an unreadable one."""
    try:
        with Path(path).open("rb") as file:
            return file.read(64).startswith(f"# {VALVE_SCHEMA}".encode())
    except OSError:
        return False


def read_valve_motion(path: str | Path, machine: Machine) -> ValveMotion:
    """Read a valve motion and check it for ``machine``: axes with valves, commands and positions within their ranges.

    Raises
    ------
    InputError
        With one line: file, line, what is wrong.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        raise InputError(
            f"{path}: cannot be read; give a valve motion (CSV), 'hilfit valve-motion' makes one"
        ) from None
    head = [line for line in lines if line.startswith("#")]
    table = lines[len(head) :]
    if not head or not head[0].startswith(f"# {VALVE_SCHEMA} machine=") or not table:
        raise InputError(f"{path}:1: not a valve motion; it must start with '# {VALVE_SCHEMA} machine=NAME'")
    name = head[0].partition("machine=")[2]
    if name != machine.name:
        raise InputError(f"{path}:1: is a motion of machine '{name}', not of '{machine.name}'")
    axes = tuple(_axis(f"{path}:{place}", line, machine) for place, line in enumerate(head[1:], start=2))
    place = len(head) + 1
    if table[0] != ",".join(["does,seconds,hz", *(own.axis for own in axes)]):
        raise InputError(f"{path}:{place}: must name does, seconds, hz and then the axes of the lines above it")
    steps = tuple(_step(f"{path}:{place + k}", line, axes) for k, line in enumerate(table[1:], start=1))
    if not steps:
        raise InputError(f"{path}: has no steps")
    return ValveMotion(name, axes, steps)


def _axis(where: str, line: str, machine: Machine) -> ValveAxis:
    words: Mapping[str, str] = dict(word.split("=", 1) for word in line.removeprefix("#").split() if "=" in word)
    try:
        known = [float(words[field.name]) for field in fields(ValveAxis)[1:]]
        own = ValveAxis(words["axis"], *known)
    except (KeyError, ValueError):
        needs = ", ".join(field.name for field in fields(ValveAxis))
        raise InputError(f"{where}: an axis has NAME=NUMBER for each of {needs}") from None
    joint = next((joint for joint in machine.joints if joint.name == own.axis), None)
    if joint is None or joint.cylinder is None or joint.cylinder.valve is None:
        raise InputError(f"{where}: {machine.name} has no joint '{own.axis}' with a cylinder.valve")
    low, high = joint.limits.position
    fits = np.isfinite(known).all() and low <= own.low < own.high <= high and 0 <= own.edge < 1 and own.delay >= 0
    if not fits or own.full == 0 or own.speed <= 0 or not 0 < own.most <= 1 or own.rate <= 0:
        raise InputError(f"{where}: holds a number that cannot be; the range of {own.axis} is {low:.4g} to {high:.4g}")
    return own


def _step(where: str, line: str, axes: tuple[ValveAxis, ...]) -> Step:
    cells = line.split(",")
    try:
        seconds, hz, *values = (float(cell) for cell in cells[1:])
    except ValueError:
        seconds, hz, values = np.nan, 0.0, []
    does: Does | None = next((own for own in get_args(Does) if own == cells[0]), None)
    if does is None or len(values) != len(axes) or not np.isfinite([hz, *values]).all() or not 0 < seconds < np.inf:
        raise InputError(f"{where}: not a step: '{line[:40]}'; write does,seconds,hz and a number for each axis")
    for own, value in zip(axes, values, strict=True):
        if does == "go" and not own.low <= value <= own.high:
            raise InputError(f"{where}: {own.axis} is to go to {value:.4g}, beyond {own.low:.4g} to {own.high:.4g}")
        if does != "go" and abs(own.share(value)) > own.most * (1.0 + 1e-6):
            raise InputError(f"{where}: {own.axis} is sent {value:.4g}, more than {own.most:.4g} of full")
    return Step(does, seconds, tuple(values), hz)
