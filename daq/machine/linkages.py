"""Linkages between a joint and its cylinder, as a machine file declares them.

A linkage maps the joint position ``q`` (rad or m) to the piston position ``x`` (m, 0 = fully retracted).
Only the mapping itself lives here, because the machine file is checked with it and recordings are read with it;
lever arms (its derivatives) belong to the fitting side.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from daq.arrays import FloatArray
from daq.errors import BadValueError
from daq.machine.buses import FileModel

Point = tuple[float, float]  # m, in the plane that the joint's axis is perpendicular to
Length = Annotated[float, Field(gt=0)]  # m


class ThreePin(FileModel):
    """Cylinder between two pins, seen from the joint axis: the law of cosines.

    ``length^2 = a^2 + b^2 - 2 a b cos(q + offset)``; ``x = length - retracted``.
    """

    type: Literal["three_pin"]
    a: Annotated[float, Field(gt=0)]  # m, axis to the pin on the carrying link
    b: Annotated[float, Field(gt=0)]  # m, axis to the pin on the driven link
    offset: float  # rad
    retracted: Annotated[float, Field(gt=0)]  # m, pin to pin with the piston fully in

    def length(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the distance of the two pins in m at joint position ``q`` in rad."""
        q = np.asanyarray(q) * 1.0  # expressions stay what they are
        squared = self.a**2 + self.b**2 - 2 * self.a * self.b * np.cos(q + self.offset)
        return np.asarray(np.sqrt(np.maximum(squared, 0.0)))

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the piston position ``x`` in m at joint position ``q`` in rad."""
        return self.length(q) - self.retracted


class Rack(FileModel):
    """Rack and pinion: ``x = radius (q - zero)``."""

    type: Literal["rack"]
    radius: float  # m, may be negative
    zero: float = 0.0  # rad

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the piston position ``x`` in m at joint position ``q`` in rad."""
        return np.asarray(self.radius * (np.asanyarray(q) * 1.0 - self.zero))


class Direct(FileModel):
    """The cylinder is the (prismatic) joint: ``x = q``."""

    type: Literal["direct"]

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the piston position ``x`` in m at joint position ``q`` in m."""
        return np.asarray(np.asanyarray(q) * 1.0)


class Polynomial(FileModel):
    """Any linkage as a polynomial over the joint's limits: ``x = sum c_k q^k``."""

    type: Literal["polynomial"]
    coefficients: Annotated[tuple[float, ...], Field(min_length=2)]  # m / rad^k

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the piston position ``x`` in m at joint position ``q`` in rad or m."""
        return np.asarray(np.polynomial.polynomial.polyval(np.asanyarray(q) * 1.0, self.coefficients))


class Pins(FileModel):
    """Cylinder between two pins whose coordinates were measured: a three-pin linkage in other words.

    All points lie in the plane that the joint's axis is perpendicular to, drawn so that positive joint positions turn
    counter-clockwise. ``base_pin`` and ``base_pivot`` are measured on the parent link from any origin there,
    ``rod_pin`` and ``link_pivot`` on the moving link from any origin there; both pivots are the joint's axis.
    ``angle`` is how far the moving link's x axis is turned from the parent's at ``q = 0``.
    """

    type: Literal["pins"]
    base_pin: Point  # on the parent: where the cylinder is held
    base_pivot: Point  # on the parent: the joint's axis
    rod_pin: Point  # on the moving link: where the rod pulls
    link_pivot: Point  # on the moving link: the joint's axis
    retracted: Length  # m, pin to pin with the piston fully in
    angle: float | None = None  # rad; left out: the joint's dh.theta, which is right for the table's own frames

    @model_validator(mode="after")
    def _apart(self) -> Pins:
        _apart("base_pin", self.base_pin, "base_pivot", self.base_pivot)
        _apart("rod_pin", self.rod_pin, "link_pivot", self.link_pivot)
        return self

    @property
    def three_pin(self) -> ThreePin:
        """The same linkage by its lengths: ``offset`` is the angle from the base pin to the rod pin at ``q = 0``."""
        a, bearing_a = _polar(self.base_pin, self.base_pivot)
        b, bearing_b = _polar(self.rod_pin, self.link_pivot)
        offset = (self.angle or 0.0) + bearing_b - bearing_a
        return ThreePin(type="three_pin", a=a, b=b, offset=offset, retracted=self.retracted)

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the piston position ``x`` in m at joint position ``q`` in rad."""
        return self.three_pin.piston_position(q)


