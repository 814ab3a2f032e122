"""Geometry of the arm: Denavit-Hartenberg table, gravity, and where the links are.

Standard (distal) convention: ``A_i = Rz(theta) Tz(d) Tx(a) Rx(alpha)`` takes frame ``i`` to frame ``i - 1``;
frame ``i`` is fixed to link ``i``, at its far end; joint ``i`` turns about, or slides along, ``z`` of frame
``i - 1``. Modified (proximal) convention: ``A_i = Rx(alpha) Tx(a) Rz(theta) Tz(d)``; frame ``i`` is fixed to link ``i``
at joint ``i``, which turns about, or slides along, ``z`` of frame ``i`` itself. The joint variable adds to ``theta``
(revolute) or to ``d`` (prismatic) in both.

Sources: Denavit and Hartenberg 1955; Siciliano et al., *Robotics: Modelling, Planning and Control*, 2.8.2; modified:
Craig, *Introduction to Robotics*, 3.4; Khalil and Kleinfinger 1986.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from fitting.arrays import BoolArray, FloatArray

# cos(pi/2) is 6e-17 in floating point. A zero there is what lets the regressor skip work.
_ROUND_OFF = 1e-15
#: rad by which a twist angle may miss a multiple of 90 degrees and still mean it.
_SQUARE = 5e-4


@dataclass(frozen=True)
class Geometry:
    """Geometry of an arm of ``n`` joints, as the dynamics need it.

    Attributes
    ----------
    revolute : shape (n,), True for a revolute and False for a prismatic joint
    a, alpha, d, theta : shape (n,), the constant part of the table, in m and rad
    gravity : shape (3,), acceleration of gravity in the base frame, m/s^2
    position_limits : shape (n, 2), rad or m
    velocity_limits, acceleration_limits : shape (n,), rad/s or m/s, and per second more
    names : joint names
    coupled : numbers of the joints whose motor turns with other joints too, ``c`` of them
    coupling : shape (c, n), speed of each such motor, referred to its own joint, per unit of every joint's speed: 1 at
        the own joint
    """

    revolute: BoolArray
    a: FloatArray
    alpha: FloatArray
    d: FloatArray
    theta: FloatArray
    gravity: FloatArray
    position_limits: FloatArray
    velocity_limits: FloatArray
    acceleration_limits: FloatArray
    names: tuple[str, ...]
    coupled: tuple[int, ...] = ()
    coupling: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    modified: bool = False
    link_side: tuple[int, ...] = ()

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.names)

    @property
    def sin_alpha(self) -> FloatArray:
        """Sines of the twist angles, zeros exact."""
        return _clean(np.sin(self.alpha))

    @property
    def cos_alpha(self) -> FloatArray:
        """Cosines of the twist angles, zeros exact."""
        return _clean(np.cos(self.alpha))

    @property
    def axes(self) -> FloatArray:
        """Direction of every joint's axis in its own link's frame, (n, 3)."""
        if self.modified:
            return np.tile([0.0, 0.0, 1.0], (self.joints, 1))
        return np.stack([np.zeros(self.joints), self.sin_alpha, self.cos_alpha], axis=1)

    @property
    def stretches(self) -> tuple[tuple[tuple[FloatArray, FloatArray], ...], ...]:
        """Place of every link's material: the ends (3,), (3,) of each of its stretches, in its own frame, m.

        A link reaches from its own joint to the next. Along a sliding joint, at the middle of its travel, both links
        that it joins reach: what slides, and what guides it. The table does not show where the last link of a modified
        one ends: where it begins.
        """
        slides = ~self.revolute
        reach = self.d + np.where(slides, self.position_limits.mean(axis=1), 0.0)
        own = np.stack([self.a, reach * self.sin_alpha, reach * self.cos_alpha], axis=1)
        along, corner = np.outer(reach, [0.0, 0.0, 1.0]), np.outer(self.a, [1.0, 0.0, 0.0])
        far = own * [1.0, -1.0, 1.0]  # Rx(alpha) Tz(d) of a modified row, seen from the frame before
        origin, found = np.zeros(3), []
        for link, after in enumerate(range(1, self.joints + 1)):
            guides = after < self.joints and bool(slides[after])
            if self.modified:
                path = [-along[link], origin] if slides[link] else [origin]
                path += [corner[after]] if guides else []
                path.append(far[after] if after < self.joints else origin)
            else:
                path = [-own[link], -corner[link], origin] if slides[link] else [-own[link], origin]
                path += [along[after]] if guides else []
            found.append(tuple(pairwise(path)))
        return tuple(found)

    def uncoupled(self) -> Geometry:
        """Return the same arm with every motor on its own joint only."""
        return replace(self, coupled=(), coupling=np.zeros((0, self.joints)))

    def squared_up(self) -> Geometry:
        """Make twist angles within :data:`_SQUARE` of a multiple of 90 degrees exact.

        Files hold 1.5708 where they mean pi/2. The 4e-6 rad between the two make parameters formally
        identifiable that no measurement will determine; counting is done on the arm that was meant.
        """
        quarter = np.round(self.alpha / (np.pi / 2)) * (np.pi / 2)
        return replace(self, alpha=np.where(np.abs(self.alpha - quarter) <= _SQUARE, quarter, self.alpha))


def _clean(values: FloatArray) -> FloatArray:
    return np.where(np.abs(values) < _ROUND_OFF, 0.0, values)


def geometry_of(machine: Machine | Geometry) -> Geometry:
    """Return the geometry of a machine file (or a :class:`Geometry` as it is)."""
    if isinstance(machine, Geometry):
        return machine
    joints = machine.joints
    ratios = machine.ratios
    link_side = tuple(i for i, j in enumerate(joints) if j.drive is not None and j.drive.effort == "link_side")
    coupled = tuple(
        i
        for i, joint in enumerate(joints)
        if joint.drive is not None and joint.drive.coupled and set(np.flatnonzero(ratios[i])) - set(link_side)
    )
    return Geometry(
        revolute=np.array([joint.type == "revolute" for joint in joints]),
        a=np.array([joint.dh.a for joint in joints]),
        alpha=np.array([joint.dh.alpha for joint in joints]),
        d=np.array([joint.dh.d for joint in joints]),
        theta=np.array([joint.dh.theta for joint in joints]),
        gravity=np.array(machine.gravity, dtype=float),
        position_limits=np.array([joint.limits.position for joint in joints], dtype=float),
        velocity_limits=np.array([joint.limits.velocity for joint in joints]),
        acceleration_limits=np.array([joint.limits.acceleration for joint in joints]),
        names=tuple(joint.name for joint in joints),
        coupled=coupled,
        coupling=np.array([ratios[i] / ratios[i, i] for i in coupled]).reshape(-1, len(joints)),
        modified=machine.convention == "modified",
        link_side=link_side,
    )


def link_frames(machine: Machine | Geometry, q: npt.ArrayLike) -> FloatArray:
    """Compute the poses of the base and of all link frames.

    Parameters
    ----------
    machine : arm of ``n`` joints
    q : joint positions, shape (..., n), rad or m

    Returns
    -------
    ndarray
        Homogeneous transforms to the base frame, shape (..., n + 1, 4, 4); entry 0 is the base itself. The
        axis of joint ``i`` (counted from 1) is the z axis of entry ``i - 1``, of entry ``i`` in the modified
        convention.
    """
    geometry = geometry_of(machine)
    q = np.asarray(q, dtype=float)
    if q.ndim == 0 or q.shape[-1] != geometry.joints:
        raise ValueError(f"q has shape {q.shape}; its last axis must hold the {geometry.joints} joints")
    frames = np.zeros((*q.shape[:-1], geometry.joints + 1, 4, 4))
    frames[..., 0, :, :] = np.eye(4)
    for i in range(geometry.joints):
        theta = geometry.theta[i] + (q[..., i] if geometry.revolute[i] else 0.0)
        d = geometry.d[i] + (0.0 if geometry.revolute[i] else q[..., i])
        ct, st, ca, sa = np.cos(theta), np.sin(theta), geometry.cos_alpha[i], geometry.sin_alpha[i]
        step = np.zeros((*q.shape[:-1], 4, 4))
        step[..., 3, 3] = 1.0
        if geometry.modified:
            step[..., 0, :3] = np.stack([ct, -st, np.zeros_like(ct)], axis=-1)
            step[..., 1, :3] = np.stack([st * ca, ct * ca, np.full_like(ct, -sa)], axis=-1)
            step[..., 2, :3] = np.stack([st * sa, ct * sa, np.full_like(ct, ca)], axis=-1)
            step[..., 0, 3], step[..., 1, 3], step[..., 2, 3] = geometry.a[i], -sa * d, ca * d
        else:
            step[..., 0, :3] = np.stack([ct, -st * ca, st * sa], axis=-1)
            step[..., 1, :3] = np.stack([st, ct * ca, -ct * sa], axis=-1)
            step[..., 2, 1], step[..., 2, 2], step[..., 2, 3] = sa, ca, d
            step[..., 0, 3], step[..., 1, 3] = geometry.a[i] * ct, geometry.a[i] * st
        frames[..., i + 1, :, :] = frames[..., i, :, :] @ step
    return frames
