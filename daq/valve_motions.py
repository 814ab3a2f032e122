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

from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Literal

from daq.whole_files import replacing

VALVE_SCHEMA = "hilfit/valve-motion/1"
Does = Literal["go", "hold", "swing"]


@dataclass(frozen=True)
class ValveAxis:
    """An axis as the controller has to know it; see the module."""

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
        """Return the command of a share of full, positive upwards."""
        return self.neutral + self.full * share

    def share(self, command: float) -> float:
        """Invert :meth:`sent`."""
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
