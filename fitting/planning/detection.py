"""What an excitation can show: the smallest size of each effect, by theory, before or after it was recorded.

The gain of an effect with ``k`` parameters is a chi-square with ``k`` degrees of freedom whose noncentrality is
``lambda^2 = eta^2 S``: its value times the whitened norm of its column that is left when the base model has been
projected out of everything recorded. A test that asks for a gain of ``needed`` therefore finds it with the power

    P(chi2_k(lambda^2) > needed)

(half at about ``lambda^2 = needed``, 95 % at about ``(sqrt(needed) + 1.6)^2``), and the smallest size at a power is
``lambda / sqrt(S)``. The share of a column that survives states which effects a motion can show at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect
from fitting.regression.design import Design, NoiseModel
from fitting.regression.solving import WhiteRows, inverse_root
from fitting.residual.laws import Law
from fitting.residual.terms import Term
from fitting.residual.views import Views

_DEAD = 1e-8  # of a column's own square: what is left of it is rounding
_NOTHING = 1e-20  # square of a lambda per SI unit: a column of rounding errors, as of a neighbour that holds mid-range


def visible_size(needed: float, parameters: int, power: float) -> float:
    """Compute the ``lambda`` at which so many parameters gain more than ``needed`` with probability ``power``.

    Raises
    ------
    ValueError
        If noise alone gains that much so often.
    """
    if not scipy.stats.chi2.sf(needed, parameters) < power < 1:
        raise ValueError(f"a power of {power:g} is not between the level of the test and one")
    high = np.sqrt(needed) + 10.0
    return float(
        scipy.optimize.brentq(
            lambda size: scipy.stats.ncx2.sf(needed, parameters, size**2) - power, 1e-6, high, xtol=1e-6
        )
    )


@dataclass(frozen=True)
class Visibility:
    """Visibility of one effect in a set of recordings.

    Attributes
    ----------
    term : the effect on its joint, in one shape
    parameter, unit : its first parameter that shows at all
    surviving : share of the column's whitened norm that is left when the base is projected out, 0 to 1
    per_unit : ``lambda`` of one unit of the parameter
    parameters : number of its parameters that show
    """

    term: Term
    parameter: str
    unit: str
    surviving: float
    per_unit: float
    parameters: int

    def smallest(self, needed: float, power: float) -> float:
        """Compute a parameter's smallest value (others zero) found with probability ``power``; its unit.

        ``needed`` is the chi-square that accuses. Infinite where nothing survives.
        """
        if self.per_unit <= 0:
            return float("inf")
        return visible_size(needed, max(self.parameters, 1), power) / self.per_unit


def typical_terms(machine: Machine, effects: Sequence[Effect], views: Sequence[DriveView]) -> list[tuple[Term, int]]:
    """List every effect on every joint (of neighbours the next one) in one shape of its grid.

    Each with the number of shapes and neighbours that a search would choose from.
    """
    found = []
    for effect in effects:
        places: list[int | None] = [None] if effect.machine_wide else list(range(len(machine.joints)))
        for place in places:
            joint = place or 0
            if not effect.applies(machine, joint):
                continue
            shapes = list(effect.shapes(views[joint]))
            variants = sorted(effect.variants(machine, joint), key=lambda v: abs(v[0] - joint) if v else 0)
            if not shapes or not variants:
                continue
            other = {"other": float(variants[0][0])} if variants[0] else {}
            found.append((Term(effect, place, {**shapes[len(shapes) // 3], **other}), len(shapes) * len(variants)))
    return found


def visibilities(
    design: Design,
    noise: NoiseModel,
    views: Views,
    rows: Sequence[WhiteRows],
    indices: Sequence[int],
    terms: Sequence[Term],
) -> tuple[Visibility, ...]:
    """Compute the visibility of terms in some segments of a design, of recordings or of planned motions.

    ``rows`` are the base's whitened rows there, with all effects that were added, and a prior's rows at the end.
    """
    root = inverse_root(np.sum([own.A.T @ own.A for own in rows], axis=0))
    projectors = [own.A @ root for own in rows]
    local: dict[int, list[int]] = {}
    result: dict[int, Visibility] = {}
    for number, term in enumerate(terms):
        if term.everywhere:
            parts = [_white(design, noise, views, indices, [term], joint) for joint in range(len(rows))]
            shadow = np.sum([p[: len(c)].T @ c for p, c in zip(projectors, parts, strict=True)], axis=0)
            squares = np.sum([np.einsum("ij,ij->j", c, c) for c in parts], axis=0)
            result[number] = _visibility(term, squares, shadow)
        else:
            local.setdefault(term.joint or 0, []).append(number)
    for joint, numbers in local.items():
        block = _white(design, noise, views, indices, [terms[n] for n in numbers], joint)
        shadow, squares = projectors[joint][: len(block)].T @ block, np.einsum("ij,ij->j", block, block)
        start = 0
        for number in numbers:
            part = slice(start, start + terms[number].width)
            result[number] = _visibility(terms[number], squares[part], shadow[:, part])
            start = part.stop
    for row in views:
        for view in row:
            view.cache.clear()  # what shapes shared is of no use any more
    return tuple(result[number] for number in range(len(terms)))


def _white(
    design: Design, noise: NoiseModel, views: Views, indices: Sequence[int], terms: Sequence[Term], joint: int
) -> FloatArray:
    """Whiten columns of terms in one joint's rows, in the order of the base's."""
    parts = [np.zeros((0, sum(term.width for term in terms)))]
    for index in indices:
        kept = design.kept(noise, joint, index)
        if not kept.any():
            continue  # a joint that rests shows nothing, and has no scales that shapes could be measured by
        full = np.hstack([c[:, joint] if t.everywhere else c for t in terms for c in (t.columns(views[index]),)])
        parts.append(noise.of(joint, design.segments[index].loaded)(design.bank.reduce(full))[kept])
    return np.vstack(parts)


def _visibility(term: Term, squares: FloatArray, shadow: FloatArray) -> Visibility:
    left = np.clip(squares - np.einsum("ij,ij->j", shadow, shadow), 0.0, None)
    shows = (left > _DEAD * squares) & (squares > _NOTHING)
    first = int(np.argmax(shows))
    content = term.content
    name, unit = (
        ("", "N") if isinstance(content, Law) else (content.parameters[first].name, content.parameters[first].unit)
    )
    if not shows.any():
        return Visibility(term, name, unit, 0.0, 0.0, 0)
    return Visibility(
        term=term,
        parameter=name,
        unit=unit,
        surviving=float(np.sqrt(left[first] / squares[first])),
        per_unit=float(np.sqrt(left[first])),
        parameters=int(np.count_nonzero(shows)),
    )
