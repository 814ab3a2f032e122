"""A model evaluated on any motion: efforts, pressures, friction, gravity, inertia, accelerations.

Motions are (N, n), one row per sample. Terms over time (a history, a derivative:
:func:`fitting.model.arm_model.over_time`) need times that rise in even steps, at whatever rate, and without them the
motion is refused; what is asked of one moment (gravity, friction, inertia, accelerations) has their memory settled.
What sensors do to a reading (an offset, a gain, a drift, a delay) is no force of the arm, and never in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy

from daq.errors import InputError
from daq.messages import Sentence
from fitting.arm.linkage import lever_arms
from fitting.arrays import FloatArray
from fitting.model.arm_model import FOREIGN, ArmModel, of_sensors, over_time, phase_unknown
from fitting.model.evaluation import Evaluated, evaluate, segment_of, without
from fitting.residual.laws import Law
from fitting.signals.filters import filter_bank

#: Most steps of the search for accelerations, and the share of the largest at which it ends.
_STEPS, _CLOSE = 60, 1e-12
#: Poses over the limits at which a mass matrix is looked at (a power of two), and the least eigenvalue of one with
#: units on its diagonal that is taken for positive.
_POSES, DEFINITE = 8, 1e-9
#: Share of the largest speed that was recorded below which a sign of speed is always smooth, to be integrated.
_LEAST_WIDTH = 1e-4
#: By what share steps of time may differ and be even.
_EVEN = 1e-3


def on_motion(
    model: ArmModel,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    t: npt.ArrayLike | None = None,
    *,
    temperature: npt.ArrayLike | None = None,
    external: npt.ArrayLike | None = None,
) -> Evaluated:
    """Evaluate a model on a motion.

    Parameters
    ----------
    q, qd, qdd : (N, n) or (n,) joint positions, speeds, accelerations; rad or m, per second, per second squared
    t : (N,) s since the motion began, for terms of time and terms over time; None: all rows are at its beginning,
        which a model with terms over time refuses
    temperature : (N,) or one, K, of the oil, for terms of it
    external : (N, n) N, measured forces from outside at the pistons, positive against extension; None: none

    Raises
    ------
    InputError
        If shapes do not fit, or a term needs what is not given.
    """
    n, kept = len(model.joints), without(model, left_out(model))
    motion = [_rows(values, n, name) for values, name in ((q, "q"), (qd, "qd"), (qdd, "qdd"))]
    count = len(motion[0])
    if any(len(values) != count for values in motion):
        raise InputError("fitting.motion_rows_differ", counts=[str(len(m)) for m in motion])
    past = next((term.id for term in kept.terms if t is None and over_time(term)), None)
    if past is not None:
        raise InputError("fitting.term_needs_time", term=past)
    if temperature is None and heated(kept):
        raise InputError("fitting.model_needs_temperature")
    time = np.broadcast_to(np.asarray(0.0 if t is None else t, dtype=float), (count,))
    heat = None if temperature is None else np.broadcast_to(np.asarray(temperature, dtype=float), (count,))
    outside = None if external is None else np.broadcast_to(np.asarray(external, dtype=float), (count, n))
    kept = kept if t is None else _in_steps(kept, t)
    return evaluate(kept, [segment_of(model, motion, time, temperature=heat, external=outside)], {FOREIGN: 0.0})


def at_rest(model: ArmModel, *, cold: bool = False) -> ArmModel:
    """Return the model of one moment: forces of the machine, its terms' memory settled.

    ``cold`` leaves laws of the oil's temperature out, for what they do not change: inertias, differences of efforts.
    """
    return without(model, left_out(model) | histories(model) | (heated(model) if cold else frozenset()))


def histories(model: ArmModel) -> frozenset[int]:
    """List the machine's terms that need the motion before a moment."""
    return frozenset(n for n, term in enumerate(model.terms) if over_time(term) and not of_sensors(term))


def heated(model: ArmModel) -> frozenset[int]:
    """List the terms that are laws of the oil's temperature."""
    return frozenset(
        number
        for number, term in enumerate(model.terms)
        if isinstance(term.content, Law) and any(signal == "oil_temperature" for signal, _ in term.content.signals)
    )


