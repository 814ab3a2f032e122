"""More defects that stand in no catalogue, written after the search for effects was finished, without a look at it."""

from __future__ import annotations

import numpy as np

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.undeclared.base import Block, UndeclaredEffect
from sim_backends.undeclared.friction import REFERENCE_PRESSURE


class SqueezedGuide(UndeclaredEffect):
    """A bracket shared with the neighbour's cylinder: what that one pushes bends this barrel and presses its guide."""

    id = "squeezed_guide"
    unit = "N"
    meaning = "friction while the neighbour's rod carries 2 MPa over its head area"
    # One chamber carries the load: its pressure is the force.
    shown_by_other = ("cylinder_force", "head_pressure", "rod_pressure")

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)
        cylinder = self.place.machine.joints[self.other].cylinder
        area = self.cylinder.head_area if cylinder is None else cylinder.head_area
        self.reference = REFERENCE_PRESSURE * area
        self.play = rng.uniform(0.02, 0.08)  # of the reference: lighter loads do not reach the guide

    def piston_force(self, block: Block) -> FloatArray:
        push = block.load[:, self.other] / self.reference
        return np.asarray(self.size * (np.hypot(push, self.play) - self.play) * self.sign(block))


class WipedFilm(UndeclaredEffect):
    """A rod that a dry wiper strips of its oil: friction rises once a stroke has gone on for a while."""

    id = "wiped_film"
    unit = "N"
    meaning = "friction at the end of a very long stroke"
    shown_by = ("distance_since_reversal",)

    def prepare(self, rng: np.random.Generator) -> None:
        low, high = self.travel
        self.length = rng.uniform(0.2, 0.45) * (high - low)
        self.gone, self.heading, self.last_x = 0.0, 0.0, np.nan

    def piston_force(self, block: Block) -> FloatArray:
        x = block.x[:, self.joint]
        steps = np.diff(x, prepend=x[0] if np.isnan(self.last_x) else self.last_x)
        gone, heading = self.gone, self.heading
        distance = np.empty_like(x)
        for k, (step, now) in enumerate(zip(steps.tolist(), np.sign(block.v[:, self.joint]).tolist(), strict=True)):
            gone = gone + abs(step) if now == heading else 0.0
            heading = now
            distance[k] = gone
        self.gone, self.heading, self.last_x = gone, heading, float(x[-1])
        stripped = np.square(distance / self.length)
        return np.asarray(self.size * stripped / (1.0 + stripped) * self.sign(block))


class LyingRod(UndeclaredEffect):
    """A heavy rod or slide along its link: its weight presses on the pads, most of all where the link lies level.

    The link's inclination is that of a group of parallel horizontal axes. Where this is one joint's own angle, or the
    axes are not horizontal, nothing comes of it.
    """

    id = "lying_rod"
    unit = "N"
    meaning = "friction while the link lies level"

    def prepare(self, rng: np.random.Generator) -> None:
        machine = self.place.machine
        self.last = self.joint - 1 if machine.joints[self.joint].type == "prismatic" else self.joint
        self.first = _first_of_group(machine, self.last)
        self.askew = rng.uniform(-0.3, 0.3)  # rad between rod and link
        inclined = self.joint != self.last  # a slide along the third axis of the link before it
        self.theta = sum(j.dh.theta for j in machine.joints[self.first : self.last + 1])
        self.theta += self.askew - (0.5 * np.pi if inclined else 0.0)

    def piston_force(self, block: Block) -> FloatArray | None:
        if not block.pinned or self.last - self.first < 1 or not _horizontal(self.place.machine, self.first):
            return None
        angle = block.q[:, self.first : self.last + 1].sum(axis=1) + self.theta
        return np.asarray(self.size * np.abs(np.cos(angle)) * self.sign(block))

    def variables(self) -> tuple[str, ...]:
        other = self.place.machine.joints[self.last].name
        return ("link_angle",) if self.last == self.joint else ("link_angle", f"{other}.link_angle")


class StarvedInflow(UndeclaredEffect):
    """A long suction hose: oil that has to follow a piston which is accelerated outwards, and tears off beyond."""

    id = "starved_inflow"
    unit = "N"
    meaning = "force at an outward acceleration that reaches a fast stroke's speed within a second"
    shown_by = ("piston_acceleration",)

    def prepare(self, rng: np.random.Generator) -> None:
        self.threshold = rng.uniform(0.05, 0.2)
        self.fast = self.speed_scale() / 1.0  # m/s^2

    def piston_force(self, block: Block) -> FloatArray:
        beyond = block.a[:, self.joint] / self.fast - self.threshold
        return np.asarray(self.size * 0.03 * np.logaddexp(0.0, beyond / 0.03))


class SharedGallery(UndeclaredEffect):
    """One narrow inlet for two cylinders: either fills freely alone, and both lose pressure when they fill together."""

    id = "shared_gallery"
    unit = "N"
    meaning = "force while this cylinder and its neighbour extend at a fast stroke"
    shown_by, shown_by_other = ("piston_speed",), ("piston_speed",)

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)
        self.bend = rng.uniform(0.02, 0.08)  # of a fast stroke: laminar below
        joint = self.place.machine.joints[self.other]
        lever = 1.0
        if joint.cylinder is not None:
            x = joint.cylinder.linkage.piston_position(np.linspace(*joint.limits.position, 101))
            lever = float(np.ptp(x)) / (joint.limits.position[1] - joint.limits.position[0])
        self.fast = self.speed_scale(), joint.limits.velocity * lever

    def piston_force(self, block: Block) -> FloatArray:
        own, other = (
            0.5 * (v + np.hypot(v, self.bend))
            for v in (block.v[:, j] / fast for j, fast in zip((self.joint, self.other), self.fast, strict=True))
        )
        return np.asarray(self.size * own * other)


class PilotLine(UndeclaredEffect):
    """A load-holding valve that the neighbour's head pressure opens: while that is low, it resists retracting."""

    id = "pilot_line"
    unit = "N"
    meaning = "resistance to retracting while the neighbour's head chamber has no pressure"
    feels_pressure = True
    shown_by_other = ("head_pressure", "cylinder_force")

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)
        self.half_open = rng.uniform(1.0e6, 4.0e6)  # Pa

    def piston_force(self, block: Block) -> FloatArray:
        closed = 1.0 / (1.0 + np.square(np.maximum(block.p1[:, self.other], 0.0) / self.half_open))
        return np.asarray(-self.size * closed * 0.5 * (1.0 - self.sign(block)))


def _first_of_group(machine: Machine, joint: int) -> int:
    """Return the first joint before ``joint`` that turns about an axis parallel to its own."""
    first = joint
    while first > 0 and machine.joints[first - 1].dh.alpha == 0.0 and machine.joints[first - 1].type == "revolute":
        first -= 1
    return first


def _horizontal(machine: Machine, joint: int) -> bool:
    """Test whether the joint's axis is horizontal in every pose, and its link's angle counts from the horizontal: at
    the base, or behind a vertical axis."""
    down = np.asarray(machine.gravity) / max(float(np.linalg.norm(machine.gravity)), 1e-9)
    if joint == 0:
        return abs(float(down[1])) > 0.999
    before = machine.joints[joint - 1]
    return joint == 1 and abs(float(down[2])) > 0.999 and abs(abs(before.dh.alpha) - 0.5 * np.pi) < 1e-9
