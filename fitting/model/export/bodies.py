"""Links for simulators (URDF, MJCF): standard parameters of bodies that can exist, with the model's base parameters.

Recordings determine base parameters only; of the many standard ones that have them, those nearest to plausible links
are taken (:mod:`fitting.regression.plausible_arm`). Where no body has the model's very base parameters, those whose
efforts are nearest over the limits of the machine are taken if that is asked for, and what it costs is reported. Drives
and cylinders are written beside them as far as the format has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from daq.errors import InputError
from daq.machine.linkages import Direct, Rack, ThreePin, reduced
from daq.machine.machine_file import Cylinder
from daq.messages import Sentence
from fitting.arm.base_parameters import BaseParameters, base_regressor
from fitting.arm.geometry import Geometry, geometry_of, link_frames
from fitting.arrays import FloatArray
from fitting.effects.base import BodyColumn, Effect
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import moving_model, rendered, states, written
from fitting.model.export.words import Written, model_card, per_joint
from fitting.regression.body_prior import pseudo_inertia
from fitting.regression.plausible_arm import ALONE, plausible_arm
from fitting.regression.streamed import triangle

#: How much the model's own base parameters count against the choice of links: so much that only those are left.
_EXACT = 1e4
#: States that efforts are compared in where links are changed.
_STATES = 400


@dataclass(frozen=True)
class Body:
    """A link in the frame that its joint moves (axis: ``z``), and where that joint is.

    Attributes
    ----------
    name, revolute : of the joint
    place : (4, 4) pose of the joint at zero in the frame of the link before
    mass, centre : kg, (3,) m
    inertia : (3, 3) kg m^2 about the centre, in the axes of the frame
    """

    name: str
    revolute: bool
    place: FloatArray
    mass: float
    centre: FloatArray
    inertia: FloatArray

    @property
    def origin(self) -> FloatArray:
        """Position of its joint (3,), m."""
        return self.place[:3, 3]

    @property
    def angles(self) -> FloatArray:
        """Roll, pitch and yaw (3,) of its joint's frame, rad."""
        return np.asarray(scipy.spatial.transform.Rotation.from_matrix(self.place[:3, :3]).as_euler("xyz"))

    @property
    def quaternion(self) -> FloatArray:
        """The same as a quaternion (4,), scalar first."""
        return np.asarray(scipy.spatial.transform.Rotation.from_matrix(self.place[:3, :3]).as_quat(scalar_first=True))


@dataclass(frozen=True)
class Bodies:
    """All links of an arm.

    Attributes
    ----------
    links : base to tip
    standard : (n, 10) their inertial parameters in the frames of the table
    gravity : (3,) m/s^2 in the base's frame, tilted as the base was found to be
    apart : (n,) root mean square of the efforts that their change makes on another motion, N m or N (over the limits of
        the machine where no such motion is known); None where bodies have the model's own base parameters
    """

    links: tuple[Body, ...]
    standard: FloatArray
    gravity: FloatArray
    apart: FloatArray | None


def bodies_of(model: ArmModel, *, possible: bool = False) -> Bodies:
    """Return links with the model's base parameters; if ``possible``, the nearest that bodies can have where none have.

    Raises
    ------
    InputError
        If no bodies have them, and the nearest are not asked for.
    """
    geometry, part = geometry_of(model.arm), model.parameters.base_slice
    base, theta, n = model.base, model.theta[part], geometry.joints
    rows = np.diag(1.0 / np.maximum(np.abs(theta), 1e-6 * np.max(np.abs(theta))))
    found = _nearest(geometry, base, _EXACT * rows, theta)
    found[base.independent] += theta - base.regrouping @ found  # the last digits
    apart = None
    if not all(np.linalg.eigvalsh(pseudo_inertia(row)).min() > 0 for row in found[: 10 * n].reshape(n, 10)):
        if not possible:
            raise InputError("fitting.export_no_bodies")
        q, qd, qdd, _ = states(model, _STATES)
        efforts = base_regressor(model.arm, base, q, qd, qdd)
        scale = np.linalg.norm(efforts @ theta, axis=0)
        rows = triangle([efforts[:, k] / max(scale[k], 1e-9 * float(scale.max())) for k in range(n)])
        found = _nearest(geometry, base, _EXACT * rows, theta)
        seen = (q, qd, qdd) if model.seen is None else (model.seen.q, model.seen.qd, model.seen.qdd)
        change = base_regressor(model.arm, base, *seen) @ (base.regrouping @ found - theta)
        apart = np.asarray(np.sqrt(np.mean(change**2, axis=0)))
    standard = found[: 10 * n].reshape(n, 10)
    return Bodies(tuple(_links(geometry, standard)), standard, _gravity_of(model), apart)


