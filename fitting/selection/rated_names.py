"""Odds of names: formulas, exactly nature's or with a curve of their own signal beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import block_diag

from fitting.arrays import FloatArray, IntArray
from fitting.effects.base import Effect, Parity, signal_of
from fitting.effects.bounds import limits
from fitting.regression.solving import inverse_root
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Term
from fitting.selection import priors
from fitting.selection.decision import Family, Rated, family
from fitting.selection.evidence import (
    DEAD,
    curve_evidence,
    curve_roots,
    joint_evidence,
    log_mean,
    log_means,
    log_sum,
    named_evidence,
)
from fitting.selection.gains import Sizes, averaged, orders
from fitting.selection.trust import Trust

#: Share of a curve that the base has to leave for it to show anything.
FAINT = 0.01
#: Standard deviations of what is expected of a curve beside a name that one may be large.
MOST_BESIDE = 2.0
#: Fewer columns are no curve.
LEAST_CURVE = 4
#: Shapes of a name that are compared with a bent formula, and the least gain for which that can matter.
MOST_SHAPES, SMALLEST_GAIN = 4, 12.0


class RatedNames:
    """Rates effects, and twists, which are rated as names are.

    Parameters
    ----------
    sizes, trust : how large effects can be, and which share of the candidates' gains counts
    laws : numbers of the laws of one signal, by joint, signal, neighbour, sign and load
    overtones : number of a name to the number of its overtone
    """

    def __init__(
        self, sizes: Sizes, trust: Trust, laws: Mapping[tuple[object, ...], int], overtones: Mapping[int, int]
    ) -> None:
        self._candidates, self._model, self._sizes, self._trust = trust.candidates, trust.model, sizes, trust
        self._laws, self._mixed = laws, overtones

    def of_families(
        self, families: Mapping[Family, Sequence[int]], scores: Mapping[int, Score], each: float, law_each: float
    ) -> list[Rated]:
        """Rate each family, with its best shape; ``each`` and ``law_each`` are log priors."""
        exact = self._plain({n: score for n, score in scores.items() if not is_curve(score.term)})
        bent = exact | self._bent(families, scores, exact)
        return self._named(families, scores, [law_each if f[0] == "law" else each for f in families], exact, bent)

    def alone(self, number: int, scores: Mapping[int, Score]) -> Rated:
        """Rate one shape of a name by itself, without replicas."""
        name = family(scores[number].term)
        exact = self._plain({number: scores[number]})
        bent = exact | self._bent({name: [number]}, scores, exact)
        return self._named({name: [number]}, scores, [0.0], exact, bent)[0]

    def _bent(
        self, names: Mapping[Family, Sequence[int]], scores: Mapping[int, Score], exact: Mapping[int, float]
    ) -> dict[int, float]:
        """Compute log evidence, by number, of names whose formula may be off by a smooth curve of their signal."""
        joints: dict[int, list[int]] = {}
        for own in names.values():
            term = scores[own[0]].term
            if not isinstance(term.content, Effect) or term.everywhere or term.joint is None:
                continue
            best = sorted(own, key=lambda n: -scores[n].gain)[:MOST_SHAPES]
            joints.setdefault(term.joint, []).extend(best)
        result: dict[int, float] = {}
        for joint, numbers in joints.items():
            most = max(scores[n].gain for n in numbers)
            near = [n for n in numbers if scores[n].gain > max(0.5 * most, SMALLEST_GAIN)]
            # What nature may hold beside a name's formula: curves of its signal, and its overtone.
            mixed = {n: [*self.own_laws(scores[n].term), *([self._mixed[n]] if n in self._mixed else [])] for n in near}
            beside = {n: [m for m in own if m in scores] for n, own in mixed.items()}
            own_laws = {n: [m for m in own if scores[m].surviving > FAINT] for n, own in beside.items()}
            near = [n for n in near if own_laws[n]]
            if not near:
                continue
            used = sorted({*near, *(m for n in near for m in own_laws[n])})
            S, g = self._candidates.products(self._model, joint, used)
            starts = np.cumsum([0, *(self._candidates.width(n) for n in used)])
            where = {n: np.arange(starts[k], starts[k + 1]) for k, n in enumerate(used)}
            for n in near:
                curves = [where[m] for m in own_laws[n]]
                share, found = self._trust.of(n), []
                for first in _first_terms(scores[n]):
                    into = np.concatenate([where[n][first], *curves])
                    gram, products = share * S[np.ix_(into, into)], share * g[into]
                    found.append(self._with_curves(scores[n], first, gram, products, [len(p) for p in curves]))
                if is_series(scores[n].term) and not _bounded(scores[n].term):
                    found = [float(log_mean(found)), self._smooth(own_laws[n], scores)]
                result[n] = max(float(log_mean(found)), exact[n]) if np.isfinite(found).any() else exact[n]
        return result

    def _smooth(self, laws: Sequence[int], scores: Mapping[int, Score]) -> float:
        """Compute log evidence of what a series represents: a curve of its signal that is smooth all along."""
        found = []
        for law in laws:
            score = scores[law]
            gram = self._trust.of(law) * score.information[None]
            roots = curve_roots(gram.shape[1], priors.LENGTHS)[priors.SMOOTH :]
            sizes = priors.amplitudes(self._sizes.limit(score))
            found.append(log_mean(curve_evidence(gram, gram @ np.asarray(score.values), roots, sizes)[0].ravel()))
        return float(log_mean(found))

    def _leftovers(self, scores: Mapping[int, Score]) -> FloatArray:
        """Compute log evidence (T,) of names as what found effects leave; of what acts everywhere joint by joint."""
        numbers = list(scores)
        parts: dict[int, list[tuple[int, float]]] = {}  # by joint: place of the number, and what of its gain is there
        for place, n in enumerate(numbers):
            score, share = scores[n], self._trust.of(n)
            where = dict(enumerate(score.places)) if score.term.everywhere else {score.term.joint or 0: 1.0}
            for joint, part in where.items():
                parts.setdefault(joint, []).append((place, max(part, 0.0) * score.gain * share))
        live = np.array([float(scores[n].live) for n in numbers])
        total = np.zeros(len(numbers))
        for joint, own in parts.items():
            places, gain = np.array([place for place, _ in own]), np.array([part for _, part in own])
            left = self._sizes.left(joint)
            if left.max() > 0:
                total[places] += log_sum(named_evidence(gain, live[places], left), weights=priors.LEFTOVER_WEIGHTS)
        return total

    def _plain(self, scores: Mapping[int, Score]) -> dict[int, float]:
        """Compute log evidence of names by number, if their formulas are exactly nature's."""
        numbers, own = list(scores), list(scores.values())
        limits = np.array([self._sizes.limit(s) for s in own])
        trust = np.array([self._trust.of(n) for n in numbers])
        series = [orders(s) for s in own]
        found = []
        for order in range(max((len(o) for o in series), default=0)):
            gain = np.array([o[min(order, len(o) - 1)][0] for o in series]) * trust
            live = np.array([float(o[min(order, len(o) - 1)][1]) for o in series])
            found.append(averaged(gain, live, limits))
        counts = np.array([len(o) for o in series])
        weights = np.arange(len(found))[:, None] < counts[None, :]
        total = log_sum(np.array(found), axis=0, weights=weights / counts) if found else np.zeros(0)
        return dict(zip(numbers, total.tolist(), strict=True))

    def _named(
        self,
        families: Mapping[Family, Sequence[int]],
        scores: Mapping[int, Score],
        log_priors: Sequence[float],
        exact: Mapping[int, float],
        bent: Mapping[int, float],
    ) -> list[Rated]:
        if not families:
            return []
        counts = np.array([len(own) for own in families.values()])
        numbers = [n for own in families.values() for n in own]
        believable = np.array([scores[n].log_inside for n in numbers])
        total = np.array([bent[n] for n in numbers]) + believable
        bayes = log_means(total, counts).tolist()
        plain = log_means(np.array([exact[n] for n in numbers]) + believable, counts).tolist()
        ends = np.cumsum(counts).tolist()
        best = [numbers[e - c + int(np.argmax(total[e - c : e]))] for e, c in zip(ends, counts.tolist(), strict=True)]
        left = log_means(self._leftovers({n: scores[n] for n in numbers}), counts).tolist()
        return [
            Rated(scores[n], prior + own, own, prior + simple, leftover)
            for n, prior, own, simple, leftover in zip(best, log_priors, bayes, plain, left, strict=True)
        ]

    def _with_curves(
        self, score: Score, numbers: IntArray, S: FloatArray, g: FloatArray, widths: Sequence[int]
    ) -> float:
        """Compute log evidence of a name with curves of its signal: the name's parameters of these numbers first.

        ``widths`` are the curves'. Beside a curve as well the name's values have to be inside their bounds.
        """
        effect = score.term.content
        assert isinstance(effect, Effect)
        low, high = (bound[numbers] for bound in limits(effect))
        own = inverse_root(S[: len(numbers), : len(numbers)], DEAD)
        k = own.shape[1]
        if k == 0:
            return -np.inf
        sizes = priors.amplitudes(self._sizes.limit(score))
        shown = float(np.sqrt(max(score.gain, priors.SMALLEST**2)))
        near = sizes[np.abs(np.log(sizes / shown)) < 1.5 * np.log(priors.RATIO)]
        near = near if len(near) else sizes[-1:]
        weights = np.log(priors.weights(effect.series))
        pairs = [(a, e) for a in near for e in priors.EPSILONS]
        parts, start = [own[None]], len(numbers)
        for width in widths:
            block = S[start : start + width, start : start + width]
            roots = curve_roots(width, priors.LENGTHS) if width >= LEAST_CURVE else inverse_root(block, DEAD)[None]
            seen = np.einsum("lia,ij,lja->l", roots, block, roots) * len(widths)
            parts.append(roots / np.sqrt(np.maximum(seen, 1e-300))[:, None, None])
            start += width
        T = np.array([block_diag(*(p[min(c, len(p) - 1)] for p in parts)) for c in range(len(priors.LENGTHS))])
        gram, products = T.swapaxes(1, 2) @ S @ T, g @ T
        beyond = gram.shape[1] - k
        scales = np.array([np.r_[np.full(k, a / np.sqrt(k)), np.full(beyond, e * shown)] for a, e in pairs])
        values, beside, first = joint_evidence(gram, products, scales, k)
        values[np.any((first @ own.T < low) | (first @ own.T > high), axis=-1)] = -np.inf
        values = values + np.tile(weights, len(near))
        # A name is what explains most of it: a curve beside it may not be many times what is expected of one.
        values[beside > MOST_BESIDE * np.tile(priors.EPSILONS, len(near)) * shown] = -np.inf
        if not np.isfinite(values).any():
            return -np.inf
        return float(log_mean(log_sum(values) - np.log(len(sizes))))

    def own_laws(self, term: Term) -> list[int]:
        """Return numbers of its signal's laws that an effect's formula may miss: of its parity, one of each sign."""
        effect = term.content
        if not isinstance(effect, Effect):
            return []
        name, other = signal_of(effect.signal(term.shape), term.shape)
        name = "piston_position" if (name, other) == ("joint_position", None) else name  # as laws name it
        odd, even = effect.parity is Parity.ODD, effect.parity is Parity.EVEN
        result = []
        for signed in (False, True):
            if (odd and not signed) or (even and signed):
                continue
            both = [self._laws.get((term.joint, name, other, signed, "", loaded)) for loaded in (False, True)]
            present = [n for n in both if n is not None]
            if present:  # what acts at the joint is gone without a load
                result.append(present[-1] if effect.level == "joint" else present[0])
        return result


def is_series(term: Term) -> bool:
    """Return whether a term is a short series of one joint for any smooth law of its signal."""
    return isinstance(term.content, Effect) and term.content.series and not term.everywhere


def _bounded(term: Term) -> bool:
    """Return whether an effect has bounds, of which a curve knows none: what is beyond them is a law's."""
    assert isinstance(term.content, Effect)
    return bool(np.isfinite(limits(term.content)).any())


def is_curve(term: Term) -> bool:
    """Return whether a term is a law of one signal."""
    return isinstance(term.content, Law) and not isinstance(term.content, Surface)


def _first_terms(score: Score) -> list[IntArray]:
    """Return the numbers of a series' first parameters by order; else of all that no bound holds at zero."""
    numbers = np.arange(len(score.values))
    if is_series(score.term):
        return [numbers[:order] for order in range(1, len(numbers) + 1)]
    return [np.flatnonzero(np.asarray(score.values))]
