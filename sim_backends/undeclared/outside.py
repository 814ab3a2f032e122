"""Defects that stand in no catalogue: the loop has to localise them without a name."""

from __future__ import annotations

import numpy as np

from sim_backends.undeclared.base import Block, FloatArray, UndeclaredEffect


class BentGuide(UndeclaredEffect):
    """A dent in the guide: the rod rubs at one place of its stroke."""

    id = "bent_guide"
    unit = "N"
    meaning = "friction at the dent"

    def prepare(self, rng: np.random.Generator) -> None:
        self.centre, self.width = rng.uniform(0.3, 0.7), rng.uniform(0.08, 0.14)

    def piston_force(self, block: Block) -> FloatArray:
        u = (self.stroke_fraction(block) - self.centre) / self.width
        return self.size * self.sign(block) / np.square(np.cosh(u))

    def variables(self) -> tuple[str, ...]:
        return ("piston_position",)


class ThresholdSpring(UndeclaredEffect):
    """A cable or bracket that is caught from some position on and is stretched beyond it."""

    id = "threshold_spring"
    unit = "N"
    meaning = "force at the far end of the travel"

    def prepare(self, rng: np.random.Generator) -> None:
        self.threshold = rng.uniform(0.4, 0.65)

    def piston_force(self, block: Block) -> FloatArray:
        beyond = (self.stroke_fraction(block) - self.threshold) / (1.0 - self.threshold)
        return self.size * 0.03 * np.logaddexp(0.0, beyond / 0.03)

    def variables(self) -> tuple[str, ...]:
        return ("piston_position",)


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

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)
        self.knee = rng.uniform(0.15, 0.4) * self.speed_scale()

    def piston_force(self, block: Block) -> FloatArray:
        return self.size * np.tanh(block.v[:, self.other] / self.knee)

    def variables(self) -> tuple[str, ...]:
        return (f"{self.place.machine.joints[self.other].name}.piston_speed",)


class DwellStiction(UndeclaredEffect):
    """Seals that settle with time since the last reversal: friction grows, then a reversal breaks it."""

    id = "dwell_stiction"
    unit = "N"
    meaning = "friction after a long stroke in one direction"

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

    def variables(self) -> tuple[str, ...]:
        # Within a stroke the time since the reversal goes with speed and acceleration; no channel holds it.
        return ("time_since_reversal", "piston_speed", "piston_acceleration")
