"""The valve's model: from command and pressures to the speed of the rod.

For the directions ``i`` = extend, retract, with ``u`` the command over its full range::

    x(t) = 1 / (1 + tau s + (tau s / 2 D)^2)  u(t - (T - tau))
    g(x) = k_i max(|x| - e_i, 0)^c_i                  c_i = 1 unless a curve is earned
    v(t) = sign g(x) f_i(p) - (V_i(s) / (A_i K)) dp_i/dt

A command is held until the next one is sent: on the average that makes it half a cycle later, which is not part of
``T``. The spool's lag ``tau`` is: at 3 Hz their sum alone is well known. It counts nevertheless, as a spool that is
to jump comes to its edge late, and to a farther edge later. ``f_i`` is a law of the pressure
(:mod:`fitting.valve.laws`), the last term the oil that the chamber's pressure takes (``V_i`` its volume, hoses
included). ``k_i``, ``1/K`` and the hoses' part are linear and never negative; ``T``, ``tau``, its damping ``D``,
``e_i`` and all else that bends are the *shape*.

A free curve has a slope that is a polynomial of Bernstein's, ``g' = sum_j k_ij B_j(o)``: no ``k_ij`` is negative, so it
never falls, and a spool that levels out has no corner.

Source: A. Isermann and others on Hammerstein models; G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973 (variable
projection).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.signals.filters import PARTS, delayed, followed
from fitting.signals.splines import free_curve
from fitting.valve.effects import EFFECTS, Drops, ValveEffect
from fitting.valve.laws import LAWS, Bounds
from fitting.valve.rows import Axis

WAYS = ("extend", "retract")
SIGNS = (1.0, -1.0)
Shape = Mapping[str, float]
#: s, and share of the full command: what is searched.
DELAY: Bounds = (0.1, 0.0, 0.8)
LAG: Bounds = (0.04, 0.0, 0.2)
#: Of the spool, of critical: data sheets have 0.7 to 1.
DAMPING: Bounds = (1.0, 0.5, 1.2)
EDGE: Bounds = (0.05, 0.0, 0.6)
_POWER: Bounds = (1.0, 0.4, 3.0)
#: Of full stroke within a cycle, from which on a curve's mean is not the curve at the spool's mean.
FAR = 0.01


@dataclass(frozen=True)
class Structure:
    """Which model it is.

    Attributes
    ----------
    laws : of the pressure, one per direction
    curve : ``line``, ``power`` (an exponent per direction) or ``monotone`` (free, behind an exponent)
    stiffness : whether the oil gives way
    effects : ids of :data:`fitting.valve.effects.EFFECTS`
    """

    laws: tuple[str, str] = ("none", "none")
    curve: str = "line"
    stiffness: bool = False
    effects: tuple[str, ...] = ()

    @property
    def found(self) -> tuple[ValveEffect, ...]:
        """Its effects."""
        return tuple(EFFECTS[own] for own in self.effects)

    def shape(self) -> dict[str, Bounds]:
        """Return numbers to be searched: start, least, largest."""
        numbers = {"delay": DELAY, "lag": LAG, "damping": DAMPING, "edge.extend": EDGE, "edge.retract": EDGE}
        for way, law in zip(WAYS, self.laws, strict=True):
            numbers |= {f"{name}.{way}": bounds for name, bounds in LAWS[law].shape.items()}
            if self.curve != "line":
                numbers[f"power.{way}"] = _POWER
        for effect in self.found:
            numbers |= effect.shape
        return numbers


def columns(axis: Axis, structure: Structure, shape: Shape) -> tuple[tuple[str, ...], FloatArray]:
    """Return linear parameters' names, and their unit share of filtered speed, (M, k)."""
    parts = _parts(axis, structure, shape)
    return tuple(parts), axis.reduced(np.stack(list(parts.values()), axis=1))


def speeds(axis: Axis, structure: Structure, shapes: Sequence[Shape], gains: Mapping[str, float]) -> FloatArray:
    """Compute filtered speeds (M, S) of shapes with equal gains, a column each; an absent gain is none."""
    whole = np.zeros((len(shapes), len(axis.signals)))
    for own, shape in zip(whole, shapes, strict=True):
        for name, part in _parts(axis, structure, shape).items():
            if gains.get(name, 0.0) != 0.0:
                own += gains[name] * part
    return axis.reduced(whole.T)


def _parts(axis: Axis, structure: Structure, shape: Shape) -> dict[str, FloatArray]:
    """Compute each linear parameter's unit speed (N,) before the filters, by its name."""
    return openings(axis, structure, shape) | _undirected(axis, structure, shape["delay"])


def openings(axis: Axis, structure: Structure, shape: Shape) -> dict[str, FloatArray]:
    """Compute each gain's unit speed (N,) before the filters: what the valve passes."""
    result = dict[str, FloatArray]()
    for name, other in zip(WAYS, reversed(WAYS), strict=True):
        own = tuple((key, value) for key, value in shape.items() if not key.endswith(f".{other}"))
        result |= _directed(axis, structure, WAYS.index(name), own)
    return result


