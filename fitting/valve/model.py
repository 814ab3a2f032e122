"""The valve's model: from command and pressures to the speed of the rod.

For the directions ``i`` = extend, retract, with ``u`` the command over its full range::

    x(t) = u(t - T)
    g(x) = k_i max(|x| - e_i, 0)^c_i                  c_i = 1 unless a curve is earned
    v(t) = sign g(x) f_i(p) - (V_i(s) / (A_i K)) dp_i/dt

A command is held until the next one is sent: on the average that makes it half a cycle later, which is not part of
``T``. ``f_i`` is a law of the pressure (:mod:`fitting.valve.laws`), the last term the oil that the chamber's pressure
takes (``V_i`` its volume, hoses included). ``k_i``, ``1/K`` and the hoses' part are linear and never negative; ``T``,
``e_i`` and all else that bends are the *shape*. Any spool's lag is part of ``T``: at 3 Hz they cannot be told apart.

Source: A. Isermann and others on Hammerstein models; G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973 (variable
projection).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import optimize

from fitting.arrays import FloatArray
from fitting.valve.effects import EFFECTS, ValveEffect
from fitting.valve.laws import LAWS, Bounds
from fitting.valve.rows import Axis, Signals

WAYS = ("extend", "retract")
SIGNS = (1.0, -1.0)
Shape = Mapping[str, float]
#: s, and share of the full command: what is searched.
DELAY: Bounds = (0.1, 0.0, 0.8)
EDGE: Bounds = (0.05, 0.0, 0.6)
_POWER: Bounds = (1.0, 0.4, 3.0)
#: Ends of the pieces of a free curve, as share of the way from its edge to the largest command.
PIECES = (0.0, 0.1, 0.25, 0.45, 0.7, 1.0)


@dataclass(frozen=True)
class Structure:
    """Which model it is.

    Attributes
    ----------
    laws : of the pressure, one per direction
    curve : ``line``, ``power`` (an exponent per direction) or ``monotone`` (pieces, none of them falling)
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
        numbers = {"delay": DELAY, "edge.extend": EDGE, "edge.retract": EDGE}
        for way, law in zip(WAYS, self.laws, strict=True):
            numbers |= {f"{name}.{way}": bounds for name, bounds in LAWS[law].shape.items()}
            if self.curve == "power":
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
    signals, result = axis.signals, dict[str, FloatArray]()
    u = signals.u
    for effect in structure.found:
        u = effect.command(u, shape)
    for way, sign in enumerate(SIGNS):
        edge = shape[f"edge.{WAYS[way]}"]
        late = shape["delay"] + sum(effect.delay(way, shape) for effect in structure.found)
        factor = sign * factors(axis, structure, shape, way)
        opened = land(structure, shape, way, np.maximum(sign * u - edge, 0.0), axis.largest[way] - edge)
        for name, own in opened.items():
            result[name] = factor * delayed(signals, own, max(late, 0.0) * axis.bank.rate_hz)
    told = np.sign(delayed(signals, signals.u, shape["delay"] * axis.bank.rate_hz))
    share = 0.5 * (1.0 + told)  # of what the head's balance says of the speed; both say the same at rest
    if structure.stiffness:
        head, rod = signals.rates
        left = np.clip(signals.x, 0.0, axis.cylinder.stroke)
        result["compliance"] = -share * left * head + (1.0 - share) * (axis.cylinder.stroke - left) * rod
        result["hoses"] = -share * head / axis.areas[0] + (1.0 - share) * rod / axis.areas[1]
    for effect in structure.found:
        result |= effect.columns(signals, share, axis.areas)
    for effect in structure.found:
        result = effect.limited(result, signals, shape)
    return tuple(result), axis.reduced(np.stack(list(result.values()), axis=1))


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
    if structure.curve == "power":
        return {name: np.power(opening, shape[f"power.{WAYS[way]}"])}
    if structure.curve == "line":
        return {name: opening}
    ends = np.array(PIECES) * max(reach, 1e-6)
    return {
        f"{name}.{piece}": np.clip(opening - low, 0.0, high - low)
        for piece, (low, high) in enumerate(pairwise(ends.tolist()))
    }


def solved(matrix: FloatArray, speed: FloatArray) -> FloatArray:
    """Linear parameters (k,) of least squares that are not negative."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    scaled = matrix / scale
    gram = scaled.T @ scaled
    root = np.linalg.cholesky(gram + 1e-10 * np.eye(len(gram)))  # nnls of a few rows, not of thousands
    return np.asarray(optimize.nnls(root.T, np.linalg.solve(root, scaled.T @ speed))[0] / scale)
