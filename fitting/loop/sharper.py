"""Shapes of effects that were found on pieces, searched once more on all samples.

A moment is known from pieces to the next piece only, and any shape better from hours than from minutes. Candidates of
one shape are put beside each other behind the base and the other terms, all rows folded into one triangle
(:mod:`fitting.regression.streamed`), and each candidate's chi-square is read off its columns there: one walk through
the data for as many values as wanted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fitting.effects.base import Effect
from fitting.regression.prior import Prior, with_prior
from fitting.regression.streamed import folded
from fitting.residual.terms import Model, Term, extra_columns, late_terms

#: Shapes that are moments, s: searched by steps, not by factors.
_MOMENTS = frozenset({"t_0"})
#: Where the search of a moment ends, s, and how many values are tried at once.
_FINEST_MOMENT, _VALUES = 2.0, 17
#: Half widths of the rounds in which other shapes are searched, relative: they were refined on the pieces.
_SPANS = (0.08, 0.02)


def sharpened(model: Model, prior: Prior, reach: float) -> tuple[Term, ...]:
    """The model's terms with their shapes at the best value on all fitted rows near the present one.

    Parameters
    ----------
    model : fitted to a long design (:attr:`fitting.regression.design.Design.stored`)
    reach : s by which a moment may be off: the longest time between two pieces
    """
    terms = list(model.terms)
    for number, term in enumerate(terms):
        if not isinstance(term.content, Effect) or term.rebuilt:
            continue
        for key in (key for key in term.shape if key not in term.discrete):
            for trials in _rounds(key, reach):
                values = sorted({terms[number].shape[key], *trials(terms[number].shape[key])})
                candidates = [
                    replace(terms[number], shape={**terms[number].shape, key: value})
                    for value in values
                    if value >= 0 or key not in _MOMENTS
                ]
                others = [own for n, own in enumerate(terms) if n != number]
                found = chi_squares(model, prior, others, candidates)
                terms[number] = candidates[int(np.argmin(found))]
    return tuple(terms)


def chi_squares(model: Model, prior: Prior, others: Sequence[Term], candidates: Sequence[Term]) -> list[float]:
    """Chi-square of a joint fit of base, ``others`` and one of the candidates, for each of them.

    Columns hold the present model's force; every candidate has as many.
    """
    design = model.design
    extra = extra_columns(design, model.views, [*others, *candidates])
    late = late_terms(others, design.parameters)
    R = folded(design, model.noise, model.fitted, extra, lambda rows: with_prior(rows, design.parameters, prior, late))
    width = len(candidates[0].names(design.parameters.joints))
    fixed = R.shape[1] - 1 - width * len(candidates)
    result = []
    for number in range(len(candidates)):
        own = fixed + width * number + np.arange(width)
        A = R[:, np.concatenate([np.arange(fixed), own])]
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        solution = np.linalg.lstsq(A / scale, R[:, -1], rcond=1e-9)[0]
        result.append(float(np.sum((R[:, -1] - (A / scale) @ solution) ** 2)))
    return result


class _Trials:
    """Values around the present one."""

    def __init__(self, span: float, relative: bool) -> None:
        self._span, self._relative = span, relative

    def __call__(self, present: float) -> list[float]:
        if self._relative:
            return [present * (1 + self._span * k) for k in (-1.0, -0.5, 0.5, 1.0)]
        return [present + float(step) for step in np.linspace(-self._span, self._span, _VALUES)]


def _rounds(key: str, reach: float) -> Iterator[_Trials]:
    if key not in _MOMENTS:
        yield from (_Trials(span, True) for span in _SPANS)
        return
    span = reach
    while span > _FINEST_MOMENT:
        yield _Trials(span, False)
        span *= 2.0 / (_VALUES - 1)
