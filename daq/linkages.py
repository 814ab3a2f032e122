"""Linkages between a joint and its cylinder, as a machine file declares them.

A linkage maps the joint position ``q`` (rad or m) to the piston position ``x`` (m, 0 = fully retracted).
Only the mapping itself lives here, because the machine file is checked with it and recordings are read with it;
lever arms (its derivatives) belong to the fitting side.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

FloatArray = npt.NDArray[np.float64]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ThreePin(_Model):
    """Cylinder between two pins, seen from the joint axis: the law of cosines.

    ``length^2 = a^2 + b^2 - 2 a b cos(q + offset)``; ``x = length - retracted``.
    """

    type: Literal["three_pin"]
    a: Annotated[float, Field(gt=0)]  # m, axis to the pin on the carrying link
    b: Annotated[float, Field(gt=0)]  # m, axis to the pin on the driven link
    offset: float  # rad
    retracted: Annotated[float, Field(gt=0)]  # m, pin to pin with the piston fully in

    def length(self, q: npt.ArrayLike) -> FloatArray:
        """Distance of the two pins in m at joint position ``q`` in rad."""
        q = np.asarray(q, dtype=float)
        squared = self.a**2 + self.b**2 - 2 * self.a * self.b * np.cos(q + self.offset)
        return np.asarray(np.sqrt(np.maximum(squared, 0.0)))

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Piston position ``x`` in m at joint position ``q`` in rad."""
        return self.length(q) - self.retracted


class Rack(_Model):
    """Rack and pinion: ``x = radius (q - zero)``."""

    type: Literal["rack"]
    radius: float  # m, may be negative
    zero: float = 0.0  # rad

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Piston position ``x`` in m at joint position ``q`` in rad."""
        return self.radius * (np.asarray(q, dtype=float) - self.zero)


class Direct(_Model):
    """The cylinder is the (prismatic) joint: ``x = q``."""

    type: Literal["direct"]

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Piston position ``x`` in m at joint position ``q`` in m."""
        return np.asarray(q, dtype=float).copy()


class Polynomial(_Model):
    """Any linkage as a polynomial over the joint's limits: ``x = sum c_k q^k``."""

    type: Literal["polynomial"]
    coefficients: Annotated[tuple[float, ...], Field(min_length=2)]  # m / rad^k

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Piston position ``x`` in m at joint position ``q`` in rad or m."""
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(q, dtype=float), self.coefficients))


Linkage = Annotated[ThreePin | Rack | Direct | Polynomial, Field(discriminator="type")]