class FourBar(FileModel):
    """Cylinder on a rocker, from which a coupler drives the link: a bucket's linkage.

    Points, plane and ``angle`` as in :class:`Pins`. The rocker turns about ``rocker_pivot`` on the parent. One of its
    arms, ``coupler_arm`` long, holds the coupler, whose other end is ``coupler_pin`` on the moving link; the other,
    ``rod_arm`` long and turned from it by ``arms_angle``, holds the rod. Two positions of the rocker close the chain:
    its coupler arm stands to the ``left`` or to the ``right`` of the line from the rocker's pivot to the coupler's pin
    on the link.
    """

    type: Literal["four_bar"]
    base_pin: Point  # on the parent: where the cylinder is held
    base_pivot: Point  # on the parent: the joint's axis
    rocker_pivot: Point  # on the parent: where the rocker turns
    coupler_pin: Point  # on the moving link: where the coupler holds it
    link_pivot: Point  # on the moving link: the joint's axis
    rod_arm: Length  # m, rocker's pivot to the rod's pin
    coupler_arm: Length  # m, rocker's pivot to the coupler's pin
    arms_angle: float = 0.0  # rad, counter-clockwise from the coupler arm to the rod arm; 0 with equal arms: one pin
    coupler: Length  # m, pin to pin
    side: Literal["left", "right"]
    retracted: Length  # m, pin to pin with the piston fully in
    angle: float | None = None  # rad; left out: the joint's dh.theta

    @model_validator(mode="after")
    def _apart(self) -> FourBar:
        _apart("base_pin", self.base_pin, "rocker_pivot", self.rocker_pivot)
        _apart("coupler_pin", self.coupler_pin, "link_pivot", self.link_pivot)
        return self

    @property
    def at_rocker(self) -> ThreePin:
        """The cylinder's three pins about the rocker's pivot; its ``q`` is the coupler arm's direction."""
        a, bearing = _polar(self.base_pin, self.rocker_pivot)
        return ThreePin(
            type="three_pin", a=a, b=self.rod_arm, offset=self.arms_angle - bearing, retracted=self.retracted
        )

    def link_pin(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Compute the coupler's pin on the moving link, from rocker's pivot and joint's axis, (..., 2) each, m."""
        theta = np.asarray(q, dtype=float) + (self.angle or 0.0)
        x, y = np.subtract(self.coupler_pin, self.link_pivot)
        arm = np.stack([x * np.cos(theta) - y * np.sin(theta), x * np.sin(theta) + y * np.cos(theta)], axis=-1)
        return np.subtract(self.base_pivot, self.rocker_pivot) + arm, arm

    def closing_cosine(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the cosine of coupler arm against the line to the link's pin; beyond 1 nothing closes."""
        g = np.linalg.norm(self.link_pin(q)[0], axis=-1)
        k, c = self.coupler_arm, self.coupler
        return np.asarray((k**2 + g**2 - c**2) / (2 * k * np.maximum(g, 1e-12)))

    def rocker(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the coupler arm's direction in the parent's plane, rad; where nothing closes, the nearest."""
        reach = self.link_pin(q)[0]
        opening = np.arccos(np.clip(self.closing_cosine(q), -1.0, 1.0))
        bearing = np.arctan2(reach[..., 1], reach[..., 0])
        return np.asarray(bearing + (opening if self.side == "left" else -opening))

    def piston_position(self, q: npt.ArrayLike) -> FloatArray:
        """Compute the piston position ``x`` in m at joint position ``q`` in rad."""
        return self.at_rocker.piston_position(self.rocker(q))


def _polar(point: Point, origin: Point) -> tuple[float, float]:
    """Compute a point's distance in m and bearing in rad from another."""
    x, y = point[0] - origin[0], point[1] - origin[1]
    return float(np.hypot(x, y)), float(np.arctan2(y, x))


def _apart(first: str, a: Point, second: str, b: Point) -> None:
    if a == b:
        raise BadValueError("daq.same_point", at=(first,), first=first, second=second, first_2=a[0], first_3=a[1])


def reduced(linkage: Linkage) -> ThreePin | Rack | Direct | Polynomial | FourBar:
    """Turn the pins' coordinates of a linkage into lengths; any other is as it is."""
    return linkage.three_pin if isinstance(linkage, Pins) else linkage


Linkage = Annotated[ThreePin | Pins | FourBar | Rack | Direct | Polynomial, Field(discriminator="type")]
