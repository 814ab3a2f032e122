"""Valve motions: commands for the arm's own controller to play, from which its valves are identified.

A valve motion is a CSV table of steps, one after the other::

    # hilfit/valve-motion/1 machine=crane
    # axis=boom neutral=0 full=100 low=-0.5 high=0.5 speed=0.36 edge=0.08 delay=0.25 most=0.77 rate=6.1
    does,seconds,hz,boom
    go,8,0,0.12
    hold,10,0,0
    hold,1.15,0,45.2
    swing,9.1,0.11,-30

``go`` moves each axis by feedback to a joint position in rad (m), for ``seconds`` at most. ``hold`` sends a command as
it is, in the amplifier's unit. ``swing`` sends ``neutral + (value - neutral) cos(2 pi hz t)``. A line ``axis`` says
what the controller has to know of each: the command of the closed valve; ``full``, what is added to it so that the
joint goes **up** at full speed (negative where that takes less); the joint's range; the speed (rad/s or m/s) that full
command is expected to give, the dead band (share of full) and the delay (s); and the limits of the command, ``most`` as
a share of full and ``rate`` per second. hilfit writes such files and no commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.recordings.recording_files import replacing

VALVE_SCHEMA = "hilfit/valve-motion/1"
Does = Literal["go", "hold", "swing"]


@dataclass(frozen=True)
class ValveAxis:
    """What the controller has to know of an axis; see the module."""

    axis: str
    neutral: float
    full: float
    low: float
    high: float
    speed: float
    edge: float
    delay: float
    most: float
    rate: float

    def sent(self, share: float) -> float:
        """The command of a share of full, positive upwards."""
        return self.neutral + self.full * share

    def share(self, command: float) -> float:
        """The inverse of :meth:`sent`."""
        return (command - self.neutral) / self.full


@dataclass(frozen=True)
class Step:
    """One step: what is done for how many ``seconds``, with a value for each axis; ``hz`` is 0 but for a swing."""

    does: Does
    seconds: float
    values: tuple[float, ...]
    hz: float = 0.0


@dataclass(frozen=True)
class ValveMotion:
    """A valve motion of some axes of a machine."""

    machine: str
    axes: tuple[ValveAxis, ...]
    steps: tuple[Step, ...]


def write_valve_motion(path: str | Path, motion: ValveMotion) -> None:
    """Write a valve motion; the file appears whole or not at all."""
    lines = [f"# {VALVE_SCHEMA} machine={motion.machine}"]
    for own in motion.axes:
        known = (f"{field.name}={value:.9g}" for field, value in zip(fields(own)[1:], astuple(own)[1:], strict=True))
        lines.append(" ".join([f"# axis={own.axis}", *known]))
    lines.append(",".join(["does,seconds,hz", *(own.axis for own in motion.axes)]))
    for step in motion.steps:
        lines.append(",".join([step.does, *(f"{value:.9g}" for value in (step.seconds, step.hz, *step.values))]))
    with replacing(Path(path)) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def is_valve_motion(path: str | Path) -> bool:
    """Whether a file begins as a valve motion does; False as well for one that cannot be read."""
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