def _in_steps(model: ArmModel, t: npt.ArrayLike) -> ArmModel:
    """Return the model with filters of times in even steps, where it has terms over time.

    Raises
    ------
    InputError
        If they do not, or are too far apart for the model's bandwidth.
    """
    times, rate = np.atleast_1d(np.asarray(t, dtype=float)), model.machine.rate_hz
    past = [term.id for term in model.terms if over_time(term)]
    if not past:
        return model
    steps = np.diff(times)
    if not len(steps) or steps[0] <= 0 or np.any(np.abs(steps - steps[0]) > _EVEN * steps[0]):
        raise InputError("fitting.term_needs_even_time", term=past[0])
    if abs(steps.mean() * rate - 1.0) < _EVEN:
        return model
    if model.bandwidth_hz > 0.2 / steps.mean():
        raise InputError("fitting.term_needs_rate", term=past[0], least=5 * model.bandwidth_hz, rate=1 / steps.mean())
    return replace(model, filters=filter_bank(1.0 / float(steps.mean()), model.bandwidth_hz))


def left_out(model: ArmModel) -> frozenset[int]:
    """List the terms that are no machine force, or of single recordings' phase."""
    return frozenset(n for n, term in enumerate(model.terms) if of_sensors(term) or phase_unknown(term, FOREIGN))


def gravity(model: ArmModel, q: npt.ArrayLike, *, temperature: npt.ArrayLike | None = None) -> FloatArray:
    """Compute joint efforts (N, n) at rest, N m or N: of the links, springs and offsets included.

    Parameters
    ----------
    q, temperature : as of :func:`on_motion`
    """
    still = np.zeros(np.shape(q))
    return on_motion(at_rest(model), q, still, still, temperature=temperature).joint_effort(0)


def friction(
    model: ArmModel, q: npt.ArrayLike, qd: npt.ArrayLike, *, temperature: npt.ArrayLike | None = None
) -> FloatArray:
    """Compute joint efforts (N, n) that change sign with the speed: friction and damping of drives and effects.

    ``(effort(q, qd, 0) - effort(q, -qd, 0)) / 2``; forces of inertia and gravity are even in speed.

    Parameters
    ----------
    q, qd, temperature : as of :func:`on_motion`
    """
    speed, still = np.asarray(qd, dtype=float), np.zeros(np.shape(q))
    there, back = (
        on_motion(at_rest(model), q, way, still, temperature=temperature).joint_effort(0) for way in (speed, -speed)
    )
    return np.asarray((there - back) / 2)


def inertia_matrix(model: ArmModel, q: npt.ArrayLike) -> FloatArray:
    """Compute effort per joint acceleration (N, n, n), at rest: links, pistons and drives; kg m^2 (kg m, kg).

    Parameters
    ----------
    q : (N, n) or (n,) joint positions, rad or m
    """
    n = len(model.joints)
    position = _rows(q, n, "q")
    count = len(position)
    units = np.repeat(np.vstack([np.zeros(n), np.eye(n)]), count, axis=0)
    rows = np.tile(position, (n + 1, 1))
    moved = on_motion(at_rest(model, cold=True), rows, np.zeros_like(rows), units)
    efforts = moved.joint_effort(0).reshape(n + 1, count, n)
    return np.asarray((efforts[1:] - efforts[0]).transpose(1, 2, 0))


