"""Inertias that are off by one factor at every joint: rows that are another time apart than the file says.

With rows that are ``k`` times closer in time than they are said to be, speeds are ``k`` and accelerations ``k^2`` times
too small; gravity is what it was, and friction that follows the speed's sign too. So every inertia comes out ``k^2``
times too large beside the weight of the same arm. What an arm of that weight has for inertias is taken from the machine
file alone: rods along the links, masses in proportion to length. A geared motor turns more than its link does, by some
tens at a wrist; no arm has that at every joint.
"""

from __future__ import annotations

import numpy as np

from fitting.arm.dynamics import rigid_body_regressor
from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, finding_of
from fitting.checks.mistakes.physical import Trial, fit, friction, measured_effort, without
from fitting.checks.mistakes.trials import SOUND
from fitting.regression.plausible_arm import rods, standard_of_bodies

#: Inertia over the plausible one from which on (or below its inverse) a joint's is impossible, with others and where it
#: is the only one that tells; joints agree within.
_IMPOSSIBLE, _ALONE, _AGREE = 30.0, 60.0, 20.0
#: Joints whose plausible inertia is a smaller share of the arm's largest are wrists: their motors turn more than they.
_WRIST = 0.03
#: A joint counts whose inertia is told by so many standard errors, with one sample in so many independent, and makes up
#: so much of its effort; and a weight that is told so well.
_SIGMAS, _INDEPENDENT, _MAKES_UP = 6.0, 4.0, 0.1
_LEAST_ROWS = 60


def inertia_findings(trial: Trial) -> list[Finding]:
    """A finding where every joint's inertia is impossible beside the arm's weight, by about one factor."""
    ratios = inertia_ratios(trial)
    if not len(ratios):
        return []
    logs, least = np.log(ratios), float(np.log(_ALONE if len(ratios) == 1 else _IMPOSSIBLE))
    off = logs.min() > least or logs.max() < -least
    if not off or np.ptp(logs) > np.log(_AGREE):
        return []
    # Rows that are said to be further apart than they were are explained as well as ever, exchanged cables are not.
    if np.nanmax(fit(trial, bounded=False).free) > SOUND:
        return []
    ratio = float(np.exp(np.median(logs)))
    factor = float(np.sqrt(ratio))
    return [finding_of("wrong_rate/inertias", joints=len(ratios), before=ratio, after=1.0, factor=factor, strength=5.0)]


def inertia_ratios(trial: Trial) -> FloatArray:
    """Inertia of each joint that tells its own, over that of rods of the weight that the efforts carry, (k,)."""
    motion, samples, n = trial.motion, trial.samples, len(trial.machine.joints)
    links = standard_of_bodies(rods(geometry_of(trial.machine)))
    zero = np.zeros_like(motion.q)
    static = rigid_body_regressor(trial.machine, motion.q, zero, zero)
    plausible = np.array([_inertia(trial, joint, static, links) for joint in range(n)])
    weights, found = np.zeros(2), []
    for joint in range(n):
        rows = motion.active[:, joint] & samples.loaded & samples.used
        effort = measured_effort(trial, joint)[0] * motion.r[:, joint]
        if np.count_nonzero(rows) < _LEAST_ROWS or not np.std(effort[rows]) > 0:
            continue
        size = float(np.std(effort[rows]))
        acceleration, x = motion.qdd[rows, joint], motion.x[rows, joint]
        rest = np.column_stack([friction(motion.v[rows, joint], motion.speed_noise[joint]), np.ones(len(x)), x])
        own = static[rows, joint]
        # What the rods weigh of one kilogram, and what the joint's effort says of it.
        weight = without(np.column_stack([rest, acceleration]), np.column_stack([own @ links, effort[rows]]))
        weights += [float(weight[:, 0] @ weight[:, 1]) / size**2, float(weight[:, 0] @ weight[:, 0]) / size**2]
        left = without(np.column_stack([rest, own]), np.column_stack([acceleration, effort[rows]]))
        square = float(left[:, 0] @ left[:, 0])
        if not square > 0:
            continue
        inertia = float(left[:, 0] @ left[:, 1]) / square
        noise = float(np.std(left[:, 1] - inertia * left[:, 0])) * np.sqrt(_INDEPENDENT / square)
        if inertia > _SIGMAS * noise and inertia * np.std(acceleration) > _MAKES_UP * size:
            found.append((joint, inertia))
    mass = weights[0] / weights[1] if weights[1] > 0 else 0.0
    if not mass > 0:
        return np.zeros(0)
    counted = [(j, own) for j, own in found if plausible[j] > _WRIST * plausible.max()]
    return np.array([own / (mass * plausible[j]) for j, own in counted])


def _inertia(trial: Trial, joint: int, static: FloatArray, links: FloatArray) -> float:
    """Mean inertia at a joint of an arm of one kilogram of rods, kg m^2 (kg); ``static`` is its regressor at rest."""
    unit = np.zeros_like(trial.motion.q)
    unit[:, joint] = 1.0
    moved = rigid_body_regressor(trial.machine, trial.motion.q, np.zeros_like(unit), unit)
    return float(np.mean((moved - static)[:, joint] @ links))
