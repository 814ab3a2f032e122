"""Forces inside the cylinder or between its pins that depend on position, speed or the neighbours."""

from __future__ import annotations

import math

import numpy as np

from sim_backends.arrays import FloatArray
from sim_backends.plant.linear_filter import second_order
from sim_backends.undeclared.base import Block, UndeclaredEffect


class QuadraticLoss(UndeclaredEffect):
    """A port fitting between transducer and chamber: pressure lost with the square of the flow."""

    id = "quadratic_loss"
    unit = "N"
    meaning = "force lost at a fast stroke"

    def piston_force(self, block: Block) -> FloatArray:
        v = block.v[:, self.joint] / self.speed_scale()
        return self.size * v * np.sqrt(v**2 + 0.03**2)  # laminar at a creep


class EndCushion(UndeclaredEffect):
    """A cushion that closes near one end of the travel: stiff, and harder when it is driven into."""

    id = "end_cushion"
    unit = "N"
    meaning = "force at the end of the travel, at rest"

    def prepare(self, rng: np.random.Generator) -> None:
        self.at_far_end = rng.uniform() < 0.5
        self.depth = rng.uniform(0.12, 0.25)  # of the travel
        self.power = rng.uniform(1.2, 2.2)

    def piston_force(self, block: Block) -> FloatArray:
        u = self.stroke_fraction(block)
        inwards = block.v[:, self.joint] / self.speed_scale()
        if not self.at_far_end:
            u, inwards = 1.0 - u, -inwards
        closed = np.maximum(u - (1.0 - self.depth), 0.0) / self.depth
        push = self.size * closed**self.power * (1.0 + 0.8 * inwards)
        return push if self.at_far_end else -push


class GasSpring(UndeclaredEffect):
    """A pre-charged accumulator on the head side: adiabatic compression over the stroke."""

    id = "gas_spring"
    unit = "N"
    meaning = "rise of its force over the travel"

    def prepare(self, rng: np.random.Generator) -> None:
        self.swept = rng.uniform(0.5, 0.75)  # of the gas volume
        self.exponent = rng.uniform(1.1, 1.4)

    def piston_force(self, block: Block) -> FloatArray:
        u = np.clip(self.stroke_fraction(block), -0.2, 1.2)
        full = math.pow(1.0 - self.swept, -self.exponent) - 1.0
        return self.size * (np.power(1.0 - self.swept * u, -self.exponent) - 1.0) / full


class CounterbalanceValve(UndeclaredEffect):
    """A valve that holds an overrunning load: it throttles while the load drives the retracting piston."""

    id = "counterbalance_valve"
    unit = "N"
    meaning = "holding force while lowering an overrunning load at a fast stroke"

    def piston_force(self, block: Block) -> FloatArray:
        load = block.load[:, self.joint] / (0.1e6 * self.cylinder.head_area)
        overrunning = np.tanh(np.maximum(load, 0.0))  # opens within a bar
        retracting = 0.5 * (1.0 - self.sign(block))
        speed = np.abs(block.v[:, self.joint]) / self.speed_scale()
        return -self.size * overrunning * retracting * (0.5 + 0.5 * speed)


class CrossCylinderCoupling(UndeclaredEffect):
    """A return line shared with the neighbour: its flow raises the back-pressure here."""

    id = "cross_cylinder_coupling"
    unit = "N"
    meaning = "force at a fast stroke of the neighbour"

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)
        self.exponent = rng.uniform(1.0, 2.0)  # laminar to turbulent line

    def piston_force(self, block: Block) -> FloatArray:
        speed = np.abs(block.v[:, self.other]) / self.speed_scale()
        return self.size * speed**self.exponent


class PositionHarmonic(UndeclaredEffect):
    """Chatter marks on rod or screw: a force periodic in position."""

    id = "position_harmonic"
    unit = "N"
    meaning = "amplitude"

    def prepare(self, rng: np.random.Generator) -> None:
        low, high = self.travel
        self.pitch = rng.uniform(0.08, 0.3) * (high - low)
        self.phase = rng.uniform(0, 2 * np.pi)

    def piston_force(self, block: Block) -> FloatArray:
        turn = 2 * np.pi * block.x[:, self.joint] / self.pitch + self.phase
        return self.size * (np.sin(turn) + 0.1 * np.sin(2 * turn))


class HoseStiffness(UndeclaredEffect):
    """A bundle of hoses over the joint that stiffens as it is bent away from its rest."""

    id = "hose_stiffness"
    unit = "N m"
    meaning = "effort at the far end of the joint's travel"
    needs_cylinder = False

    def prepare(self, rng: np.random.Generator) -> None:
        self.rest = rng.uniform(0.3, 0.7)  # fraction of the travel
        self.hardening = rng.uniform(1.2, 2.2)

    def joint_effort(self, block: Block) -> FloatArray:
        low, high = self.place.machine.joints[self.joint].limits.position
        bent = (block.q[:, self.joint] - low) / (high - low) - self.rest
        farthest = max(self.rest, 1.0 - self.rest)
        return self.size * np.sinh(self.hardening * bent / farthest) / math.sinh(self.hardening)


class ActuatorInertia(UndeclaredEffect):
    """A geared flywheel (pump drive, brake drum) that the joint's own motion turns."""

    id = "actuator_inertia"
    unit = "kg m^2"
    meaning = "inertia seen at the joint"
    needs_cylinder = False

    def joint_effort(self, block: Block) -> FloatArray:
        return self.size * block.qdd[:, self.joint]


class CarriedLiquid(UndeclaredEffect):
    """A half-full tank on the link: the liquid swings behind the link's tangential acceleration."""

    id = "carried_liquid"
    unit = "kg m^2"
    meaning = "swinging liquid's mass times its squared distance from the joint axis"
    needs_cylinder = False

    def prepare(self, rng: np.random.Generator) -> None:
        self.slosh = second_order(rng.uniform(0.5, 1.5), rng.uniform(0.03, 0.1), self.place.dt)

    def joint_effort(self, block: Block) -> FloatArray:
        # Relative to liquid that is frozen in place, only the swing's own part shows: I (filtered - rigid).
        followed = self.slosh(block.qdd[:, [self.joint]])[0][:, 0]
        return self.size * (followed - block.qdd[:, self.joint])


class StructuralFlexibility(UndeclaredEffect):
    """A link that bends: it lags its joint by effort over stiffness, with a mode of its own."""

    id = "structural_flexibility"
    unit = "rad/(N m)"
    meaning = "compliance of the link at its joint"
    needs_cylinder = False

    def prepare(self, rng: np.random.Generator) -> None:
        self.mode = second_order(rng.uniform(4.0, 9.0), rng.uniform(0.04, 0.1), self.place.dt)
        self.rest: float | None = None

    def deflection(self, effort: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        if self.rest is None:  # starts at rest under its load
            self.rest = float(effort[0])
        bend = self.mode((effort - self.rest)[:, None])
        angle, rate, acceleration = (self.size * part[:, 0] for part in bend)
        return angle + self.size * self.rest, rate, acceleration
