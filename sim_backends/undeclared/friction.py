"""Friction that the cylinder's five parameters do not describe."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim_backends.arrays import FloatArray
from sim_backends.plant.arm import ArmDesign
from sim_backends.undeclared.base import Block, UndeclaredEffect

REFERENCE_PRESSURE = 2.0e6  # Pa: sizes of load and pressure effects are quoted there


class LoadDependentFriction(UndeclaredEffect):
    """Guide bearings pressed by the load: friction proportional to the load, for large loads."""

    id = "load_dependent_friction"
    unit = "N"
    meaning = "friction force at a load of 2 MPa over the head area; none when unloaded"

    def piston_force(self, block: Block) -> FloatArray:
        reference = REFERENCE_PRESSURE * self.cylinder.head_area
        load = block.load[:, self.joint] / reference
        # The guide has play: very small loads do not press it on yet.
        return self.size * (np.hypot(load, 0.02) - 0.02) * self.sign(block)


class PressureDependentFriction(UndeclaredEffect):
    """Lip seals pressed on by their chambers: the rod seal by p2, the piston seal by the higher of both."""

    id = "pressure_dependent_friction"
    unit = "N"
    meaning = "friction force with both chambers at 2 MPa"
    feels_pressure = True

    def piston_force(self, block: Block) -> FloatArray:
        p1, p2 = block.p1[:, self.joint], block.p2[:, self.joint]
        contact = 0.6 * np.maximum(p1, p2) + 0.4 * p2
        return self.size * np.maximum(contact / REFERENCE_PRESSURE, 0.0) ** 0.95 * self.sign(block)


class AsymmetricFriction(UndeclaredEffect):
    """A wiper that drags when the wet rod comes out: more friction extending than retracting."""

    id = "asymmetric_friction"
    unit = "N"
    meaning = "additional friction while extending at a fast stroke; none while retracting"

    def prepare(self, rng: np.random.Generator) -> None:
        self.viscous = rng.uniform(0.0, 0.5)

    def piston_force(self, block: Block) -> FloatArray:
        v = block.v[:, self.joint]
        extending = 0.5 * (1.0 + self.sign(block))
        return self.size * extending * (1.0 - self.viscous + self.viscous * np.abs(v) / self.speed_scale())


class Stribeck(UndeclaredEffect):
    """Boundary lubrication: extra friction that a film takes away as speed builds up (Hess and Soom, 1990)."""

    id = "stribeck"
    unit = "N"
    meaning = "friction at breakaway above the Coulomb level"

    def prepare(self, rng: np.random.Generator) -> None:
        self.film_speed = rng.uniform(0.06, 0.2) * self.speed_scale()

    def piston_force(self, block: Block) -> FloatArray:
        v = block.v[:, self.joint]
        return self.size * self.sign(block) / (1.0 + (v / self.film_speed) ** 2)


class PreslidingHysteresis(UndeclaredEffect):
    """Seals that shear before they slide: after a reversal part of the friction builds up over distance.

    A stack of spring-slider elements (Maxwell slip model; Al-Bender, Lampaert and Swevers, 2005).
    """

    id = "presliding_hysteresis"
    unit = "N"
    meaning = "part of the Coulomb friction that builds up over distance after a reversal"

    def prepare(self, rng: np.random.Generator) -> None:
        self.distances = rng.uniform(0.3e-3, 1.2e-3) * np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0])
        self.slip = np.zeros(6)
        self.last_x: float | None = None

    def piston_force(self, block: Block) -> FloatArray:
        x = block.x[:, self.joint]
        steps = np.diff(x, prepend=x[0] if self.last_x is None else self.last_x)
        self.last_x = float(x[-1])
        mean, slip = np.empty_like(x), self.slip
        rates = 1.0 / self.distances
        for k, step in enumerate(steps):
            slip = np.minimum(np.maximum(slip + step * rates, -1.0), 1.0)
            mean[k] = slip.sum()
        self.slip = slip
        return self.size * (mean / len(slip) - self.sign(block))


class LubricantFilmLag(UndeclaredEffect):
    """The film between seal and rod needs time to build up and to be squeezed out (Yanada and Sekikawa, 2008)."""

    id = "lubricant_film_lag"
    unit = "N"
    meaning = "friction between no film and full film, released only as the film follows the speed"

    def prepare(self, rng: np.random.Generator) -> None:
        self.build_up = rng.uniform(0.1, 0.35)  # s
        self.half_speed = 0.3 * self.speed_scale()
        self.film: float | None = None

    def piston_force(self, block: Block) -> FloatArray:
        v = np.abs(block.v[:, self.joint])
        steady = v / (v + self.half_speed)
        film = np.empty_like(steady)
        h = float(steady[0]) if self.film is None else self.film
        # A film is squeezed out more slowly than it is dragged in.
        gain_in, gain_out = block.dt / self.build_up, block.dt / (1.5 * self.build_up)
        for k, target in enumerate(steady.tolist()):
            h += (gain_in if target > h else gain_out) * (target - h)
            film[k] = h
        self.film = h
        return -self.size * (film - steady) * self.sign(block)


class PositionDependentFriction(UndeclaredEffect):
    """A barrel that is not the same all along: tapered honing, or worn where the piston works most."""

    id = "position_dependent_friction"
    unit = "N"
    meaning = "change of friction between one end of the travel and the other (taper) or its middle (wear)"

    def prepare(self, rng: np.random.Generator) -> None:
        self.taper = rng.uniform() < 0.6
        self.curvature = rng.uniform(0.3, 2.0)
        self.centre, self.width = rng.uniform(0.35, 0.65), rng.uniform(0.35, 0.5)
        self.towards = rng.choice([-1.0, 1.0])

    def piston_force(self, block: Block) -> FloatArray:
        u = self.stroke_fraction(block)
        if self.taper:
            u = u if self.towards > 0 else 1.0 - u
            profile = np.expm1(self.curvature * u) / math.expm1(self.curvature)
        else:
            profile = 1.0 - np.exp(-np.square((u - self.centre) / self.width))
        return self.size * profile * self.sign(block)


class VelocityRootFriction(UndeclaredEffect):
    """Elastohydrodynamic seal contact: friction with the square root of speed."""

    id = "velocity_root_friction"
    unit = "N"
    meaning = "additional friction at a fast stroke"

    def piston_force(self, block: Block) -> FloatArray:
        v = np.abs(block.v[:, self.joint]) / self.speed_scale()
        return self.size * self.sign(block) * np.sqrt(v)


class ThermalViscosityDrift(UndeclaredEffect):
    """Oil that thins as it warms up: viscous friction falls with the oil's temperature."""

    id = "thermal_viscosity_drift"
    unit = "N s/m"
    meaning = "viscous friction that is there when cold and gone when warm"

    def prepare(self, rng: np.random.Generator) -> None:
        self.warm_up = rng.uniform(15.0, 45.0)  # s: a small tank without cooler
        self.sensitivity = rng.uniform(0.02, 0.05)  # 1/K, of mineral oil

    def redesign(self, design: ArmDesign) -> ArmDesign:
        if self.size == 0.0:
            return design
        oil = replace(design.truth.hydraulics, warm_up=self.warm_up)
        return replace(design, truth=replace(design.truth, hydraulics=oil))

    def piston_force(self, block: Block) -> FloatArray:
        oil = self.place.truth.hydraulics
        warm = math.exp(-self.sensitivity * oil.heating)
        thinned = (np.exp(-self.sensitivity * (block.temperature - oil.ambient)) - warm) / (1.0 - warm)
        return self.size * thinned * block.v[:, self.joint]


class PoseDependentFriction(UndeclaredEffect):
    """A joint bearing that the next arm section twists: friction of the joint depends on the neighbour's pose."""

    id = "pose_dependent_friction"
    unit = "N m"
    meaning = "joint friction between the ends of the neighbour's travel"
    needs_cylinder = False

    def prepare(self, rng: np.random.Generator) -> None:
        self.other = self.neighbour(rng)

    def joint_effort(self, block: Block) -> FloatArray:
        low, high = self.place.machine.joints[self.other].limits.position
        u = (block.q[:, self.other] - low) / (high - low)
        twist = np.sin(0.5 * np.pi * u) ** 2 - 0.5
        return self.size * twist * np.tanh(block.qd[:, self.joint] / 1.0e-3)
