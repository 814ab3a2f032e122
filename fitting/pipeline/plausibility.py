"""Is what was identified physically possible?

Least squares knows nothing of physics. Asked of a fitted model:

drive
    moving mass, stiffness and drive inertia are not negative;
friction
    it opposes the motion at every speed that was used (:mod:`fitting.residual.friction_power`);
links
    there are bodies (pseudo-inertias that are positive semidefinite) with the base parameters that are determined.

The nearest possible parameters are sought in the metric of the estimate's own covariance ``S``,

    minimise (theta - theta^)' S^-1 (theta - theta^)   subject to the above,

by :mod:`fitting.regression.plausible_arm` with next to no weight of the plausible arm; of friction it is enough there
that no coefficient is negative. A violation is significant where the distance is one that an estimate of something
possible has once in ten thousand machines; the cone's distance is at most a chi-square of as many degrees of freedom as
parameters, so the test errs on the side of silence.

Source: Wensing, Kim and Slotine, IEEE RA-L 3 (2018) 60 (pseudo-inertia).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import scipy
from scipy import linalg

from daq.messages import Sentence
from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.pipeline.results.stage_results import Constrained, Physics
from fitting.regression.design import Design
from fitting.regression.drive import drive_units
from fitting.regression.error_sizes import errors_of, in_floors
from fitting.regression.plausible_arm import ALONE, plausible_arm
from fitting.report.languages import NAMES
from fitting.residual.friction_power import FrictionPower, driving, friction_power
from fitting.residual.terms import Model

#: Chance that a possible machine is called impossible, over all that is asked of it.
ALARM = 1e-4
_LOOSE = 1e-8  # information of a prior that means nothing, and what is left of it below zero


@dataclass(frozen=True)
class Violation:
    """One thing that cannot be.

    Attributes
    ----------
    kind : ``drive``, ``friction`` or ``link``
    joint : name of the joint, or None for a link's parameter
    parameter : its name, or ``f(v)``
    value, std, unit : of the estimate
    sigmas : deviations beyond what is possible
    text, cause : for people
    possible : value in the nearest possible set
    """

    kind: str
    joint: str | None
    parameter: str
    value: float
    std: float
    unit: str
    sigmas: float
    text: str
    cause: str
    possible: float | None = None


@dataclass(frozen=True)
class Plausibility:
    """What cannot be, significantly and the worst first, and the nearest parameters (p,) that can; None without any."""

    violations: tuple[Violation, ...]
    theta: FloatArray | None


def plausibility(model: Model) -> Plausibility:
    """Hold a fitted model against physics."""
    joints = range(len(model.design.machine.joints))
    friction = [friction_power(model, joint) for joint in joints]
    questions = sum(len(f.speed) for f in friction) + 2 * len(joints) + 1
    most = float(scipy.stats.norm.isf(ALARM / questions))
    found = [*_drives(model, most), *_frictions(model, friction, most)]
    links, base_distance = _links(model, ALARM / questions)
    if not found and not links:
        return Plausibility((), None)
    nearest = _nearest(model, whole=True)[0]
    violations = [*found, *_named_links(model, nearest, base_distance)] if links else found
    shown = tuple(sorted(violations, key=lambda v: -v.sigmas))
    possible = tuple(_with_possible(model, v, nearest) for v in shown)
    return Plausibility(possible, nearest)


def _drives(model: Model, most: float) -> list[Violation]:
    """Find negative masses, stiffnesses and drive inertias."""
    found = []
    parameters, fit = model.design.parameters, model.fit
    for joint, name in enumerate(parameters.joints):
        start = parameters.drive_slice(joint).start
        for number, parameter in enumerate(parameters.drive[joint]):
            value, std = float(fit.theta[start + number]), float(fit.std[start + number])
            if parameter not in ("m", "K", "J") or not fit.determined[start + number] or not value < -most * std:
                continue
            unit, sigmas = drive_units(model.design.machine.joints[joint])[parameter], -value / std if std else np.inf
            reason = (
                Sentence("fitting.parameter_negative", parameter=NAMES["parameters"][parameter], joint=name),
                NAMES["causes"][parameter],
            )
            found.append(Violation("drive", name, parameter, value, std, unit, sigmas, *reason))
    return found


def _frictions(model: Model, friction: Sequence[FrictionPower], most: float) -> list[Violation]:
    """Find joints whose friction drives the motion at some speed."""
    found = []
    for own in friction:
        worst = driving(own, model.fit, most)
        if worst is None:
            continue
        joint = model.design.machine.joints[own.joint]
        straight = joint.cylinder is not None or joint.type == "prismatic"
        unit, speed = ("N", "m/s") if straight else ("N m", "rad/s")
        reason = Sentence("fitting.friction_drives", joint=joint.name, speed=worst.speed, unit=speed)
        sizes = worst.force, worst.std, unit, worst.sigmas
        found.append(Violation("friction", joint.name, "f(v)", *sizes, reason, NAMES["causes"]["friction"]))
    return found


def _links(model: Model, alarm: float) -> tuple[bool, float]:
    """Return whether no bodies have these base parameters, and the squared distance."""
    base = model.design.parameters.base
    if not base.inertial_columns:
        return False, 0.0
    _, distance, freedom = _nearest(model, whole=False)
    return bool(distance > scipy.stats.chi2.isf(alarm, max(freedom, 1))), distance


def _named_links(model: Model, nearest: FloatArray, distance: float) -> list[Violation]:
    """Find the base parameter to move furthest, in its own deviations."""
    part, base = model.design.parameters.base_slice, model.design.parameters.base
    determined = model.fit.determined[part]
    std = model.fit.std[part]
    moved = np.where(determined & (std > 0), (nearest[part] - model.fit.theta[part]) / np.where(std > 0, std, 1.0), 0.0)
    worst = int(np.argmax(np.abs(moved)))
    name, value, unit = base.names[worst], float(model.fit.theta[part][worst]), base.units[worst]
    reason = Sentence("fitting.no_links_can_exist", parameter=name, value=value, unit=unit)
    sizes = value, float(std[worst]), unit, float(np.sqrt(distance))
    return [Violation("link", None, name, *sizes, reason, NAMES["causes"]["link"])]


def _with_possible(model: Model, found: Violation, nearest: FloatArray) -> Violation:
    """Add to the violation its parameter's value in the nearest possible set."""
    parameters = model.design.parameters
    names = [*parameters.names[: parameters.drive_count], *parameters.base.names]
    own = found.parameter if found.joint is None else f"{found.joint}.{found.parameter}"
    return replace(found, possible=float(nearest[names.index(own)])) if own in names else found


