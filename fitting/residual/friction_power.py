"""Friction of a fitted model over the speeds that were used: it may only take power from the motion.

Single coefficients mean little: ``f_c``, ``f_v`` and ``f_s`` share a curve, and one may be negative where the others
make up for it. What physics asks is that the whole friction force opposes the motion, ``f(v) v >= 0``, at every speed
that occurred. So the friction force along the motion is averaged over bins of speed,

    f_k = mean of  sgn v (f_c sgn v + f_v v + f_s |v|^(1/3) sgn v + c v + effects of friction)  over bin k,

a linear function of the parameters: its deviation follows from their covariance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.effects.base import Effect, Parity
from fitting.regression.solving import Fit
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term

#: Edges of the bins as shares of the fastest speed, and the share of the moving samples that a bin needs.
_EDGES = np.array([0.0, 0.04, 0.08, 0.15, 0.25, 0.4, 0.6, 0.8, 1.0])
_LEAST_SHARE = 0.005
#: Deviations at which one of a joint's bins is surely below zero: once in ten thousand joints by chance.
CERTAIN = -float(scipy.special.ndtri(1e-4 / (len(_EDGES) - 1)))
_FRICTION = ("f_c", "f_v", "f_s")


@dataclass(frozen=True)
class FrictionPower:
    """Mean friction of one joint's drive in bins of speed, as a linear function of all parameters.

    Attributes
    ----------
    joint : its number
    speed : (k,) middle of each bin that occurred, m/s or rad/s
    rows : (k, p) mean of ``sgn v`` times the friction columns
    known : (k,) the part that the machine file gives (damping), N or N m
    """

    joint: int
    speed: FloatArray
    rows: FloatArray
    known: FloatArray

    def force(self, theta: FloatArray) -> FloatArray:
        """Return the friction against the motion in each bin, (k,); negative where it drives."""
        return np.asarray(self.rows @ theta + self.known)

    def std(self, covariance: FloatArray) -> FloatArray:
        """Return its standard deviations, (k,)."""
        return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", self.rows, covariance, self.rows).clip(0)))


def friction_power(model: Model, joint: int) -> FrictionPower:
    """Compute the friction of a joint along the motions that were fitted."""
    machine = model.design.machine
    cylinder = machine.joints[joint].cylinder
    damping = 0.0 if cylinder is None else cylinder.damping
    segments = [model.design.segments[i] for i in model.fitted]
    top = max((float(np.abs(s.v[:, joint]).max()) for s in segments if len(s)), default=0.0)
    bins, count = len(_EDGES) - 1, len(model.fit.theta)
    sums, numbers, speeds = np.zeros((bins, count)), np.zeros(bins), np.zeros(bins)
    places = np.array([column for column, _ in _columns(model, joint, model.fitted[0])], dtype=int)
    for index, segment in zip(model.fitted, segments, strict=True):
        v = segment.v[:, joint]
        moving = ~segment.rest[:, joint]
        bin_of = np.clip(np.searchsorted(_EDGES, np.abs(v) / max(top, 1e-300), side="right") - 1, 0, bins - 1)
        values = [column for _, column in _columns(model, joint, index)]
        if not values or not moving.any():
            continue
        along = np.column_stack(values) * np.sign(v)[:, None]
        for k in range(bins):
            chosen = moving & (bin_of == k)
            sums[k, places] += along[chosen].sum(axis=0)
            numbers[k] += np.count_nonzero(chosen)
            speeds[k] += np.abs(v[chosen]).sum()
    there = numbers > _LEAST_SHARE * max(numbers.sum(), 1.0)
    speed = speeds[there] / numbers[there]
    return FrictionPower(joint, speed, sums[there] / numbers[there][:, None], damping * speed)


@dataclass(frozen=True)
class Driving:
    """The bin of speed in which a joint's friction drives the motion most certainly.

    Attributes
    ----------
    speed : of the bin, m/s or rad/s
    force, std : friction against the motion there (negative), N or N m
    sigmas : deviations below zero
    """

    speed: float
    force: float
    std: float
    sigmas: float


def driving(power: FrictionPower, fit: Fit, most: float) -> Driving | None:
    """Find where friction drives the motion by more than ``most`` deviations; None if nowhere."""
    if not len(power.speed):
        return None
    force, std = power.force(fit.theta), power.std(fit.covariance)
    sigmas = np.where(std > 0, -force / np.where(std > 0, std, 1.0), 0.0)
    worst = int(np.argmax(sigmas))
    if not sigmas[worst] > most:
        return None
    return Driving(float(power.speed[worst]), float(force[worst]), float(std[worst]), float(sigmas[worst]))


def _columns(model: Model, joint: int, index: int) -> Iterator[tuple[int, FloatArray]]:
    """Return a joint's friction columns in a segment at full rate: place among the parameters, (N,)."""
    parameters = model.design.parameters
    block = model.design.blocks[joint][index]
    start = parameters.drive_slice(joint).start
    for number, name in enumerate(parameters.drive[joint]):
        if name in _FRICTION:
            yield start + number, block.own[:, number]  # a joint's own drive parameters come first
    own = model.extra.columns[joint][index]
    for number, term in enumerate(model.terms):
        part = model.term_slice(number)
        if not rubs(term, joint):
            continue
        for place in range(part.start, part.stop):
            column = place - len(parameters)
            yield place, np.zeros(len(block.target)) if own is None else own[:, column]


def rubs(term: Term, joint: int) -> bool:
    """Return whether a term is this joint's friction: its force turns with the direction of motion."""
    if term.joint != joint or term.everywhere:
        return False
    if isinstance(term.content, Law):
        return term.content.signed
    return isinstance(term.content, Effect) and term.content.parity in (Parity.ODD, Parity.NEITHER)
