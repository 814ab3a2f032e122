"""Odds of laws of an unknown effect: any smooth curve of a signal, or one of a few simple formulas.

They are rated with a few functions; a law that is chosen has as many as its curve takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.arrays import FloatArray
from fitting.residual.laws import Law
from fitting.residual.scoring import Score, score_terms
from fitting.residual.simple_formulas import simple_curves
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.decision import Rated
from fitting.selection.evidence import (
    curve_evidence,
    curve_roots,
    expected_curve,
    formula_gains,
    log_mean,
    log_sum,
    named_evidence,
)
from fitting.selection.gains import Sizes
from fitting.selection.trust import Trust
from fitting.signals.splines import spline_knots

#: Basis functions that a law may have in the end: as many as its curve takes.
RESOLUTIONS = (4, 6, 8, 12, 16, 24, 32)
#: Degrees that a surface of two signals may have.
DEGREES = (2, 3, 4, 5)


class RatedLaws:
    """Rates the laws of one signal.

    Parameters
    ----------
    sizes, trust : how large laws can be, and which share of the candidates' gains counts
    """

    def __init__(self, sizes: Sizes, trust: Trust) -> None:
        self._candidates, self._sizes, self._trust = trust.candidates, sizes, trust

    def of_joint(
        self, joint: int, numbers: Sequence[int], scores: Mapping[int, Score], prior: float, covered: set[int]
    ) -> list[Rated]:
        """Rate a joint's laws, each with its log prior odds; ``covered`` are no simple formula by themselves."""
        groups: dict[tuple[int, bool], list[int]] = {}
        for n in numbers:
            groups.setdefault((self._candidates.width(n), n not in covered), []).append(n)
        found = dict[int, list[float]]()
        for (_, simple), own in groups.items():
            found |= zip(own, self._law_evidence(joint, own, scores, simple).tolist(), strict=True)
        ordered = sorted(numbers, key=self._candidates.width)
        rated = ((scores[n], found[n][0], found[n][1]) for n in ordered)
        return [Rated(score, prior + bayes, bayes, prior + bayes, left) for score, bayes, left in rated]

    def of_surface(self, joint: int, score: Score, prior: float, share: float, against: float) -> Rated:
        """Rate a surface of two signals, one of ``score.grid``: each of its coefficients is as free as any.

        Parameters
        ----------
        joint : where it is
        score : beside the model
        prior : log prior odds of a law
        share : of its gain that counts
        against : log odds that leftovers explain laws of this joint
        """
        gain, live = np.array([score.gain * share]), np.array([float(score.live)])
        bayes = float(log_mean(named_evidence(gain, live, priors.amplitudes(self._sizes.limit(score)))[0]))
        bayes -= float(np.log(score.grid))
        left = named_evidence(gain, live, self._sizes.left(joint))[0]
        leftover = float(log_sum(left, weights=priors.LEFTOVER_WEIGHTS))
        odds = prior + bayes - against
        return Rated(score, odds, bayes, odds, leftover, against)

    def _law_evidence(
        self, joint: int, numbers: Sequence[int], scores: Mapping[int, Score], simple: bool
    ) -> FloatArray:
        """Compute log evidence (T, 2) of laws of one width, alone and as what found effects leave.

        A law is any smooth curve, or, where it may be ``simple``, with :data:`priors.SIMPLE` a simple formula.
        """
        grams = np.array([self._trust.of(n) * scores[n].information for n in numbers])
        products = np.einsum("tij,tj->ti", grams, np.array([scores[n].values for n in numbers]))
        roots = curve_roots(len(products[0]), priors.LENGTHS)
        left = self._sizes.left(joint)
        limits = np.array([self._sizes.limit(scores[n]) for n in numbers])
        sizes = priors.amplitudes(float(limits.max()))
        allowed = sizes[None, :] <= np.maximum(limits, priors.SMALLEST)[:, None] * priors.RATIO
        both = np.concatenate([sizes, left])
        found = log_mean(curve_evidence(grams, products, roots, both), axis=1)
        if simple:
            short = [simple_curves(_law(scores[n]).knots) for n in numbers]
            gains, live = formula_gains(grams, products, np.array([curves for curves, _ in short]))
            found = _either(found, _formulas(gains, live, both, short[0][1]))  # of every formula, its share
        bayes, leftover = np.split(found, [len(sizes)], axis=1)
        bayes = log_sum(bayes, weights=allowed / allowed.sum(axis=1, keepdims=True))
        return np.stack([bayes, log_sum(leftover, weights=priors.LEFTOVER_WEIGHTS)], axis=1)


def _law(score: Score) -> Law:
    assert isinstance(score.term.content, Law)
    return score.term.content


def _formulas(gains: FloatArray, live: FloatArray, amplitudes: FloatArray, shares: FloatArray) -> FloatArray:
    """Compute log evidence (T, A) of a law as one of some formulas (F,): gains and live (T, F), shares (F,)."""
    found = named_evidence(gains.ravel(), live.ravel().astype(float), amplitudes)
    return log_sum(found.reshape(*gains.shape, -1), axis=1, weights=shares[:, None])


def _either(curve: FloatArray, formula: FloatArray) -> FloatArray:
    """Compute log evidence (T, A) of laws: any smooth curve, or with chance ``priors.SIMPLE`` a simple formula."""
    return log_sum(np.stack([curve, formula], axis=-1), weights=np.array([1 - priors.SIMPLE, priors.SIMPLE]))


def resolved(model: Model, score: Score) -> Score:
    """Return the law with the most probable number of basis functions, as narrow bumps need many; a curve as smooth
    as is most probable."""
    law = score.term.content
    assert isinstance(law, Law)
    contents: list[Law]
    if isinstance(law, Surface):
        contents = [law] if law.twist else [replace(law, degree=degree) for degree in DEGREES]
    else:
        values = np.concatenate([law.values(model.views[index][score.term.joint or 0]) for index in model.fitted])
        contents = [replace(law, knots=tuple(spline_knots(values, count).tolist())) for count in RESOLUTIONS]
    terms = [replace(score.term, content=content) for content in contents]
    trials = score_terms(model, terms, [score.grid] * len(terms))
    if not trials:
        return score
    gain, live = np.array([s.gain for s in trials]), np.array([float(s.live) for s in trials])
    shown = np.sqrt(np.maximum(gain.max(), 9.0))
    best = trials[int(np.argmax(named_evidence(gain, live, np.array([shown]))[:, 0]))]
    if isinstance(law, Surface):
        return best
    products = best.information @ np.asarray(best.values)
    sizes = priors.amplitudes(max(priors.USUAL_EFFORT, float(np.sqrt(best.gain))))
    expected = expected_curve(best.information, products, priors.LENGTHS, sizes)
    return replace(best, term=replace(best.term, expected=expected))
