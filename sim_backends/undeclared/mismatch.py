"""Effects that bend one of a joint's two position sensors against the other: structure, play, some in no catalogue.

Where a compliance or a play sits decides its lever: along the cylinder (mounts, rod) it is a length per force at the
piston, about the joint (hub, link) an angle per effort. Which side of the seals it sits on decides whether it feels
their friction: the tube's mount bears what the chambers give, the rod's eye what the arm asks.

The piston's own inertia and friction feel the small extra stroke too little to matter, so only readings change.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from sim_backends.arrays import FloatArray
from sim_backends.plant.linear_filter import second_order
from sim_backends.undeclared.base import Block, Readings, UndeclaredEffect


class _Mismatch(UndeclaredEffect):
    """The piston's sensor reads more than the joint's position gives, by :meth:`gap`."""

    def gap(self, block: Block) -> FloatArray:
        """Compute the added gap (n,), m."""
        raise NotImplementedError

    def sense(self, block: Block, readings: Readings) -> None:
        if block.pinned:
            readings.piston_position[:, self.joint] += self.gap(block)


class _ForceDriven(_Mismatch):
    """A part that gives way to the force at the piston, felt with the seals' friction or without."""

    about_the_joint: ClassVar[bool] = False

    def prepare(self, rng: np.random.Generator) -> None:
        self.feels_friction = bool(rng.uniform() < 0.5)

    def bending(self, block: Block) -> FloatArray:
        """Return what bends it (n,): the force at the piston, N, or the effort about the joint, N m."""
        cylinder = self.cylinder
        force = block.load[:, self.joint]
        if self.feels_friction:
            force = block.p1[:, self.joint] * cylinder.head_area - block.p2[:, self.joint] * cylinder.rod_area
        return force * self.lever(block)

    def lever(self, block: Block) -> FloatArray:
        """Compute length along the cylinder (n,) per unit of yield, and unit of yield per force."""
        return block.lever[:, self.joint] if self.about_the_joint else np.ones(len(block.time))

    def typical(self) -> float:
        """Return a usual size of what bends it: 2 bar over the head area, about the joint at its mean lever."""
        low, high = self.travel
        limits = self.place.machine.joints[self.joint].limits.position
        lever = (high - low) / (limits[1] - limits[0]) if self.about_the_joint else 1.0
        return 2.0e5 * self.cylinder.head_area * lever


class CylinderCompliance(_ForceDriven):
    """Mounts and rod that give way along the cylinder, with a mode of their own."""

    id = "cylinder_compliance"
    unit = "m/N"
    meaning = "length by which mounts and rod give way per force"
    called = "structural_flexibility"

    def prepare(self, rng: np.random.Generator) -> None:
        super().prepare(rng)
        self.mode = second_order(rng.uniform(5.0, 9.0), rng.uniform(0.1, 0.3), self.place.dt)
        self.rest: float | None = None

    def gap(self, block: Block) -> FloatArray:
        bending = self.bending(block)
        if self.rest is None:  # starts at rest under its load
            self.rest = float(bending[0])
        bent = self.mode((bending - self.rest)[:, None])[0][:, 0] + self.rest
        return np.asarray(self.size * bent * self.lever(block))


class JointCompliance(CylinderCompliance):
    """A hub or a link between joint and encoder that twists."""

    id = "joint_compliance"
    unit = "rad/(N m)"
    meaning = "angle by which the hub gives way per effort"
    about_the_joint = True


class PinPlay(_ForceDriven):
    """Play along the cylinder that soft bushings, or pins that roll, cross over a width of force."""

    id = "pin_play"
    unit = "m"
    meaning = "play along the cylinder"
    called = "backlash"

    def prepare(self, rng: np.random.Generator) -> None:
        super().prepare(rng)
        self.width = self.typical() * float(np.exp(rng.uniform(np.log(0.02), np.log(0.5))))

    def gap(self, block: Block) -> FloatArray:
        side = np.clip(self.bending(block) / self.width, -1.0, 1.0)
        return np.asarray(0.5 * self.size * side * self.lever(block))


class JointPlay(PinPlay):
    """Play about the joint: a worn spline or hub between joint and encoder."""

    id = "joint_play"
    unit = "rad"
    meaning = "play about the joint"
    about_the_joint = True


class HardeningStructure(_ForceDriven):
    """A structure that gives way at first and hardens: of rubber, or of surfaces that close."""

    id = "hardening_structure"
    unit = "m"
    meaning = "length by which it gives way under a usual force"
    shown_by = ("cylinder_force",)

    def prepare(self, rng: np.random.Generator) -> None:
        super().prepare(rng)
        self.hardening = rng.uniform(2.0, 8.0)
        self.most = self.typical() * rng.uniform(0.7, 2.0)

    def gap(self, block: Block) -> FloatArray:
        # d + k d^3 = (1 + k) F / most, by Cardano's formula.
        right = (1.0 + self.hardening) / self.hardening * self.bending(block) / self.most
        third = 1.0 / (3.0 * self.hardening)
        root = np.cbrt(np.abs(right) / 2.0 + np.sqrt(right**2 / 4.0 + third**3))
        return np.asarray(self.size * np.sign(right) * (root - third / root))


class WarmingScale(_Mismatch):
    """A position transducer that grows longer while its electronics warm up."""

    id = "warming_scale"
    unit = "m"
    meaning = "shift of the piston's reading once it is warm"
    shown_by = ("time", "oil_temperature")

    def prepare(self, rng: np.random.Generator) -> None:
        self.settling = rng.uniform(15.0, 90.0)  # s

    def gap(self, block: Block) -> FloatArray:
        return np.asarray(-self.size * np.expm1(-np.maximum(block.time, 0.0) / self.settling))


class BendingFrame(_Mismatch):
    """A frame that bends with a neighbour's pose, and takes the cylinder's mount with it."""

    id = "bending_frame"
    unit = "m"
    meaning = "largest shift of the mount over a turn of the neighbour"
    shown_by_other = ("joint_position", "link_angle")

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)
        self.bearing = rng.uniform(0, 2 * np.pi)

    def gap(self, block: Block) -> FloatArray:
        joint = self.place.machine.joints[self.other]
        angle = block.q[:, self.other]
        if joint.type == "prismatic":  # over its travel, as over half a turn
            angle = np.pi * (angle - joint.limits.position[0]) / (joint.limits.position[1] - joint.limits.position[0])
        return np.asarray(self.size * np.sin(angle + self.bearing))


class ScaleWave(_Mismatch):
    """A scale whose error repeats along the rod: magnets, or pole pitches interpolated badly."""

    id = "scale_wave"
    unit = "m"
    meaning = "amplitude of the piston reading's error"
    shown_by = ("piston_position",)

    def prepare(self, rng: np.random.Generator) -> None:
        low, high = self.travel
        self.pitch = rng.uniform(0.08, 0.3) * (high - low)
        self.phase = rng.uniform(0, 2 * np.pi)

    def gap(self, block: Block) -> FloatArray:
        return np.asarray(self.size * np.sin(2 * np.pi * block.x[:, self.joint] / self.pitch + self.phase))
