"""Mistakes that are estimated and not tried: the clock of the efforts, that of all rows, and the areas of a cylinder.

*Offset and rate.* A late sensor is an effect; a bus whose clock is not that of the other one makes all of its channels
late by the same time, or by one that grows. Both are estimated for each joint alone, with everything else of it free:
an effort that is late by ``d0 + d1 t`` is, to first order, ``y - (d0 + d1 t) y'``; the efforts are moved by what was
found and the rest is estimated again.

*Rows.* Rows that are ``k`` times closer in time than in the file make speeds ``k`` and accelerations ``k^2`` times
too small. Gravity, and friction that follows the speed's sign, are what they were: every inertia comes out ``k^2``
times too large beside the weight of the same arm. What an arm of that weight has for inertias is taken from the machine
file alone: rods along the links, masses in proportion to length. A geared motor turns more than its link does, by some
tens at a wrist; no arm has that at every joint.

*Bore and rod.* The one thing that a single cylinder shows of them is what its rod side weighs against its head. The
effort is ``A1 (p1 - (A2/A1) p2)``. A scale common to both areas is absorbed by the masses; their ratio is not, because
back-pressure changes for reasons of its own. It is estimated with everything else of the joint free::

    A1 p1 - known = rho A2 p2 + (body, friction, constant, spring, delay)

and nominal is ``rho = 1``. Gains of single transducers (an effect) reach ten per cent each. Back pressure of valves in
one direction of motion and friction that grows with the pressures (other effects) move the ratio too; where one of them
alone explains more, the ratio is only a remark.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.arm.dynamics import rigid_body_regressor
from fitting.arm.geometry import geometry_of
from fitting.arrays import BoolArray, FloatArray
from fitting.checks.findings import Finding, finding_of
from fitting.checks.mistakes.hypothesis import CLEAR
from fitting.checks.mistakes.physical import (
    RIVALS,
    Trial,
    declared,
    fit,
    friction,
    joint_columns,
    measured_effort,
    without,
)
from fitting.checks.mistakes.samples import Samples
from fitting.checks.mistakes.trials import SOUND
from fitting.regression.plausible_arm import rods, standard_of_bodies

#: Standard errors are of coloured residuals: a third as many samples as rows in each direction count.
_COLOURED = 3.0
_ITERATIONS = 4
#: s from which the estimate begins as well, where efforts are left unexplained by more than this (geometric mean).
STARTS, _BADLY = (-1.5, -1.0, -0.6, -0.3, 0.3, 0.6, 1.0, 1.5), 0.1
#: s; a common delay below is a filter of the transducers. One joint alone may have a late sensor of 0.1 s.
OFFSET, OFFSET_ALONE = 0.06, 0.25
#: s by which a clock has to run away over the longest recording.
RUNS_AWAY = 0.12
#: Joints agree within this share and so many standard errors; each that counts has this many.
_AGREE, _SIGMAS, _OWN_SIGMAS = 0.3, 4.0, 5.0
#: What is left of the efforts has to fall by this factor (geometric mean of the joints).
_FALLS = 1.3


@dataclass(frozen=True)
class Clock:
    """Efforts late by ``offset + rate * t`` s, with the misfits (geometric means) before and after."""

    offset: float
    rate: float
    before: float
    after: float
    samples: Samples


def clock_of(trial: Trial) -> Clock | None:
    """Find what all joints' efforts are late by; None if they share nothing, or nothing much."""
    rows = [trial.rows(number) for number in range(len(trial.machine.joints))]
    # A shift of the efforts leaves the columns as they are.
    columns = [joint_columns(trial, number)[own] for number, own in enumerate(rows)]

    def estimates(samples: Samples) -> FloatArray:
        return _late_by(replace(trial, samples=samples), rows, columns)

    first = estimates(trial.samples)
    if len(first) == 0:
        return None
    found = _from(0.0, trial.samples, estimates, first)
    if np.exp(np.mean(np.log(first[:, 4]))) > _BADLY:
        # The expansion holds for delays well below a period of the motion; beyond, it has to begin nearby.
        starts = [_from(start, trial.samples, estimates, first) for start in STARTS]
        found = min([own for own in (found, *starts) if own is not None], key=lambda own: own.after, default=None)
    if found is None:
        return None
    least = OFFSET if len(first) > 1 else OFFSET_ALONE
    runs_away = abs(found.rate) * float(trial.samples.since.max(initial=0.0))
    falls = _FALLS if len(first) > 1 else CLEAR
    if found.before < falls * found.after or (abs(found.offset) < least and runs_away < RUNS_AWAY):
        return None
    return found if runs_away > RUNS_AWAY else replace(found, rate=0.0)


