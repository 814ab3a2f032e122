"""Links for simulators: standard parameters of bodies that can exist, with the model's base parameters.

Recordings tell base parameters only; of the many standard ones that have them, those nearest to plausible links are
taken (:mod:`fitting.regression.plausible_arm`). Where no body has the model's very base parameters, the nearest that
some body has are taken, and by how many standard deviations they moved is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry, geometry_of
from fitting.effects.base import Effect
from fitting.model.arm_model import ArmModel
from fitting.regression.body_prior import pseudo_inertia
from fitting.regression.plausible_arm import ALONE, plausible_arm

FloatArray = npt.NDArray[np.float64]

#: How much the model's own base parameters count against the choice of links: so much that only those are left.
_EXACT = 1e4


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


@dataclass(frozen=True)
class Bodies:
    """All links of an arm.

    Attributes
    ----------
    links : base to tip
    standard : (n, 10) their inertial parameters in the frames of the table
    moved : largest change of a base parameter in its standard deviations; 0 where bodies have the model's own
    """

    links: tuple[Body, ...]
    standard: FloatArray
    moved: float


def bodies_of(model: ArmModel) -> Bodies:
    """Links with the model's base parameters, or the nearest that bodies can have."""
    geometry, part = geometry_of(model.arm), model.parameters.base_slice
    base, theta, n = model.base, model.theta[part], geometry.joints
    rows = np.diag(1.0 / np.maximum(np.abs(theta), 1e-6 * np.max(np.abs(theta))))
    found = _nearest(geometry, base, _EXACT * rows, theta)
    found[base.independent] += theta - base.regrouping @ found  # the last digits
    if not _possible(found, n):
        values, vectors = np.linalg.eigh(model.covariance[part, part])
        least = 1e-12 * max(float(values.max()), 1e-300)  # what was not told has no weight worth a name
        found = _nearest(geometry, base, (vectors / np.sqrt(np.maximum(values, least))).T, theta)
    std = model.std[part]
    change = np.abs(base.regrouping @ found - theta)
    moved = float(np.max(change / np.where(std > 0, std, np.inf)))
    standard = found[: 10 * n].reshape(n, 10)
    return Bodies(tuple(_links(geometry, standard)), standard, moved if moved > 1e-6 else 0.0)


def _nearest(geometry: Geometry, base: BaseParameters, rows: FloatArray, theta: FloatArray) -> FloatArray:
    """Standard parameters of bodies whose base parameters are nearest to ``theta`` in the metric of ``rows``."""
    target = rows @ theta
    arm = plausible_arm(geometry, base, (), [np.column_stack([rows, target])])
    return arm.optimum(rows, target, weight=ALONE).standard.copy()


def _possible(standard: FloatArray, joints: int) -> bool:
    return all(np.linalg.eigvalsh(pseudo_inertia(row)).min() > 0 for row in standard[: 10 * joints].reshape(-1, 10))


def _links(geometry: Geometry, standard: FloatArray) -> list[Body]:
    links, before = [], np.eye(4)
    for i, row in enumerate(standard):
        turn, slide = _about_z(geometry.theta[i]), _along(0.0, geometry.d[i])
        across = _along(geometry.a[i], 0.0) @ _about_x(geometry.sin_alpha[i], geometry.cos_alpha[i])
        revolute = bool(geometry.revolute[i])
        if geometry.modified:
            place, frame, before = across @ turn @ slide, np.eye(4), np.eye(4)
        else:  # the table's frame is at the link's end; a slide is before a prismatic joint
            place = before @ turn @ (np.eye(4) if revolute else slide)
            frame = before = (slide if revolute else np.eye(4)) @ across
        mass, first = row[0], row[1:4] / row[0]
        about = np.zeros((3, 3))
        about[np.triu_indices(3)] = row[4:]
        about = about + np.triu(about, 1).T
        central = about - mass * ((first @ first) * np.eye(3) - np.outer(first, first))
        rotation = frame[:3, :3]
        centre = rotation @ first + frame[:3, 3]
        links.append(Body(geometry.names[i], revolute, place, float(mass), centre, rotation @ central @ rotation.T))
    return links


def _about_z(angle: float) -> FloatArray:
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return out


def _about_x(sine: float, cosine: float) -> FloatArray:
    out = np.eye(4)
    out[1:3, 1:3] = [[cosine, -sine], [sine, cosine]]
    return out


def _along(x: float, z: float) -> FloatArray:
    out = np.eye(4)
    out[0, 3], out[2, 3] = x, z
    return out


def not_in_bodies(model: ArmModel, bodies: Bodies, *, drives: bool) -> tuple[str, ...]:
    """A line for each part of a model that links and drives of a simulator's format do not carry.

    Parameters
    ----------
    drives : whether the format has friction and inertia of drives that act on their joint directly
    """
    lines = []
    for number, joint in enumerate(model.arm.joints):
        if joint.cylinder is not None:
            names = ", ".join((*model.parameters.drive[number], *(["damping"] if joint.cylinder.damping else [])))
            lines.append(f"cylinder of {joint.name} ({names}, at the piston): its lever arm changes with the joint")
        else:
            left = [name for name in model.parameters.drive[number] if not drives or name == "f_0"]
            lines += [f"drive of {joint.name} ({', '.join(left)})"] if left else []
    if geometry_of(model.arm).coupled:
        lines.append("friction and inertia of motors that turn with several joints")
    for term in model.terms:
        place = "the machine" if term.joint is None else model.joints[term.joint]
        lines.append(f"{term.content.title if isinstance(term.content, Effect) else 'a law'} at {place}")
    if bodies.moved:
        lines.append(
            f"the model's very base parameters: no bodies have them, the nearest are {bodies.moved:.2g} standard "
            "deviations away at most"
        )
    return tuple(lines)
