"""The arm as a MuJoCo model: links from the Denavit-Hartenberg table, cylinders as tendons between their pins.

Body ``i`` sits where joint ``i`` turns it: frame ``i-1`` followed by ``Rz(theta)`` (and ``Tz(d)`` of a prismatic
joint). Its tail ``Tz(d) Tx(a) Rx(alpha)`` carries the next body. In the modified convention ``Rx(alpha) Tx(a)`` stands
before the joint, and there is no tail: frame ``i`` is the body's own. A three-pin cylinder is a spatial tendon from a
site on the carrying body to a site on the driven one, so its length and lever arm come from geometry; its moving
mass is the tendon's armature. Racks and direct cylinders are fixed tendons. All other linkages have no tendon: their
laws are evaluated as the machine file has them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

import mujoco
import numpy as np
import numpy.typing as npt
import scipy

from daq.machine.linkages import Direct, Rack, ThreePin, reduced
from daq.machine.machine_file import Joint, Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.truth import LinkTruth, Truth

_WITH_TENDON = (ThreePin, Rack, Direct)
GRID = 400  # cells over a joint's range: 1e-12 m off the geometry
PIN_BEARING = 0.4  # rad: where around the axis the carrying pin sits; the law depends on the difference only


@dataclass(frozen=True)
class ArmDesign:
    """Description of the arm. Undeclared effects replace parts of it, so that machine file and plant differ.

    ``pin_b`` are radial displacements of driven pins in m; ``tilt`` is the rotation vector in rad by which
    the base really stands turned; ``payload`` is a point mass in kg at the tip that the arm carries from
    ``payload_from`` s into each motion.
    """

    machine: Machine
    truth: Truth
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pin_b: dict[str, float] = field(default_factory=dict)
    payload: float = 0.0
    payload_from: float = 0.0

    @property
    def gravity(self) -> FloatArray:
        """Gravity in the coordinates of the base as mounted, m/s^2."""
        return scipy.spatial.transform.Rotation.from_rotvec(self.tilt).inv().apply(np.asarray(self.machine.gravity))


def _numbers(values: npt.ArrayLike) -> str:
    return " ".join(repr(float(v)) for v in np.asarray(values, dtype=float).ravel())


def _rotation_z(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rotation_x(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _quaternion(rotation: FloatArray) -> FloatArray:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    return quaternion


def _tensor(values: tuple[float, ...]) -> FloatArray:
    xx, xy, xz, yy, yz, zz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _inertial(body: ET.Element, link: LinkTruth, tail_position: FloatArray, tail: FloatArray) -> None:
    """Add mass, centre, central tensor in body coordinates, from the tensor about the distal origin."""
    centre = np.asarray(link.moment) / link.mass
    central = _tensor(link.inertia) - link.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    rotated = tail @ central @ tail.T
    full = [rotated[0, 0], rotated[1, 1], rotated[2, 2], rotated[0, 1], rotated[0, 2], rotated[1, 2]]
    ET.SubElement(
        body,
        "inertial",
        mass=repr(float(link.mass)),
        pos=_numbers(tail_position + tail @ centre),
        fullinertia=_numbers(full),
    )


def _tendon(tendons: ET.Element, joint: Joint, carrying: ET.Element, driven: ET.Element, design: ArmDesign,
            head_position: FloatArray, head: FloatArray) -> None:  # fmt: skip
    """Add the cylinder's tendon; ``head`` is the pose of the driven body at ``q = 0`` in the carrying body."""
    cylinder = joint.cylinder
    if cylinder is None or not isinstance(reduced(cylinder.linkage), _WITH_TENDON):
        return
    armature = repr(design.truth.cylinders[joint.name].m)
    linkage = reduced(cylinder.linkage)
    if isinstance(linkage, ThreePin):
        a, b = linkage.a, linkage.b + design.pin_b.get(joint.name, 0.0)
        bearing = PIN_BEARING
        pin_a = head_position + head @ np.array([a * np.cos(bearing), a * np.sin(bearing), 0.0])
        bearing += linkage.offset
        pin_b = np.array([b * np.cos(bearing), b * np.sin(bearing), 0.0])
        ET.SubElement(carrying, "site", name=f"{joint.name}.a", pos=_numbers(pin_a))
        ET.SubElement(driven, "site", name=f"{joint.name}.b", pos=_numbers(pin_b))
        tendon = ET.SubElement(tendons, "spatial", name=joint.name, armature=armature)
        ET.SubElement(tendon, "site", site=f"{joint.name}.a")
        ET.SubElement(tendon, "site", site=f"{joint.name}.b")
    else:
        tendon = ET.SubElement(tendons, "fixed", name=joint.name, armature=armature)
        coefficient = linkage.radius if isinstance(linkage, Rack) else 1.0
        ET.SubElement(tendon, "joint", joint=joint.name, coef=repr(float(coefficient)))


