"""The links as URDF and as MJCF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.machine.linkages import Rack, ThreePin, reduced
from daq.recordings.recording_files import replacing
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.bodies import Bodies, bodies_of, not_in_bodies, tendon_of
from fitting.model.export.functions import rendered
from fitting.model.export.words import Written, said_of


def write_urdf(model: ArmModel, path: Path, *, possible: bool = False) -> Written:
    """Write links, joints and their limits as URDF; friction and damping of drives that act on a joint directly."""
    model, said = _moving(model, possible)
    bodies = bodies_of(model, possible=possible)
    drives = [_drive(model, number) for number in range(len(model.joints))]
    left = [
        f"inertia of the drive of {name}: {own['inertia']:.6g}"
        for name, own in zip(model.joints, drives, strict=True)
        if own["inertia"]
    ]
    gravity = ", ".join(f"{g:.6g}" for g in bodies.gravity)
    left.append(f"gravity, which the format has no place for: ({gravity}) m/s^2 in the base's frame")
    return _written(model, path, "arm.urdf.j2", bodies, (*said, *not_in_bodies(model, bodies), *left))


def write_mjcf(model: ArmModel, path: Path, *, possible: bool = False) -> Written:
    """Write links, joints, gravity and drives as MJCF: cylinders are tendons that two pressures pull on."""
    model, said = _moving(model, possible)
    bodies = bodies_of(model, possible=possible)
    return _written(model, path, "arm.mjcf.j2", bodies, (*said, *not_in_bodies(model, bodies, cylinders=True)))


def _moving(model: ArmModel, possible: bool) -> tuple[ArmModel, tuple[str, ...]]:
    """The model, or if asked for the nearest that can move, and what that costs; refused where it cannot."""
    wrong = motion.indefinite(model)
    if wrong is None:
        return model, ()
    if not possible:
        raise InputError(f"export: {wrong.text}; --possible writes the nearest model that can move")
    own = motion.nearest_possible(model)
    price = motion.price(model, own)
    cost = "" if price is None else f"; the error on another motion is {100 * price:+.1f} % of the model's own"
    return own, (f"the drives' inertias as they were found: none is below zero here{cost}",)


def _drive(model: ArmModel, number: int) -> dict[str, float]:
    """A joint's limits, and friction and inertia of a drive that acts on it directly, never below zero."""
    joint, direct = model.arm.joints[number], model.arm.joints[number].cylinder is None
    values = _values(model, number) if direct else {}
    dry, viscous, inertia = (max(values.get(name, 0.0), 0.0) for name in ("f_c", "f_v", "J"))
    low, high = joint.limits.position
    limits = {"low": low, "high": high, "velocity": joint.limits.velocity, "effort": _largest(model, number)}
    return {"dry": dry, "viscous": viscous, "inertia": inertia, **limits}


def _values(model: ArmModel, number: int) -> dict[str, float]:
    return dict(
        zip(model.parameters.drive[number], model.theta[model.parameters.drive_slice(number)].tolist(), strict=True)
    )


def _cylinder(model: ArmModel, number: int, place: FloatArray) -> dict[str, Any] | None:
    """A cylinder as a tendon: where it is pinned, areas, friction, mass and stiffness, never below zero."""
    cylinder, found = model.arm.joints[number].cylinder, _values(model, number)
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


def _written(model: ArmModel, path: Path, template: str, bodies: Bodies, left_out: tuple[str, ...]) -> Written:
    text = rendered(
        template,
        said=said_of(model, left_out),
        name=model.machine.name,
        links=bodies.links,
        gravity=bodies.gravity,
        drives=[_drive(model, number) for number in range(len(model.joints))],
        cylinders=[_cylinder(model, number, body.place) for number, body in enumerate(bodies.links)],
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Written((path,), left_out)