def _gravity_of(model: ArmModel) -> FloatArray:
    """Return gravity (3,) in the base's frame with the tilt of effects, m/s^2."""
    field = np.asarray(model.arm.gravity, dtype=float)
    for columns, values in _tilts(model).values():
        field = field + sum(value * column.gravity for column, value in zip(columns, values, strict=True))
    return field


def _tilts(model: ArmModel) -> dict[int, tuple[Sequence[BodyColumn], list[float]]]:
    """Return by number the terms that are fields of gravity for all links, and values."""
    result = {}
    for number, term in enumerate(model.terms):
        columns = term.content.body_columns(model.arm, term.shape) if isinstance(term.content, Effect) else None
        if columns and all(own.links is None and own.since is None for own in columns):
            result[number] = columns, model.theta[model.term_slices[number]].tolist()
    return result


def _nearest(geometry: Geometry, base: BaseParameters, rows: FloatArray, theta: FloatArray) -> FloatArray:
    """Find bodies' standard parameters with base parameters nearest to ``theta`` in metric ``rows``."""
    target = rows @ theta
    arm = plausible_arm(geometry, base, (), [np.column_stack([rows, target])])
    return arm.optimum(rows, target, weight=ALONE).standard.copy()


def _links(geometry: Geometry, standard: FloatArray) -> list[Body]:
    links, before, frames = [], np.eye(4), link_frames(geometry, np.zeros(geometry.joints))
    for i, row in enumerate(standard):
        revolute, own, joint = bool(geometry.revolute[i]), frames[i + 1], frames[i + 1]
        if not geometry.modified:  # the table's frame is at the link's end; a slide is before a prismatic joint
            axis, across = frames[i, :3, 2], own[:3, 0]
            joint = np.eye(4)
            joint[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
            joint[:3, 3] = frames[i, :3, 3] + (0.0 if revolute else geometry.d[i]) * axis
        place, frame, before = np.linalg.inv(before) @ joint, np.linalg.inv(joint) @ own, joint
        mass, first = row[0], row[1:4] / row[0]
        about = np.zeros((3, 3))
        about[np.triu_indices(3)] = row[4:]
        about = about + np.triu(about, 1).T
        central = about - mass * ((first @ first) * np.eye(3) - np.outer(first, first))
        rotation = frame[:3, :3]
        centre = rotation @ first + frame[:3, 3]
        links.append(Body(geometry.names[i], revolute, place, float(mass), centre, rotation @ central @ rotation.T))
    return links


def _tendon_of(cylinder: Cylinder) -> bool:
    """Return whether a simulator's tendon moves like the cylinder."""
    return isinstance(reduced(cylinder.linkage), ThreePin | Rack | Direct)


def _not_in_bodies(model: ArmModel, bodies: Bodies, *, cylinders: bool = False) -> tuple[str, ...]:
    """List a line for each part of a model outside a format's links and drives, and cylinders if it has them."""
    lines = []
    for number, joint in enumerate(model.arm.joints):
        names = model.parameters.drive[number]
        if joint.cylinder is None:
            lines += [f"drive of {joint.name} (f_0)"] if "f_0" in names else []
        elif not cylinders or not _tendon_of(joint.cylinder):
            own = ", ".join((*names, *(["damping"] if joint.cylinder.damping else [])))
            lines.append(f"cylinder of {joint.name} ({own}, at the piston): its lever arm changes with the joint")
        elif "f_s" in names:
            lines.append(f"friction of the root of speed at {joint.name} (f_s)")
    if geometry_of(model.arm).coupled:
        lines.append("friction and inertia of motors that turn with several joints")
    for term in (own for number, own in enumerate(model.terms) if number not in _tilts(model)):
        name = term.content.title if isinstance(term.content, Effect) else "a law"
        lines.append(Sentence("fitting.at_joint", effect=name, joint=model.place(term)))
    if bodies.apart is not None:
        lines.append(
            "the model's very base parameters: no bodies have them. The links are representative of the base "
            f"parameters; on another motion their efforts are apart by {per_joint(model, bodies.apart)}"
        )
    return tuple(lines)


def _drive(model: ArmModel, number: int) -> dict[str, float]:
    """Return a joint's limits, and a direct drive's friction and inertia, never below zero."""
    joint, direct = model.arm.joints[number], model.arm.joints[number].cylinder is None
    values = model.drive_values(number) if direct else {}
    dry, viscous, inertia = (max(values.get(name, 0.0), 0.0) for name in ("f_c", "f_v", "J"))
    low, high = joint.limits.position
    limits = {"low": low, "high": high, "velocity": joint.limits.velocity, "effort": _largest(model, number)}
    return {"dry": dry, "viscous": viscous, "inertia": inertia, **limits}


def _cylinder(model: ArmModel, number: int, place: FloatArray) -> dict[str, Any] | None:
    """Return a cylinder as a tendon: its pins, areas, friction, mass and stiffness, never below zero."""
    cylinder, found = model.arm.joints[number].cylinder, model.drive_values(number)
    if cylinder is None or not _tendon_of(cylinder):
        return None
    values = {name: max(found.get(name, 0.0), 0.0) for name in ("m", "K", "f_c", "f_v")}
    result = values | {"head": cylinder.head_area, "rod": cylinder.rod_area}
    result |= {"m": values["m"] + (cylinder.moving_mass or 0.0), "f_v": values["f_v"] + cylinder.damping}
    linkage = reduced(cylinder.linkage)
    if isinstance(linkage, ThreePin):  # the joint, a pin on the link before, a pin on the link that moves: a triangle
        pin = linkage.b * np.array([np.cos(linkage.offset), np.sin(linkage.offset), 0.0])
        return result | {"fixed": (place @ [linkage.a, 0.0, 0.0, 1.0])[:3], "pin": pin, "rest": linkage.retracted}
    radius, zero = (linkage.radius, linkage.zero) if isinstance(linkage, Rack) else (1.0, 0.0)
    return result | {"fixed": None, "radius": radius, "rest": radius * zero}


def _largest(model: ArmModel, number: int) -> float:
    """Compute the largest joint effort of the recordings, at the longest lever arm."""
    low, high = model.arm.joints[number].limits.position
    q = np.zeros((33, len(model.joints)))
    q[:, number] = np.linspace(low, high, 33)
    lever = np.max(np.abs(motion.levers(model, q)[:, number]))
    return float(lever * model.passes[-1].ranges[number].force)


def written_bodies(model: ArmModel, path: Path, template: str, possible: bool, *, cylinders: bool) -> Written:
    """Write a file of links and drives, with cylinders as tendons or without; refused where none can exist or move."""
    model, notes = moving_model(model, possible)
    bodies = bodies_of(model, possible=possible)
    drives = [_drive(model, number) for number in range(len(model.joints))]
    left_out = [*notes, *_not_in_bodies(model, bodies, cylinders=cylinders)]
    if not cylinders:  # the format has no place for what the other has
        inertias = zip(model.joints, (own["inertia"] for own in drives), strict=True)
        left_out += [f"inertia of the drive of {name}: {own:.6g}" for name, own in inertias if own]
        gravity = ", ".join(f"{g:.6g}" for g in bodies.gravity)
        left_out.append(f"gravity, which the format has no place for: ({gravity}) m/s^2 in the base's frame")
    text = rendered(
        template,
        card=model_card(model, left_out),
        name=model.machine.name,
        links=bodies.links,
        gravity=bodies.gravity,
        drives=drives,
        cylinders=[_cylinder(model, number, body.place) for number, body in enumerate(bodies.links)],
    )
    return written(path.parent, {path.name: text}, left_out)