def pressures_of(found: Evaluated, rod: npt.ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Compute head and rod pressures (N, n) of a motion (:func:`on_motion`), Pa; NaN without a cylinder.

    The force is one equation of two pressures. The other is the rod pressure: as given ((N, n), (n,) or one; Pa), or as
    the recordings show it at such a motion and force (NaN where it was not measured).
    """
    forces = found.drive_effort(0)
    expected = found.views(0)[0].rod_pressures() if rod is None else np.broadcast_to(rod, forces.shape)
    head, second = np.full_like(forces, np.nan), np.full_like(forces, np.nan)
    for joint, own in enumerate(found.model.arm.joints):
        if own.cylinder is not None:
            second[:, joint] = expected[:, joint]
            head[:, joint] = (forces[:, joint] + second[:, joint] * own.cylinder.rod_area) / own.cylinder.head_area
    return head, second


def forward(
    model: ArmModel,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    *,
    effort: npt.ArrayLike | None = None,
    head: npt.ArrayLike | None = None,
    rod: npt.ArrayLike | None = None,
    temperature: npt.ArrayLike | None = None,
    possible: bool = False,
) -> FloatArray:
    """Compute joint accelerations (N, n) from joint efforts, or from pressures.

    Parameters
    ----------
    q, qd, temperature : as of :func:`on_motion`
    effort : (N, n) N m or N; or
    head, rod : (N, n) pressures, Pa, of an arm that has cylinders alone
    possible : take the nearest model whose drives have no inertia below zero

    Raises
    ------
    InputError
        If neither efforts nor both pressures are given, a joint has no cylinder to have pressures, or accelerations do
        not settle.
    """
    n = len(model.joints)
    position, speed = _rows(q, n, "q"), _rows(qd, n, "qd")
    if (effort is None) == (head is None or rod is None):
        raise InputError("fitting.forward_effort_or_pressures")
    if effort is None:
        if any(joint.cylinder is None for joint in model.arm.joints):
            raise InputError("fitting.forward_without_cylinder")
        areas = np.array([(j.cylinder.head_area, j.cylinder.rod_area) for j in model.arm.joints if j.cylinder])
        force = np.asarray(head, dtype=float) * areas[:, 0] - np.asarray(rod, dtype=float) * areas[:, 1]
        effort = levers(model, position) * force
    wanted = np.broadcast_to(np.asarray(effort, dtype=float), position.shape)
    model = at_rest(nearest_possible(model) if possible else model)
    inertia = inertia_matrix(model, position)
    wrong = worst_pose(model, position, inertia)
    if wrong is not None:
        raise InputError("fitting.forward_not_definite", reason=wrong.text)

    def solve(efforts: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.solve(inertia, efforts[:, :, None])[:, :, 0])

    def needed(qdd: FloatArray) -> FloatArray:
        return on_motion(model, position, speed, qdd, temperature=temperature).joint_effort(0)

    return settled(solve, needed, wanted)


def settled(
    solve: Callable[[FloatArray], FloatArray],
    effort: Callable[[FloatArray], FloatArray],
    wanted: FloatArray,
    *,
    once: bool = False,
) -> FloatArray:
    """Solve for accelerations (..., n) whose joint efforts are the wanted ones.

    Parameters
    ----------
    solve : gives what efforts (..., n) accelerate by the mass matrices alone
    effort : gives joint efforts (..., n) of accelerations (..., n)
    once : one step, which is exact where no effect depends on the drives' forces

    Raises
    ------
    InputError
        If they do not settle.
    """
    # What the whole effort would accelerate: an arm that is held has no acceleration but the rounding of its efforts.
    found, scale = np.zeros_like(wanted), 0.0 if once else float(np.max(np.abs(solve(wanted))))
    for _ in range(_STEPS):  # each step leaves a share of the one before
        step = solve(wanted - effort(found))
        found = found + step
        if once or np.max(np.abs(step)) <= _CLOSE * max(float(np.max(np.abs(found))), scale):
            return found
    raise InputError("fitting.accelerations_not_settled")


@dataclass(frozen=True)
class Indefinite:
    """A pose at which a model's mass matrix is not positive definite.

    Attributes
    ----------
    pose : (n,) rad or m
    joint : which acceleration would cost no effort there, or less than none
    drives : joints whose drive inertia is below zero
    """

    pose: FloatArray
    joint: str
    drives: tuple[str, ...]

    @property
    def text(self) -> str:
        """One line that names joint, pose and what prevents it."""
        pose = ", ".join(f"{value:.3g}" for value in self.pose)
        why = Sentence("fitting.drive_inertia_negative", drives=self.drives) if self.drives else ""
        return Sentence("fitting.mass_matrix", pose=pose, joint=self.joint) + why


def indefinite(model: ArmModel) -> Indefinite | None:
    """Find the worst pose whose mass matrix is not positive definite; None where all are.

    Of poses spread over the limits of all joints (a Sobol sequence).
    """
    low, high = model.limits
    position = low + (high - low) * scipy.stats.qmc.Sobol(len(model.joints), scramble=False).random_base2(_POSES)
    return worst_pose(model, position, inertia_matrix(model, position))


def worst_pose(model: ArmModel, q: FloatArray, inertia: FloatArray) -> Indefinite | None:
    """Find the same as :func:`indefinite`, of mass matrices (N, n, n) that are there."""
    size = np.sqrt(np.maximum(np.abs(np.diagonal(inertia, axis1=1, axis2=2)), 1e-300))
    symmetric = (inertia + inertia.transpose(0, 2, 1)) / 2 / (size[:, :, None] * size[:, None, :])
    values, vectors = np.linalg.eigh(symmetric)
    worst = int(np.argmin(values[:, 0]))
    if values[worst, 0] > DEFINITE:
        return None
    joint = model.joints[int(np.argmax(np.abs(vectors[worst, :, 0])))]
    below = tuple(name for k, name in enumerate(model.joints) if model.drive_values(k).get("J", 0.0) < 0)
    return Indefinite(q[worst], joint, below)


def nearest_possible(model: ArmModel) -> ArmModel:
    """Make no drive inertia negative: the most probable model by the parameters' covariance.

    Efforts are better predicted by the model as it is; motions need a mass matrix.
    """
    names = model.parameter_names[: model.parameters.drive_count]
    inertias = [k for k, name in enumerate(names) if name.rpartition(".")[2] in ("J", "m") and model.told[k]]
    theta, held = model.theta, list[int]()
    while any(theta[k] < 0 for k in inertias):
        held += [k for k in inertias if theta[k] < 0]
        own = model.covariance[:, held]
        theta = model.theta - own @ np.linalg.lstsq(own[held], model.theta[held], rcond=None)[0]
        theta[held] = 0.0
    if not held:
        return model
    return replace(model, passes=(*model.passes[:-1], replace(model.passes[-1], theta=theta)))


def integrable(model: ArmModel, friction_speed: float = 0.0) -> ArmModel:
    """Smooth the signs of speed for an integrator: over so many m/s of a piston at least.

    Never over less than 1e-4 of the largest speed that was recorded.
    """
    least = [max(friction_speed, _LEAST_WIDTH * own.v) for own in model.passes[-1].ranges]
    noise = tuple(replace(own, turning=max(own.sign, width)) for own, width in zip(model.noise, least, strict=True))
    return replace(model, noise=noise)


def price(model: ArmModel, other: ArmModel) -> float | None:
    """Compute by what share other parameters enlarge all joints' validation error.

    Each joint's mean square in that of the model; None where no such recording was seen.
    """
    seen = model.seen
    if seen is None:
        return None
    moved = at_rest(model, cold=True), at_rest(other, cold=True)
    before, after = (on_motion(own, seen.q, seen.qd, seen.qdd).joint_effort(0) for own in moved)
    squares = [np.mean(own**2, axis=0) for own in (seen.error, seen.error + before - after)]
    there = squares[0] > 0
    return float(np.sqrt(np.mean(squares[1][there] / squares[0][there])) - 1.0)


def levers(model: ArmModel, q: FloatArray) -> FloatArray:
    """Compute lever arms (N, n) of all joints, 1 without a cylinder."""
    return lever_arms(model.arm, q)


def _rows(values: npt.ArrayLike, joints: int, name: str) -> FloatArray:
    array = np.atleast_2d(np.asarray(values, dtype=float))
    if array.ndim != 2 or array.shape[1] != joints:
        raise InputError("fitting.rows_other_shape", name=name, shape=str(np.shape(values)), joints=joints)
    if not np.isfinite(array).all():
        raise InputError("fitting.rows_not_finite", name=name)
    return array
