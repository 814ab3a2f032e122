"""Scores of candidate terms: what each would gain if it were fitted *together with* the base.

With whitened rows ``A`` (base and accepted terms) and ``Q`` an orthonormal basis of their space, a candidate's
columns ``C`` lower the residual's sum of squares by::

    gain = g' S^-1 g,    g = C' e,    S = C'C - (Q'C)'(Q'C),

with ``e`` the residual of the present model: exactly the chi-square that a full refit with the candidate would gain, at
the cost of one small solve. ``S`` is what survives projecting the base out of the candidate.

A direction of ``S`` that survives with less than 1e-4 of its norm is rounding or geometry, and is not used.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import linalg

from fitting.effects.base import Effect
from fitting.residual.laws import Law, laws
from fitting.residual.terms import Model, Term

FloatArray = npt.NDArray[np.float64]

#: Chi-square that one more parameter has to bring to be worth it.
PARAMETER_PRICE = 6.0
_DEAD = 1e-8  # squared: columns survive with at least 1e-4 of their norm


@dataclass(frozen=True)
class Score:
    """One candidate's score.

    Attributes
    ----------
    term : the candidate
    gain : chi-square that the refit gains
    live : number of its directions that survive the projection
    score : gain less the price of its parameters and of the grid it was picked from
    values, stds : its parameters and their standard deviations
    plausible : False where a parameter is outside what is physically possible
    surviving : largest share of a column's norm that survives projecting the base out, 0 to 1
    """

    term: Term
    gain: float
    live: int
    score: float
    values: tuple[float, ...]
    stds: tuple[float, ...]
    plausible: bool
    surviving: float


ColumnCache = dict[tuple[object, ...], FloatArray]


def score_terms(
    model: Model, terms: Sequence[Term], grid: Sequence[int], cache: ColumnCache | None = None
) -> list[Score]:
    """Scores of candidates; ``grid[i]`` is the size of the grid that candidate ``i`` was picked from.

    ``cache`` keeps whitened columns that depend on the measured motion only, between calls with the same design and
    noise.
    """
    cache = {} if cache is None else cache
    result: list[Score | None] = [None] * len(terms)
    local: dict[int, list[int]] = {}
    for number, term in enumerate(terms):
        if term.everywhere:
            parts = [_white_columns(model, [term], joint) for joint in range(len(model.views[0]))]
            result[number] = _score(model, term, grid[number], *_gram(model, parts))
        else:
            local.setdefault(term.joint or 0, []).append(number)
    for joint, numbers in local.items():
        block = _cached_columns(model, [terms[n] for n in numbers], joint, cache)
        norms = np.einsum("ij,ij->j", block, block)
        projection = model.fit.orthonormal[joint].T @ block
        products = block.T @ model.fit.residual[joint]
        start = 0
        for number in numbers:
            width = len(terms[number].names(model.design.parameters.joints))
            part = slice(start, start + width)
            own, shadow = block[:, part], projection[:, part]
            gram = own.T @ own - shadow.T @ shadow
            result[number] = _score(model, terms[number], grid[number], gram, products[part], norms[part])
            start += width
    for views in model.views:
        for view in views:
            view.cache.clear()  # what shapes shared is of no use any more
    return [score for score in result if score is not None]


def _cached_columns(model: Model, terms: Sequence[Term], joint: int, cache: ColumnCache) -> FloatArray:
    """As :func:`_white_columns`, taking from the cache what does not change."""
    keys = [term.key for term in terms]
    fresh = [(term, key) for term, key in zip(terms, keys, strict=True) if key is None or key not in cache]
    made: dict[int, FloatArray] = {}
    if fresh:
        widths = [len(term.names(model.design.parameters.joints)) for term, _ in fresh]
        parts = np.split(_white_columns(model, [term for term, _ in fresh], joint), np.cumsum(widths)[:-1], axis=1)
        for (term, key), part in zip(fresh, parts, strict=True):
            if key is None:
                made[id(term)] = part
            else:
                cache[key] = np.ascontiguousarray(part)
    return np.hstack([made[id(t)] if k is None else cache[k] for t, k in zip(terms, keys, strict=True)])


def _white_columns(model: Model, terms: Sequence[Term], joint: int) -> FloatArray:
    """Whitened columns of terms in one joint's rows, in the order of the fit's rows."""
    design, parts = model.design, []
    for index in model.fitted:
        views = model.views[index]
        full = np.hstack([c[:, joint] if t.everywhere else c for t in terms for c in (t.columns(views),)])
        kept = model.noise.kept(joint, design.blocks[joint][index].keep)
        parts.append(model.noise.whiten(joint, design.bank.reduce(full))[kept])
    block = np.vstack(parts)
    missing = len(model.fit.residual[joint]) - len(block)  # a prior's row knows nothing of candidates
    return np.vstack([block, np.zeros((missing, block.shape[1]))]) if missing else block


def _gram(model: Model, parts: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    together = np.vstack(parts)
    shadow = np.vstack(model.fit.orthonormal).T @ together
    gram = together.T @ together - shadow.T @ shadow
    return gram, together.T @ np.concatenate(model.fit.residual), np.einsum("ij,ij->j", together, together)


def _score(
    model: Model, term: Term, grid: int, gram: FloatArray, products: FloatArray, norms: FloatArray
) -> Score | None:
    scale = np.sqrt(np.maximum(norms, 1e-300))
    if not np.all(np.isfinite(scale)) or np.all(norms <= 1e-20):
        return None
    if len(scale) == 1:
        eigenvalues, vectors = (gram / norms).ravel(), np.ones((1, 1))
    else:
        eigenvalues, vectors = linalg.eigh(gram / np.outer(scale, scale), check_finite=False)
    live = eigenvalues > _DEAD
    if not live.any():
        return None
    turned = vectors[:, live].T @ (products / scale)
    gain = float(np.sum(turned**2 / eigenvalues[live]))
    values = (vectors[:, live] @ (turned / eigenvalues[live])) / scale
    stds = np.sqrt(np.sum(vectors[:, live] ** 2 / eigenvalues[live], axis=1)) / scale
    count = int(np.count_nonzero(live))
    plausible = True
    if isinstance(term.content, Effect):
        plausible = term.content.plausible(values.tolist(), stds.tolist())
    return Score(
        term=term,
        gain=gain,
        live=count,
        score=gain - PARAMETER_PRICE * count - 2.0 * float(np.log(grid)),
        values=tuple(values.tolist()),
        stds=tuple(stds.tolist()),
        plausible=plausible,
        surviving=float(np.sqrt(np.max(np.diag(gram).clip(0) / np.maximum(norms, 1e-300)))),
    )


def catalogue_terms(
    model: Model, effects: Sequence[Effect], joints: Sequence[int] | None = None
) -> tuple[list[Term], list[int]]:
    """Every effect on every joint (default: all) it applies to, in every shape, and each one's grid size."""
    terms: list[Term] = []
    grid: list[int] = []
    machine = model.design.machine
    for effect in effects:
        if effect.machine_wide and not effect.applies(machine, 0):
            continue
        if effect.machine_wide:
            own = [Term(effect, None, shape) for shape in effect.shapes(model.views[model.fitted[0]][0])]
            terms.extend(own)
            grid.extend([len(own)] * len(own))
            continue
        for joint in range(len(machine.joints)) if joints is None else joints:
            if not effect.applies(machine, joint):
                continue
            shapes = effect.shapes(model.views[model.fitted[0]][joint])
            own = [
                Term(effect, joint, {**shape, **({"other": float(others[0])} if others else {})})
                for others in effect.variants(machine, joint)
                for shape in shapes
            ]
            terms.extend(own)
            grid.extend([len(own)] * len(own))
    return terms, grid


def law_terms(model: Model, joints: Sequence[int] | None = None) -> tuple[list[Term], list[int]]:
    """Every spline law of the given joints (default: all)."""
    terms = list(_laws(model, range(len(model.design.machine.joints)) if joints is None else joints))
    return terms, [2] * len(terms)


def _laws(model: Model, joints: Sequence[int]) -> Iterator[Term]:
    for joint in joints:
        for law in laws(model.views, joint, model.fitted):
            assert isinstance(law, Law)
            yield Term(law, joint)
