"""Travel of a joint: its range of motion, and piston and lever arm along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq.arrays import FloatArray
from daq.machine.joints import Joint
from daq.machine.linkages import Linkage

_POINTS = 401
_STEP = 1e-5  # rad or m: a central difference of a smooth law is right to 1e-9 with it


@dataclass(frozen=True)
class Travel:
    """A joint's motion within its limits.

    Attributes
    ----------
    joint : the joint
    q : (N,) joint positions from limit to limit, rad (m)
    x : (N,) piston positions, m; None without a cylinder
    r : (N,) lever arm ``dx/dq``, m/rad (1); None without a cylinder
    """

    joint: Joint
    q: FloatArray
    x: FloatArray | None
    r: FloatArray | None

    @property
    def revolute(self) -> bool:
        """True where the joint turns."""
        return self.joint.type == "revolute"

    def facts(self) -> dict[str, object]:
        """Return ranges for people: degrees or millimetres, from low to high."""
        factor, unit = (180.0 / np.pi, "deg") if self.revolute else (1e3, "mm")
        facts: dict[str, object] = {"joint": self.joint.name, f"motion_{unit}": _range(factor * self.q)}
        if self.x is not None and self.r is not None and self.joint.cylinder is not None:
            facts |= {"piston_mm": _range(1e3 * self.x), "stroke_mm": 1e3 * self.joint.cylinder.stroke}
            if self.revolute:
                facts["lever_arm_mm"] = _range(1e3 * self.r)
        return facts

    def text(self) -> str:
        """Return the same in words."""
        facts = self.facts()
        unit = "deg" if self.revolute else "mm"
        words = f"{self.joint.name}: {_words(facts[f'motion_{unit}'])} {unit}"
        if "piston_mm" in facts:
            words += f", piston at {_words(facts['piston_mm'])} of {facts['stroke_mm']:.4g} mm"
        if "lever_arm_mm" in facts:
            words += f", lever arm {_words(facts['lever_arm_mm'])} mm"
        return words


@dataclass(frozen=True)
class RodTravel:
    """A joint's motion by its cylinder.

    Attributes
    ----------
    joint : the joint
    range_q, range_x, lever : (N,) joint and piston positions from limit to limit, and the lever arm
    """

    joint: Joint
    range_q: FloatArray
    range_x: FloatArray
    lever: FloatArray

    @property
    def sense(self) -> float:
        """Sign of the joint's motion while the rod extends."""
        return float(np.sign(self.lever.mean()))

    def q(self, x: FloatArray | float) -> FloatArray:
        """Compute joint positions of piston positions, linear beyond the joint's limits."""
        order = slice(None, None, int(self.sense))
        inside = np.clip(x, self.range_x.min(), self.range_x.max())
        return np.asarray(np.interp(inside, self.range_x[order], self.range_q[order]) + (x - inside) / self.lever[0])

    def x(self, q: float) -> float:
        """Invert :meth:`q`."""
        return float(np.interp(q, self.range_q, self.range_x))

    @property
    def middle(self) -> float:
        """The joint position at which the rod is in the middle of what the joint's range asks of it."""
        return float(self.q(0.5 * (self.range_x.min() + self.range_x.max())))


def travel_of(joint: Joint) -> Travel:
    """Compute a joint's motion from limit to limit."""
    q = np.linspace(*joint.limits.position, _POINTS)
    if joint.cylinder is None:
        return Travel(joint, q, None, None)
    linkage = joint.cylinder.linkage
    return Travel(joint, q, linkage.piston_position(q), lever_arm(linkage, q))


def lever_arm(linkage: Linkage, q: FloatArray) -> FloatArray:
    """Compute the lever arm ``dx/dq`` at joint positions (N,), m/rad (1)."""
    return (linkage.piston_position(q + _STEP) - linkage.piston_position(q - _STEP)) / (2 * _STEP)


def _range(values: FloatArray) -> list[float]:
    return [float(values.min()), float(values.max())]


def _words(interval: object) -> str:
    low, high = interval  # type: ignore[misc]
    return f"{low:.4g} to {high:.4g}"  # type: ignore[has-type]
