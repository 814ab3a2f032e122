"""Posterior odds of what bends positions, from the gap between two position sensors of a joint.

The criterion is that of :mod:`fitting.selection.rating`; rows are those of the gap, which no base model explains.
Formulas of geometry and of encoders are exact, so no curve stands beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from fitting.residual.kinematics import GapRows, GapScore
from fitting.selection import priors
from fitting.selection.evidence import log_mean, log_sum, named_evidence


@dataclass(frozen=True)
class RatedGap:
    """An effect with its best shape, and its log posterior odds against nothing (but leftovers of what was found)."""

    score: GapScore
    log_odds: float


def rated_gaps(scores: Sequence[GapScore], rows: GapRows, found: float) -> list[RatedGap]:
    """Explanations, best first.

    Parameters
    ----------
    scores : every shape of every effect
    rows : the gap's rows
    found : chi-square that earlier findings took of this gap
    """
    families: dict[str, list[GapScore]] = {}
    for score in scores:
        families.setdefault(score.effect.id, []).append(score)
    if not families:
        return []
    prior = float(np.log(priors.CATALOGUE / priors.NOTHING / len(families)))
    sizes = priors.amplitudes(float(np.sqrt(max(rows.chi_square, 0.0))))
    left = np.sqrt(max(found, 0.0)) * np.array(priors.EXACT_LEFTOVERS)
    result, leftovers = [], []
    for own in families.values():
        gain, live = np.array([s.gain for s in own]), np.array([float(s.live) for s in own])
        evidence = log_mean(named_evidence(gain, live, sizes)) + [_plausible(s) for s in own]
        best = own[int(np.argmax(evidence))]
        result.append(RatedGap(best, prior + float(log_mean(evidence))))
        if found > 0:
            leftovers.append(
                float(log_mean(named_evidence(np.array([best.gain]), np.array([float(best.live)]), left)[0]))
            )
    nothing = max(0.0, float(log_sum(leftovers) - np.log(len(families)))) if leftovers else 0.0
    return sorted((RatedGap(r.score, r.log_odds - nothing) for r in result), key=lambda r: -r.log_odds)


def _plausible(score: GapScore) -> float:
    """Log share of the posterior where values are plausible, with some left for what nobody thought of."""
    inside = 1.0
    for parameter, value, std in zip(score.effect.parameters, score.values, score.stds, strict=True):
        if std > 0:
            inside *= float(ndtr((parameter.high - value) / std) - ndtr((parameter.low - value) / std))
    return float(np.log((1 - priors.OUTSIDE) * inside + priors.OUTSIDE))
