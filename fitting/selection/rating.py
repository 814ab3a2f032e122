"""What every candidate is worth beside a model: its posterior odds against nothing more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from fitting.effects.base import Effect, Parity
from fitting.residual.laws import Law
from fitting.residual.refinement import refined
from fitting.residual.scoring import Candidates, Score
from fitting.residual.simple_formulas import simple_curves
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model, Term
from fitting.selection import priors
from fitting.selection.decision import by_formula
from fitting.selection.evidence import (
    curve_evidence,
    curve_roots,
    formula_gains,
    joint_evidence,
    log_mean,
    log_sum,
    named_evidence,
    whitened_parts,
)
from fitting.selection.gains import averaged, biased_gain, efforts, known_bias, orders, plausible, shares
from fitting.selection.rated import Family, Rated, family

FloatArray = npt.NDArray[np.float64]

#: Share of a curve that the base has to leave for it to tell of anything.
FAINT = 0.01
#: Standard deviations of what is expected of a curve beside a name that one may be large.
MOST_BESIDE = 2.0
#: Fewer columns are no curve.
LEAST_CURVE = 4
#: Shapes of a name that are compared with a bent formula, and the least gain for which that can matter.
MOST_SHAPES, SMALLEST_GAIN = 4, 12.0


class Rating:
    """Posterior odds of candidates beside a model.

    Parameters
    ----------
    candidates : with their columns
    model : what is there
    visible : (n,) amplitude per joint of effects that were found, standard deviations
    failed : (n,) the same of names that did not hold elsewhere: what they lived on is open to a law of that joint
    """

    def __init__(
        self, candidates: Candidates, model: Model, visible: FloatArray, failed: FloatArray | None = None
    ) -> None:
        self._candidates, self._model, self._visible = candidates, model, visible
        self._failed = np.zeros_like(visible) if failed is None else failed
        self._mixed: dict[int, int] = {}
        self._trust: dict[int, float] = {}
        self._largest = efforts(model)
        self._memo: dict[tuple[str, int], tuple[Score, float, Any]] = {}
        self._laws: dict[tuple[object, ...], int] = {}
        for number, term in enumerate(candidates.terms):
            if isinstance(term.content, Law) and not isinstance(term.content, Surface):
                law = term.content
                self._laws[term.joint, law.signal, law.other, law.signed, law.loaded_only] = number

    def rated(self, scores: Mapping[int, Score]) -> list[Rated]:
        """All explanations with a finite evidence, best first; ``scores`` as :meth:`Candidates.scores` gives them."""
        names: dict[Family, list[int]] = {}
        laws: dict[int, list[int]] = {}
        for number, score in scores.items():
            term = score.term
            if term.is_line:
                continue
            if isinstance(term.content, Law) and not isinstance(term.content, Surface):
                laws.setdefault(term.joint or 0, []).append(number)
            else:
                names.setdefault(family(term), []).append(number)
        self._trust = {}
        for own in (*names.values(), *laws.values()):
            self._trust |= shares(own, scores)
        self._share_bias(names, scores)
        catalogued = sum(f[0] != "law" for f in names)
        unknown = sum(len(own) for own in laws.values()) + len(names) - catalogued
        each = float(np.log(priors.CATALOGUE / priors.NOTHING / max(catalogued, 1)))
        law_each = float(np.log(priors.UNKNOWN / priors.NOTHING / max(unknown, 1)))
        exact = self._plain(scores)
        bent = exact | self._bent(names, scores)
        result = [
            self._named(own, scores, law_each if f[0] == "law" else each, exact, bent) for f, own in names.items()
        ]
        covered = self._covered(names, scores)
        for joint, own in laws.items():
            result += self._curves(joint, own, scores, law_each, covered)
        return by_formula(self._against_leftovers(result))

    def _known(self, kind: str, number: int, score: Score) -> Any:
        """What was computed for this score with the trust that it has now; None otherwise.

        Replicas change the scores of contenders only, and all others are asked again with them.
        """
        known = self._memo.get((kind, number))
        same = known is not None and known[0] is score and known[1] == self._trust.get(number, 1.0)
        return known[2] if same and known is not None else None

    def _keep(self, kind: str, number: int, score: Score, value: Any) -> Any:
        self._memo[kind, number] = score, self._trust.get(number, 1.0), value
        return value

    def _covered(self, names: Mapping[Family, Sequence[int]], scores: Mapping[int, Score]) -> set[int]:
        """Laws that a series of the catalogue stands for: their simple formulas are that name's, not against it."""
        series = [scores[n].term for own in names.values() if _is_series(scores[own[0]].term) for n in own]
        return {n for term in series for n in self._own_laws(term)}

    def _share_bias(self, names: Mapping[Family, Sequence[int]], scores: Mapping[int, Score]) -> None:
        """What noise in the regressors makes of a name it makes of the laws of its joint, as far as they are alike.

        Replicas are few, and their scatter, times a large gain, would decide between two that tell the same. So a
        law's own replicas count for that part of it only which the most similar name does not share.
        """
        joints: dict[int, list[int]] = {}
        for own in names.values():
            drawn = [n for n in own if known_bias(scores[n]) and isinstance(scores[n].term.content, Effect)]
            if drawn and not scores[drawn[0]].term.everywhere:
                best = max(drawn, key=lambda n: scores[n].gain)
                joints.setdefault(scores[best].term.joint or 0, []).append(best)
        for joint, drawn in joints.items():
            near = [n for key, n in self._laws.items() if key[0] == joint and n in scores]
            near = [n for n in near if scores[n].gain > priors.SMALLEST**2]
            drawn = [n for n in drawn if scores[n].gain > priors.SMALLEST**2]
            if not near or not drawn:
                continue
            alike = self._overlap(drawn, near, scores, joint)
            trust = np.array([scores[n].gain * self._trust[n] / biased_gain(scores[n]) for n in drawn])
            for law, most, share in zip(near, np.argmax(alike, axis=0), np.max(alike, axis=0), strict=True):
                self._trust[law] = float(share * trust[most] + (1.0 - share) * self._trust.get(law, 1.0))

    def _overlap(
        self, names: Sequence[int], laws: Sequence[int], scores: Mapping[int, Score], joint: int
    ) -> FloatArray:
        """How alike names and laws are (N, L): the share of either's contribution that the other could make."""
        cross = self._candidates.cross_products(self._model, joint, names, laws)
        first = np.cumsum([0, *(self._candidates.width(n) for n in names)])
        then = np.cumsum([0, *(self._candidates.width(n) for n in laws)])
        roots = {n: whitened_parts(scores[n].information) for n in (*names, *laws)}
        found = np.empty((len(names), len(laws)))
        for row, name in enumerate(names):
            for column, law in enumerate(laws):
                between = cross[first[row] : first[row + 1], then[column] : then[column + 1]]
                found[row, column] = _explained(scores[name], between.T, roots[law]) * _explained(
                    scores[law], between, roots[name]
                )
        return found

    def _against_leftovers(self, rated: Sequence[Rated]) -> list[Rated]:
        """Odds against nothing but what found effects leave: in the direction of any candidate, by its prior."""
        places: dict[int | None, list[Rated]] = {}
        for r in rated:
            places.setdefault(None if r.term.everywhere else r.term.joint, []).append(r)
        result = []
        for own in places.values():
            prior = np.array([r.log_odds - r.log_bayes for r in own])
            for laws in (False, True):  # what did not hold elsewhere under a name is open to a law of its joint
                left = np.array([r.leftover if laws else r.refuted for r in own])
                nothing = max(0.0, float(log_sum(left + prior - log_sum(prior))))
                ours = [r for r in own if isinstance(r.term.content, Law) == laws]
                result += [replace(r, log_odds=r.log_odds - nothing, exact=r.exact - nothing) for r in ours]
        return result

    def _bent(self, names: Mapping[Family, Sequence[int]], scores: Mapping[int, Score]) -> dict[int, float]:
        """Log evidence, by number, of names whose formula may be off by a smooth curve of their own signal."""
        joints: dict[int, list[int]] = {}
        for own in names.values():
            term = scores[own[0]].term
            if not isinstance(term.content, Effect) or term.everywhere or term.joint is None:
                continue
            best = sorted(own, key=lambda n: -scores[n].gain)[:MOST_SHAPES]
            joints.setdefault(term.joint, []).extend(best)
        result: dict[int, float] = {}
        by_order = self._plain({n: scores[n] for own in joints.values() for n in own})
        for joint, numbers in joints.items():
            most = max(scores[n].gain for n in numbers)
            near = [n for n in numbers if scores[n].gain > max(0.5 * most, SMALLEST_GAIN)]
            beside = {n: [m for m in self._beside(n, scores[n].term) if m in scores] for n in near}
            own_laws = {n: [m for m in own if scores[m].surviving > FAINT] for n, own in beside.items()}
            near = [n for n in near if own_laws[n]]
            known = {n: self._known("bent", n, scores[n]) for n in near}
            result |= {n: value for n, value in known.items() if value is not None}
            near = [n for n in near if known[n] is None]
            if not near:
                continue
            used = sorted({*near, *(m for n in near for m in own_laws[n])})
            S, g = self._candidates.products(self._model, joint, used)
            starts = np.cumsum([0, *(self._candidates.width(n) for n in used)])
            where = {n: np.arange(starts[k], starts[k + 1]) for k, n in enumerate(used)}
            for n in near:
                curves = [where[m] for m in own_laws[n]]
                share, found = self._trust.get(n, 1.0), []
                for first in _first_terms(scores[n], where[n]):
                    into = np.concatenate([first, *curves])
                    widths = [len(first), *(len(p) for p in curves)]
                    found.append(self._with_curves(scores[n], share * S[np.ix_(into, into)], share * g[into], widths))
                if _is_series(scores[n].term):
                    found = [float(log_mean(found)), self._smooth(own_laws[n], scores)]
                value = max(float(log_mean(found)), by_order[n]) if np.isfinite(found).any() else by_order[n]
                result[n] = self._keep("bent", n, scores[n], value)
        return result

    def _smooth(self, laws: Sequence[int], scores: Mapping[int, Score]) -> float:
        """Log evidence of what a series stands for: a curve of its signal that is smooth all along."""
        found = []
        for law in laws:
            score = scores[law]
            gram = self._trust.get(law, 1.0) * score.information[None]
            roots = curve_roots(gram.shape[1], priors.LENGTHS)[priors.SMOOTH :]
            sizes = priors.amplitudes(self._limit(score))
            found.append(log_mean(curve_evidence(gram, gram @ np.asarray(score.values), roots, sizes)[0].ravel()))
        return float(log_mean(found))

    def _beside(self, number: int, term: Term) -> list[int]:
        """Numbers of what nature's formula may hold beside a name's own: curves of its signal, and its overtone."""
        return self._own_laws(term) + ([self._mixed[number]] if number in self._mixed else [])

    def sharper(self, rated: Rated, model: Model) -> Rated:
        """The same name with its shape searched between the grid's, and what that is worth.

        Shapes are averaged: a peak that is narrower than the grid holds that much less of what was expected of shapes.
        """
        found = refined(model, rated.score)
        if found is rated.score or found.term == rated.term:
            return rated
        own = self._own_laws(found.term)
        terms = [found.term, rated.term, *(self._candidates.terms[n] for n in own)]
        effect = found.term.content
        overtone = effect.overtone(found.term.shape) if isinstance(effect, Effect) else None
        if overtone is not None:
            terms.append(replace(found.term, shape=overtone))
        small = Candidates(model, terms, [1] * len(terms))
        scores = small.scores(model)
        if 0 not in scores or 1 not in scores:
            return rated
        rating = Rating(small, model, self._visible, self._failed)
        if overtone is not None:
            rating._mixed = {0: len(terms) - 1}
        both = [rating.alone(number, scores) for number in (0, 1)]
        narrow = 0.5 * float(np.log1p(max(0.0, both[0].score.gain - both[1].score.gain)))
        more = both[0].log_bayes - both[1].log_bayes - narrow
        if more <= 0:
            return rated
        exact = max(0.0, both[0].exact - both[1].exact - narrow)
        return Rated(
            replace(found, null=None),
            rated.log_odds + more,
            rated.log_bayes + more,
            rated.exact + exact,
            rated.leftover,
            rated.refuted,
        )

    def alone(self, number: int, scores: Mapping[int, Score]) -> Rated:
        """One shape of a name by itself."""
        name = {family(scores[number].term): [number]}
        exact = self._plain({number: scores[number]})
        bent = exact | self._bent(name, scores)
        return self._named([number], scores, 0.0, exact, bent)

    def _limit(self, score: Score) -> float:
        """Largest amplitude of a term: what can be seen of it when it is as large as the whole effort."""
        place = None if score.term.everywhere else score.term.joint
        whole = float(np.sqrt(np.sum(self._largest**2))) if place is None else float(self._largest[place])
        return score.surviving * whole

    def _left(self, joint: int, law: bool = False) -> FloatArray:
        """Amplitudes of what found effects leave on a joint; none where nothing was found."""
        seen = self._visible
        others = float(np.sqrt(max(np.sum(seen**2) - seen[joint] ** 2, 0.0)))
        own = float(np.hypot(seen[joint], priors.SPILL * others))
        return (own if law else float(np.hypot(own, self._failed[joint]))) * np.array(priors.LEFTOVERS)

    def _as_leftover(self, score: Score, share: float, law: bool) -> float:
        """Log evidence of a name as what found effects leave; of what acts everywhere joint by joint."""
        if not score.term.everywhere:
            parts = {score.term.joint or 0: 1.0}
        else:
            parts = {joint: max(part, 0.0) for joint, part in enumerate(score.places)}
        total = 0.0
        for joint, part in parts.items():
            left = self._left(joint, law)
            if left.max() > 0:
                gain, live = np.array([part * score.gain * share]), np.array([float(score.live)])
                found = named_evidence(gain, live, left)[0]
                total += max(0.0, float(log_sum(found, weights=priors.LEFTOVER_WEIGHTS)))
        return total

    def _plain(self, scores: Mapping[int, Score]) -> dict[int, float]:
        """Log evidence of names by number, if their formulas are exactly nature's."""
        named = [n for n, s in scores.items() if s.term.id != "law" or isinstance(s.term.content, Surface)]
        numbers = [n for n in named if self._known("plain", n, scores[n]) is None]
        own = [scores[n] for n in numbers]
        limits = np.array([self._limit(s) for s in own])
        trust = np.array([self._trust.get(n, 1.0) for n in numbers])
        series = [orders(s) for s in own]
        found = []
        for order in range(max((len(o) for o in series), default=0)):
            gain = np.array([o[min(order, len(o) - 1)][0] for o in series]) * trust
            live = np.array([float(o[min(order, len(o) - 1)][1]) for o in series])
            found.append(averaged(gain, live, limits))
        counts = np.array([len(o) for o in series])
        weights = np.arange(len(found))[:, None] < counts[None, :]
        total = log_sum(np.array(found), axis=0, weights=weights / counts) if found else np.zeros(0)
        for n, value in zip(numbers, total.tolist(), strict=True):
            self._keep("plain", n, scores[n], value)
        return {n: self._known("plain", n, scores[n]) for n in named}

    def _named(
        self,
        numbers: Sequence[int],
        scores: Mapping[int, Score],
        prior: float,
        exact: Mapping[int, float],
        bent: Mapping[int, float],
    ) -> Rated:
        believable = np.array([self._plausible(n, scores[n]) for n in numbers])
        total = np.array([bent[n] for n in numbers]) + believable
        number = numbers[int(np.argmax(total))]
        best = scores[number]
        bayes, plain = float(log_mean(total)), float(log_mean(np.array([exact[n] for n in numbers]) + believable))
        left = self._known("left", number, best)
        if left is None:
            share = self._trust.get(number, 1.0)
            found = tuple(self._as_leftover(best, share, laws) for laws in (True, False))
            left = self._keep("left", number, best, found)
        leftover, refuted = left
        return Rated(best, prior + bayes, bayes, prior + plain, leftover, refuted)

    def _plausible(self, number: int, score: Score) -> float:
        known = self._known("plausible", number, score)
        return float(self._keep("plausible", number, score, plausible(score)) if known is None else known)

    def _with_curves(self, score: Score, S: FloatArray, g: FloatArray, widths: Sequence[int]) -> float:
        """Log evidence of a name, with curves of its signal beside it; columns are the name's, then each curve's.

        Of a series, ``S`` and ``g`` may hold its first terms only.
        """
        effect = score.term.content
        assert isinstance(effect, Effect)
        own = whitened_parts(S[: widths[0], : widths[0]])
        k = own.shape[1]
        if k == 0:
            return -np.inf
        sizes = priors.amplitudes(self._limit(score))
        shown = float(np.sqrt(max(score.gain, priors.SMALLEST**2)))
        near = sizes[np.abs(np.log(sizes / shown)) < 1.5 * np.log(priors.RATIO)]
        near = near if len(near) else sizes[-1:]
        weights = np.log(priors.weights(effect.series))
        pairs = [(a, e) for a in near for e in priors.EPSILONS]
        found = []
        for length in range(len(priors.LENGTHS)):
            parts, start = [], widths[0]
            for width in widths[1:]:
                block = S[start : start + width, start : start + width]
                root = curve_roots(width, priors.LENGTHS)[length] if width >= LEAST_CURVE else whitened_parts(block)
                seen = float(np.trace(root.T @ block @ root)) * (len(widths) - 1)
                parts.append(root / np.sqrt(max(seen, 1e-300)))
                start += width
            T = block_diag(own, *parts)
            gram, products = T.T @ S @ T, T.T @ g
            scales = np.array([np.r_[np.full(k, a / np.sqrt(k)), np.full(len(gram) - k, e * shown)] for a, e in pairs])
            values, beside = joint_evidence(gram, products, scales, k)
            values = values + np.tile(weights, len(near))
            # A name is what explains most of it: a curve beside it may not be many times what is expected of one.
            values[beside > MOST_BESIDE * np.tile(priors.EPSILONS, len(near)) * shown] = -np.inf
            found.append(log_sum(values) - np.log(len(sizes)))
        return float(log_mean(found)) if np.isfinite(found).any() else -np.inf

    def _own_laws(self, term: Term) -> list[int]:
        """Numbers of the laws of its signal that an effect's formula may be off by: of its parity, one of each sign."""
        effect = term.content
        if not isinstance(effect, Effect):
            return []
        name, other = _signal(term)
        odd, even = effect.parity is Parity.ODD, effect.parity is Parity.EVEN
        result = []
        for signed in (False, True):
            if (odd and not signed) or (even and signed):
                continue
            both = [self._laws.get((term.joint, name, other, signed, loaded)) for loaded in (False, True)]
            present = [n for n in both if n is not None]
            if present:  # what acts at the joint is gone without a load
                result.append(present[-1] if effect.level == "joint" else present[0])
        return result

    def _curves(
        self, joint: int, numbers: Sequence[int], scores: Mapping[int, Score], prior: float, covered: set[int]
    ) -> list[Rated]:
        """Laws of a joint, with the log prior odds of each; ``covered`` are no simple formula by themselves."""
        result: list[Rated] = []
        for width in sorted({self._candidates.width(n) for n in numbers}):
            alike = [n for n in numbers if self._candidates.width(n) == width]
            result += self._of_width(joint, alike, scores, prior, covered)
        return result

    def _of_width(
        self, joint: int, numbers: Sequence[int], scores: Mapping[int, Score], prior: float, covered: set[int]
    ) -> list[Rated]:
        for simple in (True, False):
            fresh = [n for n in numbers if (n not in covered) == simple and self._known("law", n, scores[n]) is None]
            if fresh:
                for n, value in zip(fresh, self._law_evidence(joint, fresh, scores, simple).tolist(), strict=True):
                    self._keep("law", n, scores[n], value)
        result = []
        for n in numbers:
            bayes, leftover = self._known("law", n, scores[n])
            result.append(Rated(scores[n], prior + bayes, bayes, prior + bayes, leftover, leftover))
        return result

    def _law_evidence(
        self, joint: int, numbers: Sequence[int], scores: Mapping[int, Score], simple: bool
    ) -> FloatArray:
        """Log evidence (T, 2) of laws of one width, alone and as what found effects leave.

        A law is any smooth curve, or, where it may be ``simple``, with :data:`priors.SIMPLE` a simple formula.
        """
        grams = np.array([self._trust.get(n, 1.0) * scores[n].information for n in numbers])
        products = np.einsum("tij,tj->ti", grams, np.array([scores[n].values for n in numbers]))
        roots = curve_roots(len(products[0]), priors.LENGTHS)
        left = self._left(joint, law=True)
        limits = np.array([self._limit(scores[n]) for n in numbers])
        sizes = priors.amplitudes(float(limits.max()))
        bayes = log_mean(curve_evidence(grams, products, roots, sizes), axis=1)
        allowed = sizes[None, :] <= np.maximum(limits, priors.SMALLEST)[:, None] * priors.RATIO
        leftover = np.zeros((len(numbers), len(left)))
        if left.max() > 0:
            leftover = log_mean(curve_evidence(grams, products, roots, left), axis=1)
        if simple:
            short = [simple_curves(_law(scores[n]).knots) for n in numbers]
            gains, live = formula_gains(grams, products, np.array([curves for curves, _ in short]))
            listed = short[0][1]  # of every formula of the short list, its share
            bayes = _either(bayes, _formulas(gains, live, sizes, listed))
            leftover = _either(leftover, _formulas(gains, live, left, listed)) if left.max() > 0 else leftover
        bayes = log_sum(bayes, weights=allowed / allowed.sum(axis=1, keepdims=True))
        return np.stack([bayes, log_sum(leftover, weights=priors.LEFTOVER_WEIGHTS)], axis=1)


