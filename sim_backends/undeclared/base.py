"""Hooks of undeclared effects.

An effect is a piece of physics that the machine file knows nothing about. It enters through one or more hooks of
:class:`UndeclaredEffect`; each hook is there because some real defect enters at that point of the plant:

``redesign``      the arm itself differs from its file: a pin, the base, the oil, a payload;
``joint_effort``  something acts on the joint beside the cylinder (gone when the rods are unpinned);
``deflection``    the link is not where its joint is;
``piston_force``  something rubs or pushes inside the cylinder (there when unpinned, too);
``sense``         a transducer reads something else than what is there.

Sizes are in natural SI units; 0 is the plant without the effect, exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from daq.machine.machine_file import Cylinder, Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.arm import ArmDesign
from sim_backends.plant.hydraulics import direction
from sim_backends.plant.truth import Truth


@dataclass
class Block:
    """Consecutive physics steps: (n,) over time, (n, J) over time and joints. Forces in N, positions in m or rad."""

    dt: float  # s
    time: FloatArray  # s since power-on
    motion_time: FloatArray  # s since the current motion began (negative: none yet)
    pinned: bool
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    lever: FloatArray  # r = dx/dq
    load: FloatArray  # F_l, what the arm asks of the piston
    temperature: FloatArray  # K
    p1: FloatArray  # Pa
    p2: FloatArray


@dataclass
class Readings:
    """Readings of ideal transducers, at every physics step; ``sense`` changes it in place. SI units."""

    joint_position: FloatArray  # (n, J)
    piston_position: FloatArray
    head_pressure: FloatArray
    rod_pressure: FloatArray
    cylinder_force: FloatArray  # hydraulic force p1 A1 - p2 A2
    joint_effort: FloatArray
    supply_pressure: FloatArray  # (n,)


@dataclass(frozen=True)
class Place:
    """Place of an effect: the machine, one of its joints (or the base: ``None``), and the random generator that
    decides its hidden shape (pitch, centre, time constant)."""

    machine: Machine
    truth: Truth
    joint: int | None
    dt: float
    rng: np.random.Generator


class UndeclaredEffect:
    """Base class: an effect that does nothing. Subclasses override the hooks they need."""

    id: ClassVar[str]
    unit: ClassVar[str]  # of the size
    meaning: ClassVar[str]  # of the size
    called: ClassVar[str] = ""  # its name in a catalogue, where that is not the id
    base_wide: ClassVar[bool] = False  # belongs to no joint
    needs_cylinder: ClassVar[bool] = True
    needs_three_pin: ClassVar[bool] = False
    needs_rotation: ClassVar[bool] = False  # a sliding joint cannot have it
    feels_pressure: ClassVar[bool] = False  # its piston force follows the chambers', which it changes itself: no state
    shown_by: ClassVar[tuple[str, ...]] = ()  # of :meth:`variables`, signals of its own joint
    shown_by_other: ClassVar[tuple[str, ...]] = ()  # and signals of ``other``, a neighbour that it draws
    other: int

    def __init__(self, place: Place, size: float) -> None:
        self.place = place
        self.size = size
        self.joint = -1 if place.joint is None else place.joint
        self.prepare(place.rng)

    def prepare(self, rng: np.random.Generator) -> None:
        """Draw the hidden shape."""

    def redesign(self, design: ArmDesign) -> ArmDesign:
        """Return the arm as it really is."""
        return design

    def joint_effort(self, block: Block) -> FloatArray | None:
        """Compute the effort (n,) in N m or N that the joint needs beside the rigid body's."""
        return None

    def deflection(self, effort: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Compute the angle (n,) by which the link lags under ``effort`` (n,), with two derivatives."""
        return None

    def piston_force(self, block: Block) -> FloatArray | None:
        """Compute the force (n,) in N that the chambers overcome beside the cylinder's own law."""
        return None

    def sense(self, block: Block, readings: Readings) -> None:
        """Change what the transducers read."""

    def variables(self) -> tuple[str, ...]:
        """Name the recorded signals whose law shows the effect, where no catalogue has it; any is right.

        Names as in a report: ``piston_position`` of the joint itself, ``joint3.piston_speed`` of another.
        """
        if not self.shown_by_other:
            return self.shown_by
        other = self.place.machine.joints[self.other].name
        return (*self.shown_by, *(f"{other}.{signal}" for signal in self.shown_by_other))

    # Helpers for subclasses

    @property
    def joint_name(self) -> str:
        """Name of the joint that the effect sits on."""
        return self.place.machine.joints[self.joint].name

    @property
    def cylinder(self) -> Cylinder:
        """The declared cylinder of the joint."""
        cylinder = self.place.machine.joints[self.joint].cylinder
        assert cylinder is not None
        return cylinder

    @property
    def travel(self) -> tuple[float, float]:
        """Piston positions (m) that the joint's limits allow, from low to high."""
        joint = self.place.machine.joints[self.joint]
        x = self.cylinder.linkage.piston_position(np.linspace(*joint.limits.position, 101))
        return float(x.min()), float(x.max())

    def stroke_fraction(self, block: Block) -> FloatArray:
        """Scale the piston position to 0 .. 1 over :attr:`travel`."""
        low, high = self.travel
        return (block.x[:, self.joint] - low) / (high - low)

    def neighbour(self, rng: np.random.Generator) -> int:
        """Return the index of an adjacent joint."""
        others = [k for k in (self.joint - 1, self.joint + 1) if 0 <= k < len(self.place.machine.joints)]
        return int(rng.choice(others)) if others else self.joint

    def speed_scale(self) -> float:
        """Return a typical fast piston speed in m/s: the joint's speed limit through its lever arm."""
        joint = self.place.machine.joints[self.joint]
        low, high = self.travel
        return joint.limits.velocity * (high - low) / (joint.limits.position[1] - joint.limits.position[0])

    def sign(self, block: Block) -> FloatArray:
        """Smooth the direction of the piston's motion."""
        return direction(block.v[:, self.joint])
