"""The links as URDF and as MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from daq.recordings.recording_files import replacing
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.bodies import Body, bodies_of, not_in_bodies
from fitting.model.export.words import Written, said_of

FloatArray = npt.NDArray[np.float64]


def write_urdf(model: ArmModel, path: Path) -> Written:
    """Write links, joints and their limits as URDF; friction and damping of drives that act on a joint directly."""
    bodies = bodies_of(model)
    left = not_in_bodies(model, bodies, drives=True)
    inertia = [f"inertia of the drive of {joint}: {value:.6g}" for joint, value in _armatures(model).items() if value]
    robot = ET.Element("robot", name=model.machine.name)
    ET.SubElement(robot, "link", name="base")
    before = "base"
    for number, body in enumerate(bodies.links):
        link = ET.SubElement(robot, "link", name=f"{body.name}_link")
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_numbers(body.centre), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=_number(body.mass))
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        values = body.inertia[np.triu_indices(3)]
        ET.SubElement(inertial, "inertia", {name: _number(v) for name, v in zip(names, values, strict=True)})
        joint = ET.SubElement(robot, "joint", name=body.name, type="revolute" if body.revolute else "prismatic")
        angles = Rotation.from_matrix(body.place[:3, :3]).as_euler("xyz")
        ET.SubElement(joint, "origin", xyz=_numbers(body.place[:3, 3]), rpy=_numbers(angles))
        ET.SubElement(joint, "parent", link=before)
        ET.SubElement(joint, "child", link=f"{body.name}_link")
        ET.SubElement(joint, "axis", xyz="0 0 1")
        limits = model.arm.joints[number].limits
        ET.SubElement(
            joint,
            "limit",
            lower=_number(limits.position[0]),
            upper=_number(limits.position[1]),
            velocity=_number(limits.velocity),
            effort=_number(_largest(model, number)),
        )
        dry, viscous = _friction(model, number)
        if dry or viscous:
            ET.SubElement(joint, "dynamics", damping=_number(viscous), friction=_number(dry))
        before = f"{body.name}_link"
    gravity = ", ".join(f"{g:g}" for g in model.arm.gravity)
    lines = (*left, *inertia, f"gravity, which the format has no place for: ({gravity}) m/s^2 in the base's frame")
    return _written(model, path, robot, lines)


def write_mjcf(model: ArmModel, path: Path) -> Written:
    """Write links, joints and gravity as MJCF; friction, damping and inertia of drives that act on a joint directly."""
    bodies = bodies_of(model)
    root = ET.Element("mujoco", model=model.machine.name)
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false", balanceinertia="false")
    ET.SubElement(root, "option", gravity=_numbers(np.asarray(model.arm.gravity, dtype=float)))
    parent, armatures = ET.SubElement(root, "worldbody"), _armatures(model)
    for number, body in enumerate(bodies.links):
        parent = _mjcf_body(parent, body)
        dry, viscous = _friction(model, number)
        limits = model.arm.joints[number].limits.position
        ET.SubElement(
            parent,
            "joint",
            name=body.name,
            type="hinge" if body.revolute else "slide",
            axis="0 0 1",
            range=_numbers(np.array(limits)),
            limited="false",
            damping=_number(viscous),
            frictionloss=_number(dry),
            armature=_number(armatures[body.name]),
        )
    return _written(model, path, root, not_in_bodies(model, bodies, drives=True))


def _mjcf_body(parent: ET.Element, body: Body) -> ET.Element:
    quaternion = Rotation.from_matrix(body.place[:3, :3]).as_quat(scalar_first=True)
    own = ET.SubElement(
        parent, "body", name=f"{body.name}_link", pos=_numbers(body.place[:3, 3]), quat=_numbers(quaternion)
    )
    values = body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    ET.SubElement(own, "inertial", pos=_numbers(body.centre), mass=_number(body.mass), fullinertia=_numbers(values))
    return own


def _friction(model: ArmModel, number: int) -> tuple[float, float]:
    """Coulomb and viscous friction of a drive that acts on its joint directly, never below zero; else zeros."""
    if model.arm.joints[number].cylinder is not None:
        return 0.0, 0.0
    values = dict(zip(model.parameters.drive[number], _drive(model, number), strict=True))
    return max(values.get("f_c", 0.0), 0.0), max(values.get("f_v", 0.0), 0.0)


def _armatures(model: ArmModel) -> dict[str, float]:
    """Inertia of each joint's direct drive, where it is told apart from the links'."""
    return {
        name: max(dict(zip(model.parameters.drive[number], _drive(model, number), strict=True)).get("J", 0.0), 0.0)
        for number, name in enumerate(model.joints)
    }


def _drive(model: ArmModel, number: int) -> list[float]:
    values: list[float] = model.theta[model.parameters.drive_slice(number)].tolist()
    return values


def _largest(model: ArmModel, number: int) -> float:
    """Largest joint effort of the recordings, at the longest lever arm within the limits."""
    low, high = model.arm.joints[number].limits.position
    q = np.zeros((33, len(model.joints)))
    q[:, number] = np.linspace(low, high, 33)
    lever = np.max(np.abs(motion.levers(model, q)[:, number]))
    return float(lever * model.passes[-1].ranges[number].force)


def _number(value: float) -> str:
    return repr(float(value))


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return " ".join(_number(value) for value in values)


def _written(model: ArmModel, path: Path, root: ET.Element, left_out: tuple[str, ...]) -> Written:
    ET.indent(root)
    said = "\n".join(["", *said_of(model, left_out), ""]).replace("--", "- -")
    with replacing(path) as temporary:
        temporary.write_text(
            f'<?xml version="1.0"?>\n<!--{said}-->\n{ET.tostring(root, encoding="unicode")}\n', encoding="utf-8"
        )
    return Written((path,), left_out)
