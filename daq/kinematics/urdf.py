"""Serial chains from URDF files (and xacro files, with the extra ``xacro``)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daq.arrays import FloatArray
from daq.errors import InputError
from daq.kinematics.chain import Axis, Chain, turning

#: rad: a roll, pitch or yaw that is nearer to a quarter turn was rounded ("1.57" is 0.0008 off).
ROUNDED = 1e-3
_MOVING = ("revolute", "continuous", "prismatic")
_ORIGIN = "0 0 0"


@dataclass(frozen=True)
class _Joint:
    """A joint element: what it joins, and its frame in its parent link's."""

    name: str
    type: str
    parent: str
    child: str
    element: ET.Element


def urdf_chain(root: ET.Element, path: Path, tip: str | None) -> Chain:
    """Read the chain from a ``<robot>``'s root link to ``tip``, or to the only end that moves.

    Raises
    ------
    InputError
        With file, joint or link, and the cure.
    """
    joints = [_joint(element, path) for element in root.findall("joint")]
    links = [str(element.get("name")) for element in root.findall("link")]
    if not joints or not links:
        raise InputError("daq.urdf_without_joints", path=path)
    above = {joint.child: joint for joint in joints}
    roots = [link for link in links if link not in above]
    if len(roots) != 1:
        raise InputError("daq.urdf_several_roots", path=path, count=len(roots))
    chosen = _tip(joints, path, roots[0], links, tip)
    way = list[_Joint]()
    link = chosen
    while link != roots[0]:
        if link not in above or len(way) > len(joints):
            raise InputError("daq.urdf_link_hangs", path=path, link=link)
        way.append(above[link])
        link = way[-1].parent
    notes: list[str] = []
    pose, axes = np.eye(4), list[Axis]()
    for joint in reversed(way):
        pose = pose @ _origin(joint, path, notes)
        if joint.type == "fixed":
            continue
        axes.append(_axis(joint, pose, path, notes))
    if not axes:
        raise InputError("daq.chain_without_motion", path=path, root=roots[0], tip=chosen)
    name = root.get("name") or path.stem
    return Chain(name, roots[0], chosen, tuple(axes), pose, np.array([0.0, 0.0, -9.81]), tuple(notes))


def expanded(path: Path) -> str:
    """Expand a xacro file to its URDF text."""
    try:
        import xacro
    except ImportError:
        raise InputError("daq.xacro_needs_package", path=path) from None
    try:
        return str(xacro.process_file(str(path)).toxml())
    except Exception as error:  # its errors have no common base: it evaluates Python expressions
        text = " ".join(str(error).split()) or type(error).__name__
        raise InputError("daq.xacro_cannot_expand", path=path, error=text) from None


def _joint(element: ET.Element, path: Path) -> _Joint:
    name, kind = element.get("name") or "", element.get("type") or ""
    parent, child = element.find("parent"), element.find("child")
    if not name or parent is None or child is None:
        raise InputError("daq.urdf_joint_lacks", path=path, name=name)
    return _Joint(name, kind, parent.get("link") or "", child.get("link") or "", element)


def _tip(joints: list[_Joint], path: Path, root: str, links: list[str], tip: str | None) -> str:
    """Return the chain's last link."""
    below: dict[str, list[_Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    if tip is not None:
        if tip not in links:
            raise InputError("daq.chain_no_link", path=path, tip=tip, ends=_ends(below, root))
        return tip
    ends = _moving_ends(below, root)
    if len(ends) > 1:
        raise InputError("daq.chain_branches", path=path, ends=ends)
    return _last(below, ends[0]) if ends else root


def _ends(below: Mapping[str, list[_Joint]], link: str) -> list[str]:
    own = below.get(link, [])
    return [end for joint in own for end in _ends(below, joint.child)] if own else [link]


def _moving_ends(below: Mapping[str, list[_Joint]], link: str) -> list[str]:
    """Return the links behind each branch's last moving joint."""
    found = []
    for joint in below.get(link, []):
        ends = _moving_ends(below, joint.child)
        found += ends or ([joint.child] if joint.type != "fixed" else [])
    return found


def _last(below: Mapping[str, list[_Joint]], link: str) -> str:
    """Follow what is fixed to a link to its end, as long as nothing branches."""
    while len(below.get(link, [])) == 1:
        link = below[link][0].child
    return link


def _numbers(text: str, count: int, path: Path, joint: _Joint, key: str) -> FloatArray:
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        if count == 1:
            raise InputError("daq.urdf_not_number", path=path, joint=joint.name, key=key, text=text)
        raise InputError("daq.urdf_not_numbers", path=path, joint=joint.name, key=key, text=text, count=count)
    return values


def _origin(joint: _Joint, path: Path, notes: list[str]) -> FloatArray:
    """Compute the joint's frame in its parent's: ``Rz(yaw) Ry(pitch) Rx(roll)`` and translation."""
    origin = joint.element.find("origin")
    pose = np.eye(4)
    if origin is None:
        return pose
    pose[:3, 3] = _numbers(origin.get("xyz") or _ORIGIN, 3, path, joint, "origin xyz")
    angles = _numbers(origin.get("rpy") or _ORIGIN, 3, path, joint, "origin rpy")
    quarters = np.round(angles / (np.pi / 2)) * (np.pi / 2)
    rounded = (np.abs(angles - quarters) < ROUNDED) & (angles != quarters)
    if np.any(np.abs(angles - quarters)[rounded] > 1e-5):
        notes.append(f"{joint.name}: its rpy was rounded to quarter turns, {' '.join(f'{a:g}' for a in angles)} rad")
    roll, pitch, yaw = np.where(rounded, quarters, angles)
    x, y, z = np.eye(3)
    pose[:3, :3] = turning(z, yaw) @ turning(y, pitch) @ turning(x, roll)
    return pose


def _axis(joint: _Joint, pose: FloatArray, path: Path, notes: list[str]) -> Axis:
    if joint.type not in _MOVING:
        if not joint.type:
            raise InputError("daq.urdf_joint_without_type", path=path, joint=joint.name)
        raise InputError("daq.urdf_joint_other_type", path=path, joint=joint.name, type=joint.type)
    if joint.element.find("mimic") is not None:
        raise InputError("daq.urdf_joint_mimics", path=path, joint=joint.name)
    axis = joint.element.find("axis")
    local = _numbers((axis.get("xyz") if axis is not None else None) or "1 0 0", 3, path, joint, "axis xyz")
    size = float(np.linalg.norm(local))
    if size < 1e-6:
        raise InputError("daq.urdf_axis_zero", path=path, joint=joint.name)
    limit = joint.element.find("limit")
    position, velocity = None, None
    if limit is not None:
        lower, upper, speed = (
            float(_numbers(limit.get(key) or "0", 1, path, joint, f"limit {key}")[0])
            for key in ("lower", "upper", "velocity")
        )
        velocity = speed if speed > 0 else None
        position = (lower, upper) if lower < upper and joint.type != "continuous" else None
    if position is None and joint.type == "continuous":
        position = (-np.pi, np.pi)
        notes.append(f"{joint.name}: turns without end; its limits are a turn")
    return Axis(
        joint.name,
        "prismatic" if joint.type == "prismatic" else "revolute",
        pose[:3, 3].copy(),
        pose[:3, :3] @ (local / size),
        position,
        velocity,
    )
