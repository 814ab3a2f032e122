"""Transducers and mountings that read something else than is there; arms not built or loaded as declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_backends.arrays import FloatArray
from sim_backends.plant.arm import ArmDesign
from sim_backends.undeclared.base import Block, Readings, UndeclaredEffect


class SupplyRipple(UndeclaredEffect):
    """Pump pulsation on the head side: one spectral line that no motion explains."""

    id = "supply_ripple"
    unit = "Pa"
    meaning = "amplitude on the head pressure (and on the supply pressure)"

    def prepare(self, rng: np.random.Generator) -> None:
        # Shaft speed or piston passages: also above half a usual sampling rate, where it is folded.
        self.frequency = float(np.exp(rng.uniform(np.log(1.2), np.log(45.0))))
        self.phase = rng.uniform(0, 2 * np.pi)

    def sense(self, block: Block, readings: Readings) -> None:
        wave = self.size * np.sin(2 * np.pi * self.frequency * block.time + self.phase)
        readings.head_pressure[:, self.joint] += wave
        readings.supply_pressure += 1.5 * wave


class PressureOffset(UndeclaredEffect):
    """A transducer whose zero has shifted."""

    id = "pressure_offset"
    unit = "Pa"
    meaning = "offset of the head pressure"

    def sense(self, block: Block, readings: Readings) -> None:
        readings.head_pressure[:, self.joint] += self.size


class PressureGain(UndeclaredEffect):
    """A transducer whose span is wrong, in one chamber only."""

    id = "pressure_gain"
    unit = "1"
    meaning = "relative error of the span of the rod pressure (or head pressure)"

    def prepare(self, rng: np.random.Generator) -> None:
        self.rod_side = rng.uniform() < 0.5

    def sense(self, block: Block, readings: Readings) -> None:
        pressure = readings.rod_pressure if self.rod_side else readings.head_pressure
        pressure[:, self.joint] *= 1.0 + self.size


class PressureDrift(UndeclaredEffect):
    """A transducer's zero that creeps while its body warms up."""

    id = "pressure_drift"
    unit = "Pa"
    meaning = "shift of the head pressure within the first minute"

    def prepare(self, rng: np.random.Generator) -> None:
        self.settling = rng.uniform(60.0, 200.0)  # s

    def sense(self, block: Block, readings: Readings) -> None:
        crept = np.expm1(-np.maximum(block.time, 0.0) / self.settling) / np.expm1(-60.0 / self.settling)
        readings.head_pressure[:, self.joint] += self.size * crept


class SensorLatency(UndeclaredEffect):
    """Both pressures of a joint arrive late: a filter stage in the transducer or a slow gateway."""

    id = "sensor_latency"
    unit = "s"
    meaning = "delay of both pressures"

    def prepare(self, rng: np.random.Generator) -> None:
        self.past: dict[str, FloatArray] = {}

    def sense(self, block: Block, readings: Readings) -> None:
        steps = max(self.size, 0.0) / block.dt
        depth = int(steps) + 2
        for name in ("head_pressure", "rod_pressure"):
            pressure = getattr(readings, name)
            now = pressure[:, self.joint].copy()
            line = np.concatenate([self.past.get(name, np.full(depth, now[0])), now])
            where = depth + np.arange(len(now)) - steps
            pressure[:, self.joint] = np.interp(where, np.arange(len(line)), line)
            self.past[name] = line[-depth:]


class EncoderOffset(UndeclaredEffect):
    """A joint encoder that was mounted turned."""

    id = "encoder_offset"
    unit = "rad"
    meaning = "reading minus truth"
    needs_cylinder = False

    def sense(self, block: Block, readings: Readings) -> None:
        readings.joint_position[:, self.joint] += self.size


class EncoderEccentricity(UndeclaredEffect):
    """An encoder disc off its axis: the reading head sees the angle from a displaced centre."""

    id = "encoder_eccentricity"
    unit = "rad"
    meaning = "eccentricity over radius: amplitude of the reading's error over a turn"
    needs_cylinder = False
    needs_rotation = True

    def prepare(self, rng: np.random.Generator) -> None:
        self.bearing = rng.uniform(0, 2 * np.pi)
        self.lobes = int(rng.integers(1, 4))  # 1: off centre; 2, 3: clamped out of round

    def sense(self, block: Block, readings: Readings) -> None:
        angle = self.lobes * block.q[:, self.joint] + self.bearing
        reading = np.arctan2(self.size * np.sin(angle), 1.0 + self.size * np.cos(angle))
        # Only what changes over the travel is a defect: the mounting was zeroed at q = 0.
        zero = np.arctan2(self.size * np.sin(self.bearing), 1.0 + self.size * np.cos(self.bearing))
        readings.joint_position[:, self.joint] += reading - zero


class Backlash(UndeclaredEffect):
    """Worn pins: the piston leads the joint by half the play, on the side where the load pushes."""

    id = "backlash"
    unit = "m"
    meaning = "play between piston and link, measured along the cylinder"

    def prepare(self, rng: np.random.Generator) -> None:
        self.crossing = rng.uniform(0.02, 0.06)  # s to travel through the play
        self.side: float | None = None

    def sense(self, block: Block, readings: Readings) -> None:
        if not block.pinned:
            return
        pushing = np.where(block.load[:, self.joint] >= 0.0, 1.0, -1.0)
        side = float(pushing[0]) if self.side is None else self.side
        limit = 2.0 * block.dt / self.crossing
        sides = np.empty_like(pushing)
        for k, target in enumerate(pushing.tolist()):
            side += min(max(target - side, -limit), limit)
            sides[k] = side
        self.side = side
        readings.piston_position[:, self.joint] += 0.5 * self.size * sides


class LinkageGeometry(UndeclaredEffect):
    """A pin that sits elsewhere than on the drawing."""

    id = "linkage_geometry"
    unit = "m"
    meaning = "radial displacement of the pin on the driven link"
    needs_three_pin = True

    def redesign(self, design: ArmDesign) -> ArmDesign:
        return replace(design, pin_b={**design.pin_b, self.joint_name: self.size})


class BaseTilt(UndeclaredEffect):
    """A machine that stands on a slope: gravity is turned for all joints at once."""

    id = "base_tilt"
    unit = "rad"
    meaning = "angle of the tilt about a horizontal axis"
    base_wide = True
    needs_cylinder = False

    def prepare(self, rng: np.random.Generator) -> None:
        gravity = np.asarray(self.place.machine.gravity)
        down = gravity / max(float(np.linalg.norm(gravity)), 1e-9)
        across = np.linalg.svd(down[None, :])[2][1:]  # two horizontal axes
        bearing = rng.uniform(0, 2 * np.pi)
        self.axis = np.cos(bearing) * across[0] + np.sin(bearing) * across[1]

    def redesign(self, design: ArmDesign) -> ArmDesign:
        x, y, z = (float(v) for v in self.size * self.axis)
        return replace(design, tilt=(x, y, z))


class Payload(UndeclaredEffect):
    """The arm picks something up in the middle of each motion."""

    id = "payload"
    unit = "kg"
    meaning = "mass at the tip, from a moment 15 to 35 s into each motion"
    base_wide = True
    needs_cylinder = False

    def prepare(self, rng: np.random.Generator) -> None:
        self.moment = rng.uniform(15.0, 35.0)

    def redesign(self, design: ArmDesign) -> ArmDesign:
        return replace(design, payload=max(self.size, 0.0), payload_from=self.moment)
