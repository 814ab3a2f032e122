"""The valve's model: from command and pressures to the speed of the rod.

For the directions ``i`` = extend, retract, with ``u`` the command over its full range::

    x(t) = 1 / (1 + tau s + (tau s / 2 D)^2)  u(t - (T - tau))
    g(x) = k_i max(|x| - e_i, 0)^c_i                  c_i = 1 unless a curve is earned
    v(t) = sign g(x) f_i(p) - (V_i(s) / (A_i K)) dp_i/dt

A command is held until the next one is sent: on the average that makes it half a cycle later, which is not part of
``T``. The spool's lag ``tau`` is: at 3 Hz their sum alone is well known. It counts nevertheless, as a spool that is
told to jump comes to its edge late, and to a farther edge later. ``f_i`` is a law of the pressure
(:mod:`fitting.valve.laws`), the last term the oil that the chamber's pressure takes (``V_i`` its volume, hoses
included). ``k_i``, ``1/K`` and the hoses' part are linear and never negative; ``T``, ``tau``, its damping ``D``,
``e_i`` and all else that bends are the *shape*.

A free curve has a slope that is a polynomial of Bernstein's, ``g' = sum_j k_ij B_j(o)``: no ``k_ij`` is negative, so it
never falls, and a spool that levels out has no corner.

Source: A. Isermann and others on Hammerstein models; G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973 (variable
projection).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import optimize, special

from fitting.arrays import FloatArray
from fitting.valve.effects import EFFECTS, ValveEffect
from fitting.valve.laws import LAWS, Bounds
from fitting.valve.rows import Axis, Signals

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
#: Degree of a free curve's slope.
DEGREE = 3


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
        """Numbers to be searched: start, least, largest."""
        numbers = {"delay": DELAY, "lag": LAG, "damping": DAMPING, "edge.extend": EDGE, "edge.retract": EDGE}
        for way, law in zip(WAYS, self.laws, strict=True):
            numbers |= {f"{name}.{way}": bounds for name, bounds in LAWS[law].shape.items()}
            if self.curve != "line":
                numbers[f"power.{way}"] = _POWER
        for effect in self.found:
            numbers |= effect.shape
        return numbers

    def with_law(self, way: int, law: str) -> Structure:
        """Another law in one direction."""
        return replace(self, laws=(law, self.laws[1]) if way == 0 else (self.laws[0], law))

    def with_effect(self, effect: str) -> Structure:
        """One effect more."""
        return replace(self, effects=(*self.effects, effect))


def columns(axis: Axis, structure: Structure, shape: Shape) -> tuple[tuple[str, ...], FloatArray]:
    """Names of the linear parameters, and what one of each adds to the filtered speed, (M, k)."""
    names, found = list[str](), list[FloatArray]()
    for way in (0, 1, None):
        others = tuple(f".{name}" for place, name in enumerate(WAYS) if place != way)
        own = tuple((name, value) for name, value in shape.items() if not name.endswith(others))
        block = _block(axis, structure, way, own)
        names += block[0]
        found.append(block[1])
    return tuple(names), np.concatenate(found, axis=1)


@lru_cache(maxsize=16)
def _block(
    axis: Axis, structure: Structure, way: int | None, numbers: tuple[tuple[str, float], ...]
) -> tuple[tuple[str, ...], FloatArray]:
    """Columns of one direction, or of what is no matter of directions; most steps of a search move one direction."""
    signals, shape = axis.signals, dict(numbers)
    result = dict[str, FloatArray]() if way is None else _opened(axis, structure, shape, way)
    if way is None:
        told = delayed(signals, np.sign(signals.u), shape["delay"] * axis.bank.rate_hz)
        share = 0.5 * (1.0 + told)  # of what the head's balance says of the speed; both say the same at rest
        if structure.stiffness:
            head, rod = signals.rates
            left = np.clip(signals.x, 0.0, axis.cylinder.stroke)
            result["compliance"] = -share * left * head + (1.0 - share) * (axis.cylinder.stroke - left) * rod
            result["hoses"] = -share * head / axis.areas[0] + (1.0 - share) * rod / axis.areas[1]
        for effect in structure.found:
            result |= effect.columns(signals, share, axis.areas)
    if not result:
        return (), np.zeros((len(axis.speed), 0))
    return tuple(result), axis.reduced(np.stack(list(result.values()), axis=1))


def _opened(axis: Axis, structure: Structure, shape: Shape, way: int) -> dict[str, FloatArray]:
    """What one unit of each gain of a direction does to the speed (N,)."""
    signals, u = axis.signals, axis.signals.u
    for effect in structure.found:
        u = effect.command(u, shape)
    late = shape["delay"] + sum(effect.delay(way, shape) for effect in structure.found)
    lag = min(shape["lag"], max(late, 0.0))
    edge, sign = shape[f"edge.{WAYS[way]}"], SIGNS[way]
    stroke = sign * followed(signals, u, lag * axis.bank.rate_hz, shape["damping"])
    opened = land(structure, shape, way, np.maximum(stroke - edge, 0.0), axis.largest[way] - edge)
    factor = sign * factors(axis, structure, shape, way)
    moved = max(late - lag, 0.0) * axis.bank.rate_hz
    result = {name: factor * delayed(signals, own, moved) for name, own in opened.items()}
    for effect in structure.found:
        result = effect.limited(result, signals, shape)
    return result


def followed(signals: Signals, u: FloatArray, samples: float, damping: float) -> FloatArray:
    """What a spool makes of a command that is held between samples (N,): its mean over each cycle.

    A spring, a mass and a damper, ``samples`` late on the average; before a stretch it was at rest.
    """
    late = max(samples, 1e-3)
    split = np.sqrt(complex(damping**2 - 1.0, 1e-9))  # two poles, nearly one where it is critically damped
    one, other = (-2.0 * damping / late * (damping + own) for own in (split, -split))
    time = np.arange(3.0 + np.ceil(14.0 / -max(one.real, other.real)))
    gone = other / one * np.exp(one * time) - one / other * np.exp(other * time)
    ramp = time - late + (gone / (one - other)).real
    taps = np.diff(np.diff(ramp), prepend=0.0)
    parts = [u[part] for part in signals.parts]
    return np.concatenate([own[0] + np.convolve(own - own[0], taps)[: len(own)] for own in parts])


def delayed(signals: Signals, u: FloatArray, samples: float) -> FloatArray:
    """What is held between samples (N,), ``samples`` later; each value is the mean of a cycle around it.

    Before the first of a stretch it was the first.
    """
    whole = int(np.floor(samples + 0.5))
    fraction = samples + 0.5 - whole
    index = np.maximum(np.arange(len(u)) - whole, signals.first)
    return np.asarray((1.0 - fraction) * u[index] + fraction * u[np.maximum(index - 1, signals.first)])


def factors(axis: Axis, structure: Structure, shape: Shape, way: int) -> FloatArray:
    """What pressures and effects make of an opening (N,), 1 at the reference."""
    law, signals = LAWS[structure.laws[way]], axis.signals
    own = {name: shape[f"{name}.{WAYS[way]}"] for name in law.shape}
    inlet = (signals.supply - signals.inlet[way]) / axis.drops[way, 0]
    outlet = (signals.outlet[way] - signals.tank) / axis.drops[way, 1]
    factor = law.factor(inlet, outlet, axis.drops[way], own)
    for effect in structure.found:
        factor = effect.factor(factor, WAYS[way], signals, (inlet, outlet), shape, axis.areas)
    return factor


def land(structure: Structure, shape: Shape, way: int, opening: FloatArray, reach: float) -> dict[str, FloatArray]:
    """The curve's columns for one unit of each gain; ``reach`` is how far the largest command is beyond the edge."""
    name = f"gain.{WAYS[way]}"
    if structure.curve == "line":
        return {name: opening}
    power = shape[f"power.{WAYS[way]}"]
    if structure.curve == "power":
        return {name: np.power(opening, power)}
    return {f"{name}.{j}": own for j, own in enumerate(free_curve(opening, power, max(reach, 1e-6)))}


def free_curve(opening: FloatArray, power: float, reach: float) -> list[FloatArray]:
    """The parts (N,) of a free curve: integrals over ``(o / reach)^power`` of Bernstein's polynomials.

    Beyond the largest command that was fitted it goes on as it ends.
    """
    whole = np.power(opening / reach, power)
    share = np.minimum(whole, 1.0)
    tails = [special.comb(DEGREE + 1, i) * share**i * (1.0 - share) ** (DEGREE + 1 - i) for i in range(DEGREE + 2)]
    parts = [np.sum(tails[j + 1 :], axis=0) / (DEGREE + 1) for j in range(DEGREE + 1)]
    return [*parts[:-1], parts[-1] + whole - share]


def solved(matrix: FloatArray, speed: FloatArray) -> FloatArray:
    """Linear parameters (k,) of least squares that are not negative."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    scaled = matrix / scale
    gram = scaled.T @ scaled
    root = np.linalg.cholesky(gram + 1e-10 * np.eye(len(gram)))  # nnls of a few rows, not of thousands
    return np.asarray(optimize.nnls(root.T, np.linalg.solve(root, scaled.T @ speed))[0] / scale)