def arm_xml(design: ArmDesign, payload: float = 0.0) -> str:
    """Write the MuJoCo model (MJCF) of the arm, with ``payload`` kg at its tip."""
    machine = design.machine
    root = ET.Element("mujoco", model=machine.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="false", balanceinertia="false")
    option = ET.SubElement(root, "option", gravity=_numbers(design.gravity), timestep="0.001")
    unused = ("contact", "constraint", "limit", "equality", "frictionloss", "sensor", "actuation")
    ET.SubElement(option, "flag", dict.fromkeys(unused, "disable"))
    body = ET.SubElement(root, "worldbody")
    tendons = ET.SubElement(root, "tendon")
    tail_position, tail = np.zeros(3), np.eye(3)
    for joint, link in zip(machine.joints, design.truth.links, strict=True):
        dh = joint.dh
        prismatic = joint.type == "prismatic"
        modified = machine.convention == "modified"
        if modified:
            tail_position, tail = np.array([dh.a, 0.0, 0.0]), _rotation_x(dh.alpha)
        head = tail @ _rotation_z(dh.theta)
        head_position = tail_position + (tail @ np.array([0.0, 0.0, dh.d]) if prismatic or modified else 0.0)
        driven = ET.SubElement(
            body, "body", name=joint.name, pos=_numbers(head_position), quat=_numbers(_quaternion(head))
        )
        kind = "slide" if prismatic else "hinge"
        drive = design.truth.drives.get(joint.name)
        element = ET.SubElement(driven, "joint", name=joint.name, type=kind, axis="0 0 1")
        if drive is not None:
            element.set("armature", repr(drive.inertia))
        tail_position, tail = np.zeros(3), np.eye(3)
        if not modified:
            tail_position, tail = np.array([dh.a, 0.0, 0.0 if prismatic else dh.d]), _rotation_x(dh.alpha)
        _inertial(driven, link, tail_position, tail)
        _tendon(tendons, joint, body, driven, design, head_position, head)
        body = driven
    if payload > 0.0:
        tip = ET.SubElement(body, "body", name="payload", pos=_numbers(tail_position))
        tiny = payload * 1e-6  # a point mass as far as any joint can tell
        ET.SubElement(tip, "inertial", mass=repr(payload), pos="0 0 0", diaginertia=_numbers([tiny] * 3))
    return ET.tostring(root, encoding="unicode")


class Arm:
    """The arm's rigid-body side: inverse dynamics, and the geometry of its cylinders.

    Arrays are (n, J) with one column per joint of the machine file. A joint without cylinder counts as a cylinder
    that is the joint itself: ``x = q``, lever arm 1.
    """

    def __init__(self, design: ArmDesign) -> None:
        self.design = design
        self.machine = design.machine
        self.model = mujoco.MjModel.from_xml_string(arm_xml(design))
        self.data = mujoco.MjData(self.model)
        self._loaded = None
        if design.payload > 0.0:
            loaded = mujoco.MjModel.from_xml_string(arm_xml(design, design.payload))
            self._loaded = (loaded, mujoco.MjData(loaded))
        self._laws = _Laws(self)
        self.has_tendon = np.array(
            [
                j.cylinder is not None and isinstance(reduced(j.cylinder.linkage), _WITH_TENDON)
                for j in self.machine.joints
            ]
        )

    def lengths(self, index: int, q: FloatArray) -> FloatArray:
        """Compute piston positions at joint positions ``q`` (n,), from the tendon's length there."""
        joint = self.machine.joints[index]
        if joint.cylinder is None:
            return q.copy()
        linkage = reduced(joint.cylinder.linkage)
        if not isinstance(linkage, _WITH_TENDON):
            return linkage.piston_position(q)
        tendon = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_TENDON, joint.name)
        x = np.empty_like(q)
        for k, value in enumerate(q):
            self.data.qpos[index] = value
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_tendon(self.model, self.data)
            x[k] = self.data.ten_length[tendon]
        self.data.qpos[index] = 0.0
        if isinstance(linkage, ThreePin):
            return x - linkage.retracted
        return x - linkage.radius * linkage.zero if isinstance(linkage, Rack) else x

    def piston(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> tuple[FloatArray, ...]:
        """Compute piston position, speed, acceleration, lever arm ``r = dx/dq`` of all joints; arrays (n, J)."""
        x, r, bend = self._laws(q)
        return x, r * qd, r * qdd + bend * qd**2, r

    def effort(self, q: FloatArray, qd: FloatArray, qdd: FloatArray, carried: FloatArray | None = None) -> FloatArray:
        """Compute the joint efforts (n, J) of the motion, without any friction.

        Tendon and joint armatures (moving masses of pistons, drive inertia) are included. ``carried`` (n,) is the
        fraction 0 to 1 of the payload that the arm holds.
        """
        effort = _inverse(self.model, self.data, q, qd, qdd)
        if self._loaded is not None and carried is not None and np.any(carried > 0.0):
            effort += carried[:, None] * (_inverse(*self._loaded, q, qd, qdd) - effort)
        return effort


class _Laws:
    """``x(q)`` of all joints with two derivatives, as cubic splines on grids of equal size over the joints' ranges."""

    def __init__(self, arm: Arm) -> None:
        limits = np.array([joint.limits.position for joint in arm.machine.joints])
        margin = 0.15 * (limits[:, 1] - limits[:, 0])
        self._low = limits[:, 0] - margin
        self._step = (limits[:, 1] - limits[:, 0] + 2 * margin) / GRID
        grids = self._low + np.arange(GRID + 1)[:, None] * self._step
        splines = [scipy.interpolate.CubicSpline(grid, arm.lengths(i, grid)) for i, grid in enumerate(grids.T)]
        self._coefficients = np.stack([spline.c for spline in splines], axis=2)  # (4, GRID, J)
        self._columns = np.arange(len(splines))

    def __call__(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        cell = np.clip(((q - self._low) / self._step).astype(np.intp), 0, GRID - 1)
        s = q - self._low - cell * self._step
        c3, c2, c1, c0 = (c[cell, self._columns] for c in self._coefficients)
        return ((c3 * s + c2) * s + c1) * s + c0, (3 * c3 * s + 2 * c2) * s + c1, 6 * c3 * s + 2 * c2


def _inverse(model: mujoco.MjModel, data: mujoco.MjData, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    out = np.empty_like(q)
    qpos, qvel, qacc, force = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    for k in range(len(q)):
        qpos[:], qvel[:], qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        out[k] = force
    return out