def _from(
    start: float, samples: Samples, estimates: Callable[[Samples], FloatArray], first: FloatArray
) -> Clock | None:
    """Find the clock from an initial offset, s; None if the joints do not share one.

    ``estimates`` gives what is left of the delay of moved samples (:func:`_late_by`), ``first`` is that of ``samples``.
    """
    offset, rate, keys, since = start, 0.0, samples.efforts, samples.since
    moved = samples.moved(keys, offset) if start else samples
    found = estimates(moved) if start else first
    if not start and not _shared(found[:, 0], found[:, 1]) and not _shared(found[:, 2], found[:, 3]):
        return None
    for _ in range(_ITERATIONS):
        if len(found) != len(first):
            return None
        faster = _middle(found[:, 2], found[:, 3])
        offset += _middle(found[:, 0], found[:, 1]) - faster * float(since.mean())
        rate += faster
        if abs(offset) > 3.0 or abs(rate) > 0.1:
            return None
        moved = samples.moved(keys, offset + rate * since)
        found = estimates(moved)
    if len(found) != len(first):
        return None
    before, after = (float(np.exp(np.mean(np.log(own[:, 4])))) for own in (first, found))
    return Clock(offset, rate, before, after, moved)


def _middle(values: FloatArray, stds: FloatArray) -> float:
    weights = 1.0 / np.maximum(stds, 1e-9) ** 2
    return float(np.sum(weights * values) / np.sum(weights))


def _shared(values: FloatArray, stds: FloatArray) -> bool:
    """Return whether all joints have the same nonzero number, within their errors."""
    middle = float(np.median(values))
    near = np.abs(values - middle) < np.maximum(_AGREE * abs(middle), _SIGMAS * stds)
    sure = np.abs(values) > _OWN_SIGMAS * stds
    return bool(np.mean(near) >= 0.8 and np.mean(sure) >= 0.5)


def _late_by(trial: Trial, moving: Sequence[BoolArray], columns: Sequence[FloatArray]) -> FloatArray:
    """Estimate rows ``(d0, its error, d1, its error, misfit)`` of the joints that allow it; ``d0`` at mid-time.

    Parameters
    ----------
    trial : with the efforts as they are, or moved
    moving : by joint (T,) samples that its columns are of
    columns : by joint (k, 10 n + 8) of what else its effort is made of
    """
    result = []
    for number, (rows, there) in enumerate(zip(moving, columns, strict=True)):
        own, rows = there[trial.samples.used[rows]], rows & trial.samples.used
        if not declared(trial.machine, trial.samples, number) or np.count_nonzero(rows) < 60:
            continue
        y, slope = measured_effort(trial, number)
        middle = trial.samples.since - trial.samples.since.mean()
        late = without(own, np.column_stack([slope, slope * middle])[rows])
        target = without(own, y[rows])
        gram = late.T @ late
        freedom = np.count_nonzero(rows) - own.shape[1]
        if freedom < 50 or np.linalg.cond(gram) > 1e14:
            continue
        theta = np.linalg.solve(gram, late.T @ target)
        left = target - late @ theta
        errors = _COLOURED * np.linalg.norm(left) / np.sqrt(freedom) * np.sqrt(np.diag(np.linalg.inv(gram)))
        # y is late: y = true - d y', so its coefficient is -d.
        misfit = float(np.linalg.norm(target) / np.linalg.norm(y[rows] - y[rows].mean()))
        result.append((-theta[0], float(errors[0]), -theta[1], float(errors[1]), misfit))
    return np.array(result).reshape(-1, 5)


