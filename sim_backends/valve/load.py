"""Loads of the cylinders: equations of motion in closed form, for many machines side by side.

Two kinds of machine have them simple enough to be stepped thousands of times per second: parallel revolute axes (an
arm that folds in one plane, three-pin linkages), and prismatic axes (a gantry, cylinders along the joints). Arrays have
the machines last: (J, P), mass matrices (J, J, P).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from daq.errors import InputError
from daq.machine.linkages import Direct, ThreePin
from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.truth import LinkTruth

Plants = Sequence[tuple[Machine, Sequence[LinkTruth]]]


@dataclass(frozen=True)
class Pose:
    """A pose of all machines, ``M(q) q'' + h(q, q') = tau`` there.

    Attributes
    ----------
    mass : (J, J, P) mass matrices, without pistons
    bias : joint rates (J, P) to ``h`` (J, P): centrifugal, Coriolis and gravity efforts in N m or N
    x, lever, bend : (J, P) piston positions in m, ``r = dx/dq`` and ``dr/dq``
    """

    mass: FloatArray
    bias: Callable[[FloatArray], FloatArray]
    x: FloatArray
    lever: FloatArray
    bend: FloatArray


def load_of(plants: Plants) -> PlanarArm | Gantry:
    """Build the load of machines that all are of one kind.

    Raises
    ------
    InputError
        If a machine is neither an arm of parallel revolute axes nor a gantry, or machines of two kinds are mixed.
    """
    kinds = {_kind(machine) for machine, _ in plants}
    if len(kinds) > 1:
        raise InputError("sim_backends.machines_of_two_kinds")
    return PlanarArm(plants) if kinds == {"arm"} else Gantry(plants)


def _kind(machine: Machine) -> str:
    linkages = [None if joint.cylinder is None else joint.cylinder.linkage for joint in machine.joints]
    types = {joint.type for joint in machine.joints}
    if types == {"revolute"} and all(isinstance(own, ThreePin) for own in linkages):
        flat = all(joint.dh.alpha == 0.0 and joint.dh.d == 0.0 for joint in machine.joints)
        if flat and machine.convention == "standard" and machine.gravity[2] == 0.0:
            return "arm"
    elif types == {"prismatic"} and all(isinstance(own, Direct) for own in linkages):
        return "gantry"
    raise InputError("sim_backends.valves_not_simulated", machine=machine.name)


class PlanarArm:
    """Revolute axes along z: link ``i`` stands at ``phi_i = sum_{k <= i} (q_k + theta_k)`` in the plane.

    With ``u`` the unit vector of a link and ``n`` the one across, the centre of link i is
    ``sum_{k < i} a_k u_k + (a_i + c_i) u_i + d_i n_i`` (``c``, ``d``: centre from the distal frame). In the coordinates
    ``phi`` the mass matrix has the elements ``P_ij cos(phi_i - phi_j) + Q_ij sin(phi_i - phi_j)`` and the centrifugal
    terms follow from them (Lagrange); ``q`` comes in by the triangular matrix of ones.
    """

    def __init__(self, plants: Plants) -> None:
        count = len(plants[0][0].joints)
        shape = (count, len(plants))
        self._theta, self._gravity = np.empty(shape), np.empty((2, len(plants)))
        self._mx, self._my = np.zeros(shape), np.zeros(shape)  # kg m carried by the direction u_i, n_i
        self._p, self._q = np.zeros((count, *shape)), np.zeros((count, *shape))
        for p, (machine, links) in enumerate(plants):
            self._theta[:, p] = [joint.dh.theta for joint in machine.joints]
            self._gravity[:, p] = machine.gravity[:2]
            a = np.array([joint.dh.a for joint in machine.joints])
            m = np.array([link.mass for link in links])
            mx = np.array([link.moment[0] for link in links]) + m * a  # first moments about the proximal axis
            my = np.array([link.moment[1] for link in links])
            beyond = np.cumsum(m[::-1])[::-1] - m
            self._mx[:, p], self._my[:, p] = mx + beyond * a, my
            for i in range(count):
                # Steiner from the distal origin to the proximal one, along x: ZZ + 2 a MX + m a^2.
                zz = links[i].inertia[5] + 2 * a[i] * links[i].moment[0] + m[i] * a[i] ** 2
                self._p[i, i, p] = zz + beyond[i] * a[i] ** 2
                for j in range(i + 1, count):
                    self._p[i, j, p] = self._p[j, i, p] = a[i] * self._mx[j, p]
                    self._q[i, j, p], self._q[j, i, p] = a[i] * my[j], -a[i] * my[j]
        three_pin = [[joint.cylinder.linkage for joint in machine.joints] for machine, _ in plants]  # type: ignore[union-attr]
        get = lambda key: np.array([[getattr(own, key) for own in row] for row in three_pin]).T  # noqa: E731
        self._a, self._b, self._offset, self._retracted = map(get, ("a", "b", "offset", "retracted"))
        self._ab, self._squares = self._a * self._b, self._a**2 + self._b**2

    def pose(self, q: FloatArray) -> Pose:
        """Compute ``M = L' M_phi L``, ``L`` lower triangular ones: sums over links outside of both joints."""
        phi = np.cumsum(q + self._theta, axis=0)
        cos, sin = np.cos(phi), np.sin(phi)
        c = cos[:, None] * cos + sin[:, None] * sin  # of phi_i - phi_j
        s = sin[:, None] * cos - cos[:, None] * sin
        mass = _outward(_outward(self._p * c + self._q * s, 0), 1)
        slope = self._q * c - self._p * s  # S_ij = dM_ij / d(phi_i - phi_j)
        gx, gy = self._gravity
        # Torque of weight about z is (r x g)_z = x g_y - y g_x.
        weight = (self._mx * cos - self._my * sin) * gy - (self._mx * sin + self._my * cos) * gx

        def bias(qd: FloatArray) -> FloatArray:
            """Compute Lagrange's d/dt (M_ij phi_j') - dT/dphi_i, which is -S_ij phi_j'^2; weight helps the motion."""
            rate = np.cumsum(qd, axis=0)
            return _outward(-(slope * rate**2).sum(axis=1) - weight, 0)

        # l^2 = a^2 + b^2 - 2 a b cos(q + offset), x = l - retracted
        angle = q + self._offset
        across = self._ab * np.cos(angle)
        length = np.sqrt(self._squares - 2 * across)
        lever = self._ab * np.sin(angle) / length
        return Pose(mass, bias, length - self._retracted, lever, (across - lever**2) / length)

    def joint(self, x: FloatArray) -> FloatArray:
        """Invert the cosine law, on the branch of the offset."""
        length = x + self._retracted
        angle = np.arccos((self._squares - length**2) / (2 * self._ab))
        return np.asarray(np.sign(self._offset) * angle - self._offset)


class Gantry:
    """Prismatic axes: ``M_ij = z_i . z_j`` times the mass beyond both, gravity along each axis; pistons are joints."""

    def __init__(self, plants: Plants) -> None:
        count = len(plants[0][0].joints)
        self._mass = np.empty((count, count, len(plants)))
        self._weight = np.empty((count, len(plants)))
        for p, (machine, links) in enumerate(plants):
            axes = _axes(machine)
            beyond = np.cumsum([link.mass for link in links][::-1])[::-1]
            number = np.arange(count)
            self._mass[:, :, p] = axes @ axes.T * beyond[np.maximum(number[:, None], number)]
            self._weight[:, p] = axes @ np.asarray(machine.gravity) * beyond

    def pose(self, q: FloatArray) -> Pose:
        """Return the same mass wherever the axes are; weight along each."""
        return Pose(self._mass, lambda qd: -self._weight, q, np.ones_like(q), np.zeros_like(q))

    def joint(self, x: FloatArray) -> FloatArray:
        """Return ``q = x``."""
        return x


def _axes(machine: Machine) -> FloatArray:
    """Compute directions (J, 3) of the prismatic axes in the base: rotations only, both row conventions."""
    rotation, axes = np.eye(3), []
    for joint in machine.joints:
        ct, st = np.cos(joint.dh.theta), np.sin(joint.dh.theta)
        ca, sa = np.cos(joint.dh.alpha), np.sin(joint.dh.alpha)
        about_z = np.array([[ct, -st, 0.0], [st, ct, 0.0], [0.0, 0.0, 1.0]])
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]])
        if machine.convention == "modified":
            rotation = rotation @ about_x
            axes.append(rotation[:, 2])
            rotation = rotation @ about_z
        else:
            axes.append(rotation[:, 2])
            rotation = rotation @ about_z @ about_x
    return np.array(axes)


def _outward(values: FloatArray, axis: int) -> FloatArray:
    """Sum from each joint to the tip."""
    reverse = (slice(None),) * axis + (slice(None, None, -1),)
    return np.asarray(np.cumsum(values[reverse], axis=axis)[reverse])
