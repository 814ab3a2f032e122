"""What a controller would have tables of: the gravity of links, what springs hold, the friction of drives.

Gravity along parallel axes needs no table of several positions: the part of each link is a function of its own angle to
the first of these axes (the sum of the joint positions), and a joint bears the parts of its own link and of all behind
it along these axes. What else acts at rest (stiffness, offsets) is a table beside it: both together are the effort at
rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import without
from fitting.model.export.grids import ROUNDING, Quantity

_TRIALS = 40


def gravity_quantities(model: ArmModel) -> list[Quantity]:
    """The effort at rest: gravity of the links, and what else holds a joint, where there is such."""
    links = _links(model)
    return [*_link_quantities(links), *(_held(model, links, joint) for joint in range(len(model.joints)))]


def _links(model: ArmModel) -> ArmModel:
    """The links alone, with what effects change about them."""
    changes = {
        number
        for number, term in enumerate(model.terms)
        if not isinstance(term.content, Effect) or term.content.body_columns(model.arm, term.shape) is None
    }
    own = without(model, changes)
    drives = np.arange(len(own.theta)) < own.parameters.drive_count
    return replace(
        own, passes=tuple(replace(p, theta=np.where(drives[: len(p.theta)], 0.0, p.theta)) for p in own.passes)
    )


def _held(model: ArmModel, links: ArmModel, joint: int) -> Quantity:
    """What acts at rest beside the links."""
    says = f"effort of {model.joints[joint]} at rest beside the links' gravity: stiffness, offset, springs"
    return _at_rest(
        model, joint, "held", says, lambda q: (motion.gravity(model, q) - motion.gravity(links, q))[:, joint]
    )


def _own_gravity(model: ArmModel, joint: int) -> Quantity:
    says = f"effort of {model.joints[joint]} that holds the links still"
    return _at_rest(model, joint, "gravity", says, lambda q: motion.gravity(model, q)[:, joint])


def _at_rest(model: ArmModel, joint: int, what: str, says: str, value: Callable[[FloatArray], FloatArray]) -> Quantity:
    """A joint's effort over all joint positions."""
    positions = tuple(_position(model, k) for k in range(len(model.joints)))
    return Quantity(f"{what}_{model.joints[joint]}", says, model.joint_units[joint], positions, value)


def _link_quantities(model: ArmModel) -> list[Quantity]:
    """Gravity of links along parallel axes over the link's angle, of other joints over joint positions."""
    limits = model.limits.T
    result: list[Quantity] = []
    for chain in parallel_axes(model):
        last = chain[-1]
        if not _alone(model, chain):
            result += [_own_gravity(model, joint) for joint in chain]
            continue
        for joint in chain:
            # Of the others one pose is as good as another: what differs between two joints is this link's own part.
            low, high = limits[chain[0] : joint + 1].sum(axis=0)

            def part(rows: FloatArray, joint: int = joint, first: int = chain[0], last: int = last) -> FloatArray:
                q = np.tile(limits.mean(axis=1), (len(rows), 1))
                q[:, first : joint + 1] = 0.0
                q[:, first] = rows[:, 0]
                efforts = motion.gravity(model, q)
                behind = efforts[:, joint + 1] if joint < last else 0.0
                return np.asarray(efforts[:, joint] - behind)

            names = " + ".join(model.joints[chain[0] : joint + 1])
            says = f"part of link {model.joints[joint]} in the gravity of itself and of the joints before it from "
            says += f"{model.joints[chain[0]]} on, over {names}: a joint bears its own link's part and those behind"
            variable = (f"{model.joints[joint]}.link_angle", "rad", float(low), float(high))
            result.append(Quantity(f"gravity_{model.joints[joint]}", says, "N m", (variable,), part))
    return result


def parallel_axes(model: ArmModel) -> list[tuple[int, ...]]:
    """Joints in runs of parallel axes that turn; a joint that slides is a run of its own."""
    geometry = geometry_of(model.arm)
    runs: list[tuple[int, ...]] = []
    for joint in range(geometry.joints):
        twist = joint - 1 if not geometry.modified else joint  # between the axes of the joint before and of this one
        parallel = joint > 0 and abs(geometry.sin_alpha[twist]) < 1e-12 and geometry.cos_alpha[twist] > 0
        if runs and parallel and geometry.revolute[joint] and geometry.revolute[joint - 1]:
            runs[-1] = (*runs[-1], joint)
        else:
            runs.append((joint,))
    return runs


def _alone(model: ArmModel, chain: Sequence[int]) -> bool:
    """Whether gravity along parallel axes is a sum of functions of the links' angles."""
    rng, n = np.random.default_rng(1), len(model.joints)
    if not geometry_of(model.arm).revolute[chain[0]]:
        return False
    limits = model.limits.T
    q = rng.uniform(limits[:, 0], limits[:, 1], (_TRIALS, n))
    other = rng.uniform(limits[:, 0], limits[:, 1], (_TRIALS, n))
    efforts = motion.gravity(model, q)
    scale = float(np.max(np.abs(efforts))) or 1.0
    for place, joint in enumerate(chain):
        moved = other.copy()  # another pose with the same angle of this link
        moved[:, chain[0]] += q[:, chain[: place + 1]].sum(axis=1) - other[:, chain[: place + 1]].sum(axis=1)
        again = motion.gravity(model, moved)
        parts = [e[:, joint] - (e[:, joint + 1] if joint < chain[-1] else 0.0) for e in (efforts, again)]
        if np.max(np.abs(parts[0] - parts[1])) > ROUNDING * scale:
            return False
    return True


def _position(model: ArmModel, joint: int) -> tuple[str, str, float, float]:
    described = model.machine.joints[joint]
    unit = "rad" if described.type == "revolute" else "m"
    return (f"{described.name}.position", unit, *described.limits.position)


def friction_quantities(model: ArmModel) -> list[Quantity]:
    """Friction of every drive over its own speed, and whatever else it depends on."""
    n, result = len(model.joints), []
    levers = motion.levers(model, model.limits.mean(axis=0, keepdims=True))[0]
    for joint, described in enumerate(model.arm.joints):
        fastest = model.passes[-1].ranges[joint].v or abs(levers[joint]) * described.limits.velocity
        turns = described.cylinder is None and described.type == "revolute"
        own = (f"{described.name}.{'speed' if described.cylinder is None else 'piston_speed'}",)
        speed = (*own, "rad/s" if turns else "m/s", -float(fastest), float(fastest))
        others = [k for k in range(n) if k != joint]

        def value(rows: FloatArray, joint: int = joint, others: list[int] = others) -> FloatArray:
            q, qd = rows[:, 1 : 1 + n], np.zeros((len(rows), n))
            qd[:, others] = rows[:, 1 + n :]
            qd[:, joint] = rows[:, 0] / motion.levers(model, q)[:, joint]
            both = motion.on_motion(model, np.vstack([q, q]), np.vstack([qd, -qd]), np.zeros((2 * len(q), n)))
            efforts = both.drive_effort(0)[:, joint]
            return np.asarray((efforts[: len(q)] - efforts[len(q) :]) / 2)

        positions = [_position(model, k) for k in range(n)]
        limits = [model.machine.joints[k].limits.velocity for k in others]
        speeds = [
            (f"{model.joints[k]}.speed", f"{_position(model, k)[1]}/s", -fast, fast)
            for k, fast in zip(others, limits, strict=True)
        ]
        unit = model.effort_units[joint]
        says = f"friction of the drive of {described.name}: what changes its sign with its speed"
        result.append(Quantity(f"friction_{described.name}", says, unit, (speed, *positions, *speeds), value))
    return result
