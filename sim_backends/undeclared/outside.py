"""Defects that stand in no catalogue: the loop has to localise them without a name."""

from __future__ import annotations

import numpy as np

from sim_backends.arrays import FloatArray
from sim_backends.undeclared.base import Block, UndeclaredEffect


class BentGuide(UndeclaredEffect):
    """A dent in the guide: the rod rubs at one place of its stroke."""

    id = "bent_guide"
    unit = "N"
    meaning = "friction at the dent"
    shown_by = ("piston_position",)

    def prepare(self, rng: np.random.Generator) -> None:
        self.centre, self.width = rng.uniform(0.3, 0.7), rng.uniform(0.08, 0.14)

    def piston_force(self, block: Block) -> FloatArray:
        u = (self.stroke_fraction(block) - self.centre) / self.width
        return self.size * self.sign(block) / np.square(np.cosh(u))


class ThresholdSpring(UndeclaredEffect):
    """A cable or bracket that is caught from some position on and is stretched beyond it."""

    id = "threshold_spring"
    unit = "N"
    meaning = "force at the far end of the travel"
    shown_by = ("piston_position",)

    def prepare(self, rng: np.random.Generator) -> None:
        self.threshold = rng.uniform(0.4, 0.65)

    def piston_force(self, block: Block) -> FloatArray:
        beyond = (self.stroke_fraction(block) - self.threshold) / (1.0 - self.threshold)
        return self.size * 0.03 * np.logaddexp(0.0, beyond / 0.03)


class NeighbourProductFriction(UndeclaredEffect):
    """A twisted column: friction depends on the product of two neighbours' poses, on neither alone."""

    id = "neighbour_product_friction"
    unit = "N"
    meaning = "friction when both neighbours are at the same end of their travel"

    def prepare(self, rng: np.random.Generator) -> None:
        count = len(self.place.machine.joints)
        others = [k for k in range(count) if k != self.joint] or [self.joint]
        near = sorted(others, key=lambda k: abs(k - self.joint))
        self.pair = (near[0], near[min(1, len(near) - 1)])

    def piston_force(self, block: Block) -> FloatArray:
        product = np.ones(len(block.time))
        for k in self.pair:
            low, high = self.place.machine.joints[k].limits.position
            product *= (2.0 * block.q[:, k] - low - high) / (high - low)
        return self.size * product * self.sign(block)

    def variables(self) -> tuple[str, ...]:
        return tuple(f"{self.place.machine.joints[k].name}.joint_position" for k in self.pair)


class SaturatingCoupling(UndeclaredEffect):
    """A pilot line from the neighbour: its speed pushes here, up to a saturation."""

    id = "saturating_coupling"
    unit = "N"
    meaning = "force at saturation"
    shown_by_other = ("piston_speed",)

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)
        self.knee = rng.uniform(0.15, 0.4) * self.speed_scale()

    def piston_force(self, block: Block) -> FloatArray:
        return self.size * np.tanh(block.v[:, self.other] / self.knee)


class DwellStiction(UndeclaredEffect):
    """Seals that settle with time since the last reversal: friction grows, then a reversal breaks it."""

    id = "dwell_stiction"
    unit = "N"
    meaning = "friction after a long stroke in one direction"
    # Within a stroke the time since the reversal goes with speed and acceleration; no channel holds it.
    shown_by = ("time_since_reversal", "piston_speed", "piston_acceleration")

    def prepare(self, rng: np.random.Generator) -> None:
        self.settling = rng.uniform(1.0, 3.0)  # s
        self.age, self.heading = 0.0, 0.0

    def piston_force(self, block: Block) -> FloatArray:
        ages = np.empty(len(block.time))
        age, heading = self.age, self.heading
        for k, now in enumerate(np.sign(block.v[:, self.joint]).tolist()):
            age = age + block.dt if now == heading else 0.0
            heading = now
            ages[k] = age
        self.age, self.heading = age, heading
        return self.size * -np.expm1(-ages / self.settling) * self.sign(block)


class NeighbourInertia(UndeclaredEffect):
    """A gear or a link that the machine file leaves out: the neighbour's acceleration pushes here."""

    id = "neighbour_inertia"
    unit = "kg"
    meaning = "piston force here per acceleration of the neighbour's piston"
    shown_by_other = ("piston_acceleration",)

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)

    def piston_force(self, block: Block) -> FloatArray:
        return np.asarray(self.size * block.a[:, self.other])


class DentedRod(UndeclaredEffect):
    """Several dents along the rod, of different depth and at no regular distance."""

    id = "dented_rod"
    unit = "N"
    meaning = "friction at the deepest dent"
    shown_by = ("piston_position",)

    def prepare(self, rng: np.random.Generator) -> None:
        count = int(rng.integers(3, 5))
        self.centres = np.sort(rng.uniform(0.12, 0.88, count))
        self.widths, self.depths = rng.uniform(0.03, 0.07, count), rng.uniform(0.4, 1.0, count)
        self.depths /= self.depths.max()

    def piston_force(self, block: Block) -> FloatArray:
        u = (self.stroke_fraction(block)[:, None] - self.centres) / self.widths
        return np.asarray(self.size * self.sign(block) * (self.depths / np.square(np.cosh(u))).sum(axis=1))


class ReturnLine(UndeclaredEffect):
    """A return line shared by all cylinders: what all of them displace together raises the pressure here."""

    id = "return_line"
    unit = "N"
    meaning = "force when all cylinders run fast"
    shown_by = ("total_flow",)

    def prepare(self, rng: np.random.Generator) -> None:
        areas = [0.0 if j.cylinder is None else j.cylinder.head_area for j in self.place.machine.joints]
        self.areas = np.array(areas)
        speeds = [j.limits.velocity for j in self.place.machine.joints]
        self.fast = 0.2 * float(self.areas @ np.array(speeds)) * self.speed_scale() / speeds[self.joint]

    def piston_force(self, block: Block) -> FloatArray:
        flow = np.abs(block.v) @ self.areas / self.fast
        return np.asarray(self.size * flow * flow)


class HangingHose(UndeclaredEffect):
    """A hose bundle that hangs from the link: its pull follows the link's angle to the ground."""

    id = "hanging_hose"
    unit = "N"
    meaning = "largest pull along the piston"
    needs_rotation = True

    def prepare(self, rng: np.random.Generator) -> None:
        self.harmonic, self.phase = float(rng.choice([2.0, 3.0])), rng.uniform(0, 2 * np.pi)
        joints, first = self.place.machine.joints, self.joint
        while first > 0 and joints[first - 1].dh.alpha == 0.0:
            first -= 1
        self.parallel = slice(first, self.joint + 1)

    def piston_force(self, block: Block) -> FloatArray:
        angle = block.q[:, self.parallel].sum(axis=1)
        return np.asarray(self.size * np.sin(self.harmonic * angle + self.phase) * float(block.pinned))

    def variables(self) -> tuple[str, ...]:
        alone = self.parallel.stop - self.parallel.start == 1  # then it is the joint's own angle
        return ("link_angle", "piston_position") if alone else ("link_angle",)
