"""Nulls of the contenders, by as many replicas as a decision takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.residual.null import Null
from fitting.residual.scoring import Score
from fitting.residual.terms import Model
from fitting.selection.confirm import Signals
from fitting.selection.evidence import least_gain

#: Replicas that are drawn before the decision is looked at again, and how far the gain may be from the least that is
#: said if more are to change it.
LEAST_DRAWS, OPEN = 3, (-10.0, 25.0)


class Draws:
    """Null distributions of terms. One that was drawn stays, whatever model follows: it is noise, not structure.

    Parameters
    ----------
    signals : draws replicas
    most : most replicas for a term; 0 trusts the chi-square
    """

    def __init__(self, signals: Signals, most: int) -> None:
        self._signals, self._most = signals, most
        self._nulls: dict[tuple[object, ...], Null] = {}

    @property
    def wanted(self) -> bool:
        """Whether any replicas may be drawn."""
        return self._most > 0

    def unbiased(self, model: Model, scores: Sequence[Score]) -> list[Score]:
        """Take the bias of noisy regressors off the scores."""
        fresh = [s for s in scores if s.term.label not in self._nulls]
        drawn = 0
        while fresh and drawn < self._most:
            draws = min(LEAST_DRAWS, self._most - drawn)
            more = self._signals.nulls(model, [s.term for s in fresh], draws, drawn)
            for score, null in zip(fresh, more, strict=True):
                known = self._nulls.get(score.term.label)
                if null is not None:
                    self._nulls[score.term.label] = null if known is None else known.joined(null)
            drawn += draws
            known_now = [own for own in map(self._against, scores) if own.plausible]
            best = max((own.gain * own.trusted - least_gain(own.live, own.grid) for own in known_now), default=-np.inf)
            if not OPEN[0] < best < OPEN[1]:
                break  # more draws would not change the decision
        return [self._against(s) for s in scores]

    def _against(self, score: Score) -> Score:
        null = self._nulls.get(score.term.label)
        return score if null is None else score.against(null)
