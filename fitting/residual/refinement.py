"""Refined shapes for the candidate that was chosen: between the grid's points."""

from __future__ import annotations

from dataclasses import replace

from fitting.effects.base import Effect
from fitting.residual.scoring import Score, score_terms
from fitting.residual.terms import Model, Term

#: Relative step at which the search of a shape ends, and factor by which it may leave the grid: the grid spans what is
#: plausible, and a cushion over half of the stroke would be another thing under that name.
_FINEST = 0.004
_BEYOND = 1.25


def refined(model: Model, score: Score) -> Score:
    """Refine the score's shape between the grid's neighbours, one continuous shape parameter after the other.

    Steps are halved from half a value down to :data:`_FINEST` of it: a lightly damped resonance is that narrow. A
    second round, of small steps, follows where parameters pull at each other.
    """
    best = _plain(model, score)
    keys = [key for key in score.term.shape if key not in score.term.discrete]
    limits = {key: _limits(model, score.term, key) for key in keys}
    content = score.term.content
    steps = content.shape_steps if isinstance(content, Effect) else {}
    for first in (0.5, 0.05) if len(keys) > 1 else (0.5,):
        for key in keys:
            best = _searched(model, best, key, min(first, steps.get(key, first)), limits[key])
    return score if best.term == score.term else replace(best, grid=score.grid)


def _limits(model: Model, term: Term, key: str) -> tuple[float, float]:
    """Return the range that a shape may be searched in: the grid's, and somewhat beyond."""
    assert isinstance(term.content, Effect)
    grid = term.content.shapes(model.views[model.fitted[0]][term.joint or 0])
    bounds = [shape[key] * factor for shape in grid if key in shape for factor in (_BEYOND, 1 / _BEYOND)]
    return min(bounds, default=term.shape[key]), max(bounds, default=term.shape[key])


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
