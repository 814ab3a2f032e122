"""Refined shapes for the candidate that was chosen: between the grid's points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.effects.base import Effect
from fitting.residual.scoring import Score, score_terms
from fitting.residual.terms import Model, Term

#: Relative step at which the search of a shape ends, and factor by which it may leave the grid: the grid spans what is
#: plausible, and a cushion over half of the stroke would be another thing under that name.
_FINEST = 0.004
_BEYOND = 1.25


def refined(model: Model, score: Score) -> Score:
    """Refine the score's shape between the grid's neighbours, one continuous shape parameter after the other.

    Steps are halved from those to the grid's neighbours, half a value at most, down to :data:`_FINEST` of it: a lightly
    damped resonance is that narrow. A second round, of small steps, follows where parameters pull at each other.
    """
    best = _plain(model, score)
    grids = {key: _grid(model, score.term, key) for key in score.term.shape if key not in score.term.discrete}
    steps = {key: _to_neighbours(grid, score.term.shape[key]) for key, grid in grids.items()}
    for first in (0.5, 0.05) if len(grids) > 1 else (0.5,):
        for key, grid in grids.items():
            bounds = [value * factor for value in grid for factor in (_BEYOND, 1 / _BEYOND)]
            best = _searched(model, best, key, min(first, steps[key]), (min(bounds), max(bounds)))
    return score if best.term == score.term else replace(best, grid=score.grid)


def _grid(model: Model, term: Term, key: str) -> list[float]:
    """Return the grid's values of a number of a shape; that number alone where the grid has none."""
    assert isinstance(term.content, Effect)
    grid = term.content.shapes(model.views[model.fitted[0]][term.joint or 0])
    return [shape[key] for shape in grid if key in shape] or [term.shape[key]]


def _to_neighbours(grid: Sequence[float], value: float) -> float:
    """Return the larger of the relative steps from a value to the grid's on either side; infinite where it has none."""
    below = max((other for other in grid if other < value), default=value)
    above = min((other for other in grid if other > value), default=value)
    step = max(above - value, value - below)
    return step / abs(value) if step and value else np.inf


def _searched(model: Model, best: Score, key: str, span: float, limits: tuple[float, float]) -> Score:
    while span > _FINEST:
        centre = best.term.shape[key]
        values = [centre * factor for factor in (1 - span, 1 - span / 2, 1 + span / 2, 1 + span)]
        trials = [
            replace(best.term, shape={**best.term.shape, key: value})
            for value in values
            if limits[0] <= value <= limits[1]
        ]
        scores = [s for s in score_terms(model, trials, [1] * len(trials)) if s.plausible]
        best = max([best, *scores], key=lambda s: s.gain)
        span /= 2
    return best


def _plain(model: Model, score: Score) -> Score:
    """Return the score as shapes are compared: without bias correction, known for the grid's shapes only."""
    if score.null is None:
        return score
    plain = score_terms(model, [score.term], [1])
    return plain[0] if plain else score