#: Inertia over the plausible one from which on (or below its inverse) a joint's is impossible, with others and where it
#: is the only one that counts; joints agree within.
_IMPOSSIBLE, _ALONE, _INERTIAS_AGREE = 30.0, 60.0, 20.0
#: Joints whose plausible inertia is a smaller share of the arm's largest are wrists: their motors turn more than they.
_WRIST = 0.03
#: A joint counts whose inertia is known by so many standard errors, one sample in so many independent, and makes up so
#: much of its effort; and a weight that is known so well.
_INERTIA_SIGMAS, _INDEPENDENT, _MAKES_UP = 6.0, 4.0, 0.1
_LEAST_ROWS = 60
#: Share of the strongest below which the efforts show nothing of a pull in some direction.
_HARDLY = 0.01


def inertia_findings(trial: Trial) -> list[Finding]:
    """Report where every joint's inertia is impossible beside the arm's weight, by about one factor."""
    ratios = _inertia_ratios(trial)
    if not len(ratios):
        return []
    logs, least = np.log(ratios), float(np.log(_ALONE if len(ratios) == 1 else _IMPOSSIBLE))
    off = logs.min() > least or logs.max() < -least
    if not off or np.ptp(logs) > np.log(_INERTIAS_AGREE):
        return []
    # Rows whose times are further apart than they were are explained as well as ever, exchanged cables are not.
    if np.nanmax(fit(trial, bounded=False).free) > SOUND:
        return []
    ratio = float(np.exp(np.median(logs)))
    factor = float(np.sqrt(ratio))
    return [finding_of("wrong_rate/inertias", joints=len(ratios), before=ratio, after=1.0, factor=factor, strength=5.0)]


def _inertia_ratios(trial: Trial) -> FloatArray:
    """Compute each determined joint inertia over that of rods of the weight that the efforts carry, (k,)."""
    motion, samples, n = trial.motion, trial.samples, len(trial.machine.joints)
    links = standard_of_bodies(rods(geometry_of(trial.machine)))
    zero = np.zeros_like(motion.q)
    static = rigid_body_regressor(trial.machine, motion.q, zero, zero)
    plausible = np.array([_inertia(trial, joint, static, links) for joint in range(n)])
    # In whichever direction the arm is pulled: where the file has another one, its weight is no smaller for that.
    axes = (float(np.linalg.norm(trial.machine.gravity)) * np.eye(3)).tolist()
    pulled = [trial.machine.model_copy(update={"gravity": tuple(axis)}) for axis in axes]
    pulls = [rigid_body_regressor(machine, motion.q, zero, zero) @ links for machine in pulled]
    gram, shown, found = np.zeros((3, 3)), np.zeros(3), []
    for joint in range(n):
        rows = motion.active[:, joint] & samples.loaded & samples.used
        effort = measured_effort(trial, joint)[0] * motion.r[:, joint]
        if np.count_nonzero(rows) < _LEAST_ROWS or not np.std(effort[rows]) > 0:
            continue
        size = float(np.std(effort[rows]))
        acceleration, x = motion.qdd[rows, joint], motion.x[rows, joint]
        rest = np.column_stack([friction(motion.v[rows, joint], motion.speed_noise[joint]), np.ones(len(x)), x])
        own = static[rows, joint]
        # What the rods weigh of one kilogram, and what the joint's effort shows of it.
        weighed = np.column_stack([*(pull[rows, joint] for pull in pulls), effort[rows]])
        weight = without(np.column_stack([rest, acceleration]), weighed) / size
        gram, shown = gram + weight[:, :3].T @ weight[:, :3], shown + weight[:, :3].T @ weight[:, 3]
        left = without(np.column_stack([rest, own]), np.column_stack([acceleration, effort[rows]]))
        square = float(left[:, 0] @ left[:, 0])
        if not square > 0:
            continue
        inertia = float(left[:, 0] @ left[:, 1]) / square
        noise = float(np.std(left[:, 1] - inertia * left[:, 0])) * np.sqrt(_INDEPENDENT / square)
        if inertia > _INERTIA_SIGMAS * noise and inertia * np.std(acceleration) > _MAKES_UP * size:
            found.append((joint, inertia))
    mass = float(np.linalg.norm(np.linalg.lstsq(gram, shown, rcond=_HARDLY)[0]))
    if not mass > 0:
        return np.zeros(0)
    counted = [(j, own) for j, own in found if plausible[j] > _WRIST * plausible.max()]
    return np.array([own / (mass * plausible[j]) for j, own in counted])