def _nearest(model: Model, whole: bool) -> tuple[FloatArray, float, int]:
    """Find the nearest possible parameters (p,), squared distance and degrees of freedom.

    ``whole`` asks for everything, otherwise for the links alone.
    """
    parameters, fit = model.design.parameters, model.fit
    width, determined = len(parameters), np.flatnonzero(fit.determined)
    first = 0 if whole else parameters.base_slice.start
    chosen = determined[(determined >= first) & (determined < width)]
    if not len(chosen):
        return fit.theta.copy(), 0.0, 0
    S = fit.covariance[np.ix_(chosen, chosen)]
    scale = np.sqrt(np.diag(S))
    scale[scale == 0] = 1.0
    root = linalg.cholesky(S / np.outer(scale, scale) + 1e-10 * np.eye(len(S)), lower=True)  # singular or not
    white = linalg.solve_triangular(root, np.diag(1.0 / scale), lower=True)
    A = np.zeros((len(chosen), width))
    A[:, chosen] = white
    target = A @ fit.theta[:width]
    arm = plausible_arm(
        geometry_of(model.design.machine), parameters.base, parameters.drives, [np.column_stack([A, target])]
    )
    information = np.sum(np.hstack([A[:, : arm.drives], A[:, arm.drives :] @ arm.of_motors]) ** 2, axis=0)
    signed = np.full(len(arm.own), whole)
    signed[[n for n, name in enumerate(parameters.drives) if name == "f_0"]] = False
    arm = replace(arm, own=_LOOSE * information, signed=signed, below=_LOOSE)
    theta = fit.theta.copy()
    found = arm.optimum(A, target, weight=ALONE).theta
    found[: arm.drives] = np.where(signed[: arm.drives], found[: arm.drives].clip(0), found[: arm.drives])
    theta[chosen] = found[chosen]
    # Parameters that nothing is asked of follow by their correlation.
    others = np.setdiff1d(determined, chosen)
    moved = white @ (theta[chosen] - fit.theta[chosen])
    theta[others] += fit.covariance[np.ix_(others, chosen)] @ (white.T @ moved)
    return theta, float(moved @ moved), len(chosen)


def physics(design: Design, model: Model) -> Physics:
    """Return :func:`plausibility` for the stage: what cannot be, and the constrained fit with its price in error.

    The price is, per role, by how many percent the root mean square of the joints' errors becomes larger.
    """
    found = plausibility(model)
    violations = tuple(asdict(v) for v in found.violations)
    if found.theta is None:
        return Physics(violations)
    free, bound = (errors_of(design, theta, model.extra)[0] for theta in (model.fit.theta, found.theta))
    shares = {role: in_floors(bound[f"{role}_rms"], free[f"{role}_rms"]) for role in ("train", "validate")}
    price = {role: None if share is None else 100.0 * (share - 1.0) for role, share in shares.items()}
    return Physics(violations, Constrained(found.theta, bound, price))
