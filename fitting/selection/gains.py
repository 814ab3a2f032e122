"""A candidate's gain by itself: over its orders and amplitudes, beyond the least to report, and how large it can be."""

from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.bounds import inside, limits
from fitting.regression.solving import inverse_root
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.evidence import DEAD, least_gain, log_sum, named_evidence


def averaged(gain: FloatArray, live: FloatArray, limits: FloatArray) -> FloatArray:
    """Compute log evidence (T,) of exact formulas, amplitudes averaged out up to each one's limit."""
    sizes = priors.amplitudes(float(limits.max(initial=0.0)))
    allowed = sizes[None, :] <= np.maximum(limits, priors.SMALLEST)[:, None] * priors.RATIO
    return log_sum(named_evidence(gain, live, sizes), weights=allowed / allowed.sum(axis=1, keepdims=True))


def orders(score: Score) -> list[tuple[float, int]]:
    """Return gain and live directions of a series' first parameters, one order after the other; else of all at once."""
    effect = score.term.content
    whole = (score.gain, score.live)
    if isinstance(effect, Law) or not effect.series or score.live < 2:
        return [whole]
    products = score.information @ np.asarray(score.free or score.values)
    low, high = limits(effect)
    result = []
    for order in range(1, len(score.values)):
        gram, own = score.information[:order, :order], products[:order]
        root = inverse_root(gram, DEAD)
        if root.shape[1]:
            bounded = inside((low[:order], high[:order]), gram, own, root @ (root.T @ own))
            result.append((float(np.sum((root.T @ own) ** 2)) if bounded is None else bounded.gain, root.shape[1]))
    return [*result, whole]


def margin(score: Score) -> float:
    """Compute a candidate's chi-square gain beyond the least to report its parameters and shapes."""
    return score.gain - least_gain(score.live, score.grid)


def _efforts(model: Model) -> FloatArray:
    """Compute the whitened size of each joint's whole effort, (n,)."""
    sizes = []
    for joint in range(len(model.design.machine.joints)):
        targets = ((index, model.design.blocks[joint][index].reduced_target) for index in model.fitted)
        white = [model.design.white(model.noise, joint, index, target) for index, target in targets]
        sizes.append(np.linalg.norm(np.concatenate(white)))
    return np.array(sizes)


class Sizes:
    """Amplitudes that terms beside a model can have, standard deviations.

    Parameters
    ----------
    model : what is there
    visible : (n,) amplitude per joint of effects that were found
    """

    def __init__(self, model: Model, visible: FloatArray) -> None:
        self._visible = visible
        self._largest = _efforts(model)

    def limit(self, score: Score) -> float:
        """Compute a term's largest amplitude: its visible size when as large as the whole effort."""
        place = score.term.place
        whole = float(np.sqrt(np.sum(self._largest**2))) if place is None else float(self._largest[place])
        return score.surviving * whole

    def left(self, joint: int) -> FloatArray:
        """Compute amplitudes of what found effects leave on a joint; none without findings.

        Without it 4 of 149 cases with findings had one name too many, and one a wrong law; one was better.
        """
        seen = self._visible
        others = float(np.sqrt(max(np.sum(seen**2) - seen[joint] ** 2, 0.0)))
        return float(np.hypot(seen[joint], priors.SPILL * others)) * np.array(priors.LEFTOVERS)