def _inertia(trial: Trial, joint: int, static: FloatArray, links: FloatArray) -> float:
    """Compute an arm's mean joint inertia per kilogram of rods, kg m^2 (kg); ``static`` is its regressor at rest."""
    unit = np.zeros_like(trial.motion.q)
    unit[:, joint] = 1.0
    moved = rigid_body_regressor(trial.machine, trial.motion.q, np.zeros_like(unit), unit)
    return float(np.mean((moved - static)[:, joint] @ links))


#: A ratio this far from the declared one (its logarithm) is no gain of a transducer.
_FAR = 0.17
#: Standard errors that it is away, and factor by which what is left of the effort falls; the same for a remark.
_SIGMAS, _FALLS = 6.0, 1.5
_NOTED_SIGMAS, _NOTED_FALLS = 3.5, 1.1
#: Cylinders are built with rod sides of a fifth to nearly all of the head's area, so no true ratio is beyond these of a
#: declared one; and the joint has to be explained well with it, or far better: else it makes up for what is missing.
_POSSIBLE, _EXPLAINED = (0.15, 6.0), 0.1
#: An effect has more parameters: it has to leave less by this share, but beside areas that no cylinder has (a rod takes
#: some of the head's).
_AS_MUCH = 0.02


@dataclass(frozen=True)
class AreaRatio:
    """Estimated ``rho`` of a joint, its standard error, the misfits, and whether an effect explains more."""

    joint: int
    rho: float
    std: float
    before: float
    after: float
    effect: bool

    @property
    def wrong(self) -> bool:
        """True where bore or rod look wrong, be it only worth a remark."""
        far = self.rho <= 0 or abs(float(np.log(self.rho))) > _FAR
        explained = self.after < _EXPLAINED or self.before > CLEAR * self.after
        possible = _POSSIBLE[0] < self.rho < _POSSIBLE[1] and explained
        return far and possible and self._is(_NOTED_SIGMAS, _NOTED_FALLS)

    @property
    def sure(self) -> bool:
        """True where bore or rod cannot be right, because nothing else explains as much."""
        return self._is(_SIGMAS, _FALLS) and not self.effect

    def _is(self, sigmas: float, falls: float) -> bool:
        return abs(self.rho - 1) > sigmas * self.std and self.before > falls * self.after


def area_ratios(trial: Trial) -> list[AreaRatio]:
    """Estimate the ratios of areas of all joints with both pressures."""
    result = []
    for number, joint in enumerate(trial.machine.joints):
        block = trial.blocks[number]
        names = (f"head_pressure{number}", f"rod_pressure{number}")
        if block is None or joint.cylinder is None or joint.cylinder.rod_area <= 0:
            continue
        if not set(names) <= set(block.side.names):
            continue
        head, rod, known = (block.signals[:, block.side.names.index(name)] for name in (*names, "known"))
        columns = np.hstack([block.body, block.drive])
        y = without(columns, joint.cylinder.head_area * head - known)
        back = without(columns, joint.cylinder.rod_area * rod)
        power = float(back @ back)
        freedom = len(block.side.lever) - columns.shape[1]
        if power <= 0 or freedom < 50:
            continue
        rho = float(y @ back) / power
        left = y - rho * back
        rivals = np.column_stack([without(columns, own) for own in block.rivals.T])
        std = _COLOURED * float(np.linalg.norm(left)) / np.sqrt(power * freedom)
        weights = {names[0]: joint.cylinder.head_area, names[1]: -joint.cylinder.rod_area, "known": -1.0}
        target = block.target(weights)
        size = max(float(target @ block.side.centred @ target), 1e-300) ** 0.5
        before, after = (float(np.linalg.norm(e)) / size for e in (y - back, left))
        asked = 1.0 - _AS_MUCH if rho * joint.cylinder.rod_area < joint.cylinder.head_area else 1.0
        effect = any(_explains_as_much(rivals[:, own], y - back, asked * left) for own in RIVALS)
        result.append(AreaRatio(number, rho, std, before, after, effect))
    return result


def _explains_as_much(columns: FloatArray, before: FloatArray, left: FloatArray) -> bool:
    """Return whether an effect's columns leave less than the ratio of the areas with its one parameter."""
    rest = before - columns @ np.linalg.lstsq(columns, before, rcond=None)[0]
    return bool(np.linalg.norm(rest) < np.linalg.norm(left))
