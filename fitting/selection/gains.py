"""What is believed of a candidate's gain before its evidence is taken: bias, order, sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.bounds import inside, limits
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.evidence import least_gain, log_sum, named_evidence, whitened_parts

#: Gain beyond which no noise in regressors makes it: 17 standard deviations.
BEYOND_BIAS = 300.0


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
        root = whitened_parts(gram)
        if root.shape[1]:
            bounded = inside((low[:order], high[:order]), gram, own, root @ (root.T @ own))
            result.append((float(np.sum((root.T @ own) ** 2)) if bounded is None else bounded.gain, root.shape[1]))
    return [*result, whole]


def shares(numbers: Sequence[int], scores: Mapping[int, Score]) -> dict[int, float]:
    """Return the share of each gain of one explanation to count; shapes without replicas as those with."""
    drawn = {n: scores[n].trusted for n in numbers if scores[n].null is not None}
    law = isinstance(scores[numbers[0]].term.content, Law)
    usual = min(drawn.values()) if drawn and not law else 1.0
    return {n: drawn.get(n, usual) for n in numbers}


def scatter(score: Score) -> float:
    """Return the fitted variance over the theory's by replicas; 1 where none were drawn."""
    return 1.0 if score.null is None else score.null.inflation_along(score.fitted)


def known_bias(score: Score) -> bool:
    """Return whether the regressor noise's share of a gain is known: from replicas, or as it makes none so large."""
    return score.null is not None or score.gain >= BEYOND_BIAS


def margin(score: Score) -> float:
    """Compute a candidate's chi-square gain beyond the least to report its parameters and shapes."""
    return score.gain - least_gain(score.live, score.grid)


def biased_gain(score: Score) -> float:
    """Return the gain before the replicas' bias was taken off, or as it is where none was."""
    if score.null is None:
        return score.gain
    return max(score.gain, float(score.fitted @ score.information @ score.fitted))


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
    failed : (n,) the same of names that did not hold elsewhere: what they lived on is open to a law of that joint
    """

    def __init__(self, model: Model, visible: FloatArray, failed: FloatArray) -> None:
        self._visible, self._failed = visible, failed
        self._largest = _efforts(model)

    def limit(self, score: Score) -> float:
        """Compute a term's largest amplitude: its visible size when as large as the whole effort."""
        place = score.term.place
        whole = float(np.sqrt(np.sum(self._largest**2))) if place is None else float(self._largest[place])
        return score.surviving * whole

    def left(self, joint: int, law: bool = False) -> FloatArray:
        """Compute amplitudes of what found effects leave on a joint; none without findings.

        Without it 4 of 149 cases with findings had one name too many, and one a wrong law; one was better.
        """
        seen = self._visible
        others = float(np.sqrt(max(np.sum(seen**2) - seen[joint] ** 2, 0.0)))
        own = float(np.hypot(seen[joint], priors.SPILL * others))
        return (own if law else float(np.hypot(own, self._failed[joint]))) * np.array(priors.LEFTOVERS)