def _law(score: Score) -> Law:
    assert isinstance(score.term.content, Law)
    return score.term.content


def _formulas(gains: FloatArray, live: FloatArray, amplitudes: FloatArray, shares: FloatArray) -> FloatArray:
    """Log evidence (T, A) of a law that is one of a list of formulas (F,): gains and live (T, F), shares (F,)."""
    found = named_evidence(gains.ravel(), live.ravel().astype(float), amplitudes)
    return log_sum(found.reshape(*gains.shape, -1), axis=1, weights=shares[:, None])


def _either(curve: FloatArray, formula: FloatArray) -> FloatArray:
    """Log evidence (T, A) of laws that are any smooth curve, or with the chance ``priors.SIMPLE`` a simple formula."""
    return log_sum(np.stack([curve, formula], axis=-1), weights=np.array([1 - priors.SIMPLE, priors.SIMPLE]))


def _is_series(term: Term) -> bool:
    return isinstance(term.content, Effect) and term.content.series and not term.everywhere


def _first_terms(score: Score, columns: npt.NDArray[np.int64]) -> list[npt.NDArray[np.int64]]:
    """Columns of a series' first terms, one order after the other; else all of them at once."""
    return [columns[:order] for order in range(1, len(columns) + 1)] if _is_series(score.term) else [columns]


def _explained(own: Score, cross: FloatArray, root: FloatArray) -> float:
    """Share of what a candidate contributes that others could: their products with its columns (m, k), their root."""
    values = np.asarray(own.values)
    whole = float(values @ own.information @ values)
    return min(1.0, float(np.sum((root.T @ (cross @ values)) ** 2)) / max(whole, 1e-300))


def _signal(term: Term) -> tuple[str, int | None]:
    """The signal of an effect as laws name it, and the neighbour that has it."""
    assert isinstance(term.content, Effect)
    name = term.content.signal(term.shape)
    if name.startswith("other."):
        return name[6:], int(term.shape["other"])
    return "piston_position" if name == "joint_position" else name, None