@lru_cache(maxsize=4)
def _directed(
    axis: Axis, structure: Structure, way: int, numbers: tuple[tuple[str, float], ...]
) -> Mapping[str, FloatArray]:
    """Compute one direction's openings as speeds (N,): delayed, with pressures and effects."""
    shape, signals = dict(numbers), axis.signals
    more, slower = np.sum([(0.0, 0.0), *(effect.delay(way, shape) for effect in structure.found)], axis=0).tolist()
    late, rate = max(shape["delay"] + more, 0.0), axis.bank.rate_hz
    lag = min(max(shape["lag"] + slower, 0.0), late)
    of_effects = tuple((name, shape[name]) for effect in structure.found for name in effect.shape if name in shape)
    spool = (structure.effects, of_effects, lag * rate, shape["damping"])
    power = shape.get(f"power.{WAYS[way]}", 1.0)
    opened = _land(axis, structure.curve, way, spool, shape[f"edge.{WAYS[way]}"], power)
    factor, moved = SIGNS[way] * _factors(axis, structure, shape, way), (late - lag) * rate
    return {name: factor * delayed(signals.parts, own, moved) for name, own in opened.items()}


@lru_cache(maxsize=4)
def _undirected(axis: Axis, structure: Structure, delay: float) -> dict[str, FloatArray]:
    """Compute what oil stiffness and effects add to the speed (N,), by the balance of the filled chamber."""
    signals, result = axis.signals, dict[str, FloatArray]()
    delayed_way = delayed(signals.parts, signals.last_way, delay * axis.bank.rate_hz)
    share = 0.5 * (1.0 + delayed_way)  # of what the head's balance states of the speed; both state the same at rest
    if structure.stiffness:
        head, rod = signals.rates
        left = np.clip(signals.x, 0.0, axis.cylinder.stroke)
        result["compliance"] = -share * left * head + (1.0 - share) * (axis.cylinder.stroke - left) * rod
        result["hoses"] = -share * head / axis.areas[0] + (1.0 - share) * rod / axis.areas[1]
    for effect in structure.found:
        result |= effect.columns(signals, share, axis.areas)
    return result


#: Effects, their numbers, lag in samples, damping.
_Spool = tuple[tuple[str, ...], tuple[tuple[str, float], ...], float, float]


@lru_cache(maxsize=4)
def _stroke(axis: Axis, spool: _Spool) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute spool places before the delay, (PARTS, N), and mean, least and largest per cycle (N,)."""
    (effects, numbers, samples, damping), u = spool, axis.signals.u
    for effect in effects:
        u = EFFECTS[effect].command(u, dict(numbers))
    fine = followed(axis.signals.parts, u, samples, damping)
    return fine, fine.mean(axis=0), fine.min(axis=0), fine.max(axis=0)


@lru_cache(maxsize=8)
def _land(axis: Axis, curve: str, way: int, spool: _Spool, edge: float, power: float) -> Mapping[str, FloatArray]:
    """Compute the curve's columns (N,) per unit of each gain, up to the largest recorded command.

    Means over each cycle: over its parts where the spool crosses the edge or goes far, else at the spool's mean.
    """
    fine, mean, low, high = _stroke(axis, spool)
    if SIGNS[way] < 0:
        mean, low, high = -mean, -high, -low
    within = (high > edge) & ((low < edge) | ((high - low > FAR) & (curve != "line")))
    far, near = np.flatnonzero(within), np.flatnonzero((mean > edge) & ~within)
    opening = np.maximum(np.append(mean[near], SIGNS[way] * fine[:, far]) - edge, 0.0)
    name = f"gain.{WAYS[way]}"
    if curve == "monotone":
        parts = free_curve(opening, power, max(axis.largest[way] - edge, 1e-6))
        names = [f"{name}.{j}" for j in range(len(parts))]
    else:
        parts, names = [np.power(opening, power) if curve == "power" else opening], [name]
    whole = np.zeros((len(parts), len(mean)))
    for own, out in zip(parts, whole, strict=True):
        out[near], out[far] = own[: len(near)], own[len(near) :].reshape(PARTS, -1).mean(axis=0)
    return dict(zip(names, whole, strict=True))


def _factors(axis: Axis, structure: Structure, shape: Shape, way: int) -> FloatArray:
    """Compute an opening's factors (N,) of pressures and effects, 1 at the reference."""
    law = structure.laws[way]
    factor = _by_law(axis, law, way, tuple(shape[f"{name}.{WAYS[way]}"] for name in LAWS[law].shape))
    for effect in structure.found:
        factor = effect.factor(factor, WAYS[way], axis, _drops(axis, way), shape)
    return factor


@lru_cache(maxsize=4)
def _drops(axis: Axis, way: int) -> Drops:
    signals = axis.signals
    inlet, outlet = signals.supply - signals.inlet[way], signals.inlet[1 - way] - signals.tank
    return inlet / axis.drops[way, 0], outlet / axis.drops[way, 1]


@lru_cache(maxsize=8)
def _by_law(axis: Axis, law: str, way: int, numbers: tuple[float, ...]) -> FloatArray:
    shape = dict(zip(LAWS[law].shape, numbers, strict=True))
    return LAWS[law].factor(*_drops(axis, way), axis.drops[way], shape)


def solved(matrix: FloatArray, speed: FloatArray) -> FloatArray:
    """Solve nonnegative least squares for linear parameters (k,)."""
    scale = np.linalg.norm(matrix, axis=0)
    determined, scale = scale > 0, np.where(scale > 0, scale, 1.0)
    scaled = matrix / scale
    gram = scaled.T @ scaled
    root = np.linalg.cholesky(gram + 1e-10 * np.eye(len(gram)))  # nnls of a few rows, not of thousands
    return np.asarray(determined * scipy.optimize.nnls(root.T, np.linalg.solve(root, scaled.T @ speed))[0] / scale)
