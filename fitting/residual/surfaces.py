"""Laws of two measured signals: for what depends on a product, and on neither signal alone.

A surface is a polynomial in each of two signals (tensor products of Bernstein's), alone or times the sign of the
joint's speed. It is only asked for where a law of one signal is about to be added, by quadratics first, and has to be
clearly better.
A twist is the product of both alone: one function, so it is seen where nine are not worth their width, and offered
beside the laws of one signal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView
from fitting.effects.variables import values_of
from fitting.residual.laws import OWN_FORCE, THROUGH_THE_ARM, Law, varies
from fitting.residual.scoring import Score, score_terms
from fitting.residual.terms import Model, Term

_OWN = ("piston_position", "piston_speed", "piston_acceleration", "cylinder_force")
_NEIGHBOUR = ("joint_position", "piston_speed")


@dataclass(frozen=True)
class Surface(Law):
    """A law of two signals on one joint; ``knots`` are the ends of the first signal's range.

    Attributes
    ----------
    second, second_other : the second signal, and the neighbour that has it (None: the joint's own)
    second_range : ends of its range
    twist : True where it is but the product of both signals, each from the middle of its range
    degree : of its polynomials
    """

    second: str = ""
    second_other: int | None = None
    second_range: tuple[float, float] = (0.0, 1.0)
    twist: bool = False
    degree: int = 2

    @property
    def functions(self) -> int:
        """Number of its columns."""
        return 1 if self.twist else (self.degree + 1) ** 2

    @property
    def signals(self) -> tuple[tuple[str, int | None], ...]:
        """The signals that it is a law of, each with its neighbour's number."""
        return (*super().signals, (self.second, self.second_other))

    @property
    def along(self) -> Law:
        """The second signal, as a law of it alone would name it."""
        return Law(self.second, self.second_other, self.signed, self.loaded_only, self.second_range)

    @property
    def uses_model(self) -> bool:
        """True where one of its signals is the model's, not measured."""
        return super().uses_model or self.along.uses_model

    def basis(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Evaluate its functions (N, functions) at both signals, constant beyond their ranges."""
        ends = (self.knots[0], self.knots[-1]), self.second_range
        if self.twist:
            return np.asarray((_share(first, *ends[0]) - 0.5) * (_share(second, *ends[1]) - 0.5))[:, None]
        u, w = _bernstein(first, *ends[0], self.degree), _bernstein(second, *ends[1], self.degree)
        return np.asarray((u[:, :, None] * w[:, None, :]).reshape(len(u), -1))

    def columns(self, view: DriveView) -> FloatArray:
        """Return columns (N, functions)."""
        basis = self.basis(self.values(view), self.along.values(view))
        return self.acting(basis, view)


def second_variable(law: Law, joints: tuple[str, ...]) -> dict[str, str]:
    """Return the report's key for a law's second signal; nothing for a law of one."""
    return {"second_variable": law.along.variable(joints)} if isinstance(law, Surface) else {}


def _share(values: FloatArray, low: float, high: float) -> FloatArray:
    return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))


def _bernstein(values: FloatArray, low: float, high: float, degree: int) -> FloatArray:
    u, k = _share(values, low, high)[:, None], np.arange(degree + 1)
    return np.asarray(scipy.special.comb(degree, k) * u**k * (1 - u) ** (degree - k))


def surfaces(model: Model, joint: int, *, twist: bool = False) -> Iterator[Surface]:
    """List all surfaces of a joint that its recordings show, or all twists."""
    signals: list[tuple[str, int | None]] = [(name, None) for name in _OWN]
    others = [other for other in range(len(model.design.machine.joints)) if other != joint]
    signals += [(name, other) for other in others for name in _NEIGHBOUR]
    views = [model.views[index][joint] for index in model.fitted]
    ranges: dict[tuple[str, int | None], tuple[float, float]] = {}
    for name, other in signals:
        shown = (v for v in views if v.segment.loaded or not _through_the_arm(name, other))
        values = np.concatenate([values_of(v, name, other) for v in shown] or [np.zeros(1)])
        if varies(values):
            ranges[name, other] = (float(values.min()), float(values.max()))
    for (first, other), (second, second_other) in combinations(ranges, 2):
        loaded_only = _through_the_arm(first, other) or _through_the_arm(second, second_other)
        own_force = (OWN_FORCE, None) in ((first, other), (second, second_other))
        for signed in (True,) if own_force else (False, True):
            law = Surface(first, other, signed, loaded_only, ranges[first, other], twist=twist)
            along = ranges[second, second_other]
            yield replace(law, second=second, second_other=second_other, second_range=along)


def _through_the_arm(signal: str, other: int | None) -> bool:
    return other is not None and signal in THROUGH_THE_ARM


def best_surface(model: Model, joint: int, alone: tuple[str, int | None]) -> Score | None:
    """Find the surface that gains most.

    Its first signal is ``alone``, the best law of one signal, where that is among its two; else the one that it varies
    more along.
    """
    terms = [Term(law, joint) for law in surfaces(model, joint)]
    scores = score_terms(model, terms, [len(terms)] * len(terms))
    if not scores:
        return None
    best = max(scores, key=lambda s: s.gain)
    law = best.term.content
    assert isinstance(law, Surface)
    coefficients = np.reshape(best.values, (law.degree + 1, law.degree + 1))
    along = [float(np.sum((coefficients - coefficients.mean(axis=axis, keepdims=True)) ** 2)) for axis in (0, 1)]
    first, second = law.signals
    if first == alone or (second != alone and along[0] >= along[1]):
        return best
    ends = (law.knots[0], law.knots[-1])
    turned = replace(law, signal=law.second, other=law.second_other, knots=law.second_range)
    turned = replace(turned, second=law.signal, second_other=law.other, second_range=ends)
    (again,) = score_terms(model, [replace(best.term, content=turned)], [len(terms)])
    return again
