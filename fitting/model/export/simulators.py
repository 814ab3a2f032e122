"""What URDF and MJCF share: links, drives and cylinders of a model that can move."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from daq.machine.linkages import Rack, ThreePin, reduced
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.bodies import bodies_of, not_in_bodies, tendon_of
from fitting.model.export.functions import moving_model, rendered, written
from fitting.model.export.words import Written, said_of


def drive(model: ArmModel, number: int) -> dict[str, float]:
    """A joint's limits, and friction and inertia of a drive that acts on it directly, never below zero."""
    joint, direct = model.arm.joints[number], model.arm.joints[number].cylinder is None
    values = model.drive_values(number) if direct else {}
    dry, viscous, inertia = (max(values.get(name, 0.0), 0.0) for name in ("f_c", "f_v", "J"))
    low, high = joint.limits.position
    limits = {"low": low, "high": high, "velocity": joint.limits.velocity, "effort": _largest(model, number)}
    return {"dry": dry, "viscous": viscous, "inertia": inertia, **limits}


def _cylinder(model: ArmModel, number: int, place: FloatArray) -> dict[str, Any] | None:
    """A cylinder as a tendon: where it is pinned, areas, friction, mass and stiffness, never below zero."""
    cylinder, found = model.arm.joints[number].cylinder, model.drive_values(number)
    if cylinder is None or not tendon_of(cylinder):
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
    """Largest joint effort of the recordings, at the longest lever arm within the limits."""
    low, high = model.arm.joints[number].limits.position
    q = np.zeros((33, len(model.joints)))
    q[:, number] = np.linspace(low, high, 33)
    lever = np.max(np.abs(motion.levers(model, q)[:, number]))
    return float(lever * model.passes[-1].ranges[number].force)


def written_bodies(model: ArmModel, path: Path, template: str, possible: bool, *, cylinders: bool) -> Written:
    """Write a file of links and drives, with cylinders as tendons or without; refused where none can exist or move."""
    model, said = moving_model(model, possible)
    bodies = bodies_of(model, possible=possible)
    drives = [drive(model, number) for number in range(len(model.joints))]
    left_out = [*said, *not_in_bodies(model, bodies, cylinders=cylinders)]
    if not cylinders:  # the format has no place for what the other has
        inertias = zip(model.joints, (own["inertia"] for own in drives), strict=True)
        left_out += [f"inertia of the drive of {name}: {own:.6g}" for name, own in inertias if own]
        gravity = ", ".join(f"{g:.6g}" for g in bodies.gravity)
        left_out.append(f"gravity, which the format has no place for: ({gravity}) m/s^2 in the base's frame")
    text = rendered(
        template,
        said=said_of(model, left_out),
        name=model.machine.name,
        links=bodies.links,
        gravity=bodies.gravity,
        drives=drives,
        cylinders=[_cylinder(model, number, body.place) for number, body in enumerate(bodies.links)],
    )
    return written(path.parent, {path.name: text}, left_out)
