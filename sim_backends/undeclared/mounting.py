"""An arm that is not built, standing or loaded as its machine file says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_backends.plant.arm import ArmDesign
from sim_backends.undeclared.base import UndeclaredEffect


class LinkageGeometry(UndeclaredEffect):
    """A pin that sits elsewhere than the drawing says."""

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
