"""Posterior over what bends positions, from the gap between two position sensors of a joint.

Hypotheses are sets: at most one error of geometry or of an encoder, at most one thing that gives way to a force, at
most one law of something else. The evidence is that of :mod:`fitting.selection.evidence`, on rows that nothing but a
delay between the sensors explains beforehand. Beside each name stands a smooth discrepancy in its own variable; what a
set may leave in any variable, a share of what it explains, is no law.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise, product

import numpy as np
import numpy.typing as npt
from scipy import optimize
from scipy.special import ndtr

from fitting.arrays import FloatArray
from fitting.effects import effects
from fitting.effects.base import Effect, Shape
from fitting.residual.findings import LEAST
from fitting.residual.kinematics import GapColumns, GapLaw, GapRows, GapScore, gap_columns, gap_laws
from fitting.selection import priors
from fitting.selection.evidence import curve_evidence, curve_roots, log_mean, log_sum, whitened_parts
from fitting.selection.posterior import MOST_NAMED

#: Sets whose discrepancies and laws are looked at, by what their formulas alone are worth, beside every single name.
_NEAR = 6
#: Chance of a value that no structure and no encoder has: a compliance below zero, a pin that is off by a decimetre.
_IMPOSSIBLE = 1e-9
#: Share of what a set explains that it may leave in any variable: of a force that a model knows, of
#: geometry, and of a law.
_LEFT_DRIVEN, _LEFT_PLAY, _LEFT_EXACT, _LEFT_LAW = 0.02, 0.1, 0.01, 0.1
#: Rows of what a set leaves beyond noise that say as much as one row of noise.
_ROWS_A_WORD = 5.0
#: Root mean square of whitened rows, about a tenth of the noise of one reading, that a sound sensor's scale may be off.
_LEAST_ROW = 0.25
#: Least share of the other that the smaller of two effects has to be.
_LEAST_BESIDE = 0.01
#: Share of what gives way to a force that nobody's formula has: differences of that size between names beside it are
#: chance.
_CHANCE = 5e-4
#: How far nature is from the formula in its own variable, as share of what it explains; weights are those of physics.
_EPSILONS_DRIVEN, _EPSILONS_EXACT = (0.002, 0.006, 0.015), (0.0005, 0.002, 0.005)
#: Correlation lengths of laws, in sixteenths of the range: a scale's error may repeat a dozen times along it.
_LENGTHS = (0.5, *priors.LENGTHS)
#: Of shapes that differ in a number only every so manieth is tried; chi-square between neighbours above which the
#: number is searched, and how finely, relative to it.
_TRIED, _LEAST_GRID, _FINE = 3, 4.0, 1e-3
#: Correlation length of a discrepancy, in sixteenths of its variable's range.
_SMOOTH = 4.0


@dataclass(frozen=True)
class GapSet:
    """One explanation of a gap: shapes of at most two effects, and at most one law beside them."""

    parts: tuple[GapColumns, ...] = ()
    law: GapLaw | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """What a reader is told of it: effects, and the variable of a law."""
        own = () if self.law is None else (f"{self.law.law.signal}/{self.law.law.other}",)
        return (*(part.effect.id for part in self.parts), *own)


@dataclass(frozen=True)
class GapConclusion:
    """One thing that is said of a gap: an effect (``part``), or else the law of its set.

    Attributes
    ----------
    chosen : the set that it is a member of
    name : as :attr:`GapSet.names` has it
    probability : that it is this; ``rivals`` what else may stand in its place, with probabilities
    """

    chosen: GapSet
    name: str
    part: GapColumns | None
    probability: float
    rivals: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class GapPosterior:
    """Explanations of one joint's gap with their probabilities, the most probable first; each set of names once."""

    rows: GapRows
    sets: tuple[tuple[GapSet, float], ...] = field(default_factory=lambda: ((GapSet(), 1.0),))

    def conclusions(self) -> tuple[GapConclusion, ...]:
        """What is to be said: of the best set, without what the others make doubtful, each member with its rivals."""
        chances = {frozenset(own.names): p for own, p in self.sets}
        best = self.sets[0][0]
        while best.names:
            doubts = {
                name: sum(p for other, p in chances.items() if other <= set(best.names) - {name}) for name in best.names
            }
            worst = max(doubts, key=lambda name: doubts[name])
            if doubts[worst] <= 1.0 - priors.SAID:
                break
            best = next(own for own, _ in self.sets if set(own.names) <= set(best.names) - {worst})
        return tuple(self._conclusion(best, name) for name in best.names)

    def _conclusion(self, best: GapSet, name: str) -> GapConclusion:
        """One member of the best set, and what other sets have in its place, until they reach 95 % together."""
        part = next((part for part in best.parts if part.effect.id == name), None)
        own, others = 0.0, dict[str, float]()
        for other, p in self.sets:
            if name in other.names:
                own += p
                continue
            for instead in (n for n in other.names if n not in best.names):
                others[instead] = others.get(instead, 0.0) + p
        reached, rivals = own, list[tuple[str, float]]()
        for rival, p in sorted(others.items(), key=lambda pair: -pair[1]):
            if reached >= priors.SAID or len(rivals) >= MOST_NAMED - 1 or p < LEAST:
                break
            rivals.append((rival, p))
            reached += p
        return GapConclusion(best, name, part, own, tuple(rivals))

    def scores(self, chosen: GapSet) -> tuple[GapScore, ...]:
        """Values of a set's effects, fitted jointly, and the chi-square that each takes beside the other."""
        if not chosen.parts:
            return ()
        widths = [part.columns.shape[1] for part in chosen.parts]
        C = np.hstack([*(part.columns for part in chosen.parts), *(p.rates for p in chosen.parts), self.rows.base])
        y = self.rows.values - sum(part.beyond for part in chosen.parts)
        scale = np.maximum(np.linalg.norm(C, axis=0), 1e-300)
        inverse = np.linalg.pinv((C / scale).T @ (C / scale), rcond=1e-8, hermitian=True)
        theta = inverse @ ((C / scale).T @ y)
        stds = np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale
        result, start = [], 0
        for part, width in zip(chosen.parts, widths, strict=True):
            own = slice(start, start + width)
            gain = float(theta[own] @ np.linalg.pinv(inverse[own, own], hermitian=True) @ theta[own])
            shown = np.where(np.linalg.norm(part.columns, axis=0) > 0, stds[own], 0.0)
            values = tuple(np.where(shown > 0, theta[own] / scale[own], 0.0).tolist())
            result.append(GapScore(part.effect, self.rows.joint, part.shape, gain, values, tuple(shown.tolist())))
            start += width
        return tuple(result)

    def curve(self, chosen: GapSet) -> tuple[FloatArray, FloatArray, float]:
        """Values and covariance of a set's law beside its effects, and the chi-square that it takes."""
        assert chosen.law is not None
        rows = self.rows
        beside = np.hstack([*(np.hstack([part.columns, part.rates]) for part in chosen.parts), rows.base])
        y = rows.values - sum((part.beyond for part in chosen.parts), np.zeros(len(rows.values)))
        C = rows.whitened([chosen.law.columns(view) for view in rows.views])
        basis = np.linalg.qr(beside / np.maximum(np.linalg.norm(beside, axis=0), 1e-300))[0]
        left, target = C - basis @ (basis.T @ C), y - basis @ (basis.T @ y)
        covariance = np.linalg.pinv(left.T @ left, rcond=1e-8, hermitian=True)
        values = covariance @ (left.T @ target)
        return values, np.asarray(covariance, dtype=float), float(target @ left @ values)


def gap_posterior(rows: GapRows) -> GapPosterior:
    """What a joint's gap says of every set of effects and laws."""
    if not len(rows.values):
        return GapPosterior(rows)
    return GapPosterior(rows, _Evidence(rows).posterior())


class _Evidence:
    """Evidence of sets, all from one Gram matrix of whitened columns less what a delay explains."""

    def __init__(self, rows: GapRows) -> None:
        self._zeros, self._count = np.linalg.qr(rows.zeros)[0], len(rows.values)
        self.parts: list[GapColumns] = []
        self._left: dict[tuple[int, ...], float] = {}
        self._grids: dict[str, float] = {}  # numbers of a grid, of which a shape has one
        self._floor = _LEAST_ROW * float(np.sqrt(self._count))
        self._chi_square: dict[tuple[int, ...], float] = {}
        self.laws = list(gap_laws(rows.views))
        smooth = rows.whitened([self.laws[0].columns(view) for view in rows.views])
        beside = np.linalg.qr(np.hstack([rows.base, rows.zeros, smooth]))[0]
        for effect in effects():
            found = _sharpest(rows, effect, beside)
            self._grids[effect.id] = len(effect.gap_shapes(rows.views[0])) / max(len(found), 1)
            self.parts += found
        columns = [rows.values[:, None], *(p.columns for p in self.parts), *(p.beyond[:, None] for p in self.parts)]
        columns += [part.rates for part in self.parts]
        columns += [rows.whitened([law.columns(view) for view in rows.views]) for law in self.laws]
        basis = np.linalg.qr(rows.base / np.maximum(np.linalg.norm(rows.base, axis=0), 1e-300))[0]
        whole = np.hstack(columns)
        norms = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
        whole = whole - basis @ (basis.T @ whole)
        whole[:, np.linalg.norm(whole, axis=0) < 1e-6 * norms] = 0.0
        self._gram = whole.T @ whole
        ends = np.cumsum([0, *(c.shape[1] for c in columns)])
        places = [np.arange(a, b) for a, b in pairwise(ends)]
        count = len(self.parts)
        self._own, self._beyond, self._rates, self._of_law = (
            places[a * count + 1 : b * count + 1] if b else places[a * count + 1 :]
            for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))
        )
        self._roots = [whitened_parts(self._gram[np.ix_(own, own)]) for own in self._own]
        self._slow = [whitened_parts(self._gram[np.ix_(own, own)]) for own in self._rates]
        self._sizes = priors.amplitudes(float(np.sqrt(self._gram[0, 0])))

    def _beyond_zeros(self, columns: FloatArray) -> FloatArray:
        """Columns (M, k) less what a zero of either sensor explains."""
        return np.asarray(columns - self._zeros @ (self._zeros.T @ columns))

    def posterior(self) -> tuple[tuple[GapSet, float], ...]:
        """Sets with their probabilities; of each set of names its best shapes."""
        alone = [self._named((number,)) for number in range(len(self.parts))]
        if not np.isfinite([*alone, *(odds for _, odds in self._laws(())[0])]).any():
            return ((GapSet(), 1.0),)  # nothing is more than a sound sensor's scale may be off
        screened: dict[tuple[str, ...], list[tuple[float, tuple[int, ...]]]] = {}
        for numbers in self._combinations():
            key = tuple(self.parts[n].effect.id for n in numbers)
            screened.setdefault(key, []).append((self._named(numbers), numbers))
        best = sorted(screened, key=lambda key: -max(screened[key])[0])
        keys = [key for key in screened if len(key) < 2 or key in best[:_NEAR]]
        found: dict[tuple[str, ...], tuple[GapSet, list[float]]] = {}
        for key in keys:
            near = sorted(screened[key], reverse=True)[:_NEAR]
            curved = np.array([self._named(numbers, curved=True) for _, numbers in near])
            prior = self._prior(key) - np.log(len(screened[key])) - sum(np.log(self._grids[name]) for name in key)
            exact, numbers = near[int(np.argmax(curved))]
            own = GapSet(tuple(self.parts[n] for n in numbers))
            laws, leftovers = self._laws(numbers)
            found[own.names] = (own, [prior + max(float(log_sum(curved)), exact + leftovers)])
            for law, odds in laws:
                if any(law.is_of(part.effect.stays_in_gap) for part in own.parts) or not self._stand(numbers, law):
                    continue  # a law of the very variable has the formula in it
                with_law = replace(own, law=law)
                found.setdefault(with_law.names, (with_law, []))[1].append(prior + exact + odds)
        sets = [own for own, _ in found.values()]
        believed = self._believed(sets, [float(log_sum(values)) for _, values in found.values()])
        both = zip(sets, np.exp(believed - float(log_sum(believed))).tolist(), strict=True)
        return tuple(sorted(both, key=lambda pair: -pair[1]))

    def _believed(self, sets: Sequence[GapSet], odds: Sequence[float]) -> FloatArray:
        """Log odds of sets, those of alike ones as far as their formulas are known.

        What the best of them leaves beyond noise is smooth: it says something only every so many rows; and a share of
        what gives way to a force is in nobody's formula. Differences of that size are chance.
        """
        result, places = np.array(odds), dict[str, list[int]]()
        for number, own in enumerate(sets):
            if own.names:
                places.setdefault(next((p.effect.id for p in own.parts if p.effect.stays_in_gap), ""), []).append(
                    number
                )
        for alike in places.values():
            best = max(alike, key=lambda n: odds[n])
            numbers = [next(n for n, part in enumerate(self.parts) if part is own) for own in sets[best].parts]
            law = sets[best].law
            curve = [] if law is None else [self._of_law[self.laws.index(law)]]
            square, products = self._target(numbers)
            left = square - _gain(self._gram, products, np.concatenate([self._places(numbers), *curve]))
            driven = [self._own[n] for n in numbers if self.parts[n].effect.stays_in_gap]
            taken = _gain(self._gram, products, driven[0]) if driven else 0.0
            misfit = 1.0 + _ROWS_A_WORD * max(left / self._count - 1.0, 0.0)
            share = 1.0 / max(misfit, 1.0 + _CHANCE**2 * taken / priors.CLOSE)
            result[alike] = odds[best] - share * (odds[best] - result[alike])
        return result

    def _stand(self, numbers: Sequence[int], law: GapLaw) -> bool:
        """Whether effects take more beside a law than its curve may leave."""
        if not numbers:
            return True
        own = self._places(numbers)
        curve, products = self._of_law[self.laws.index(law)], self._target(numbers)[1]
        alone = _gain(self._gram, products, curve)
        return _gain(self._gram, products, np.concatenate([curve, own])) - alone > _LEFT_LAW**2 * alone

    def _combinations(self) -> Iterator[tuple[int, ...]]:
        numbers = range(len(self.parts))
        geometry: list[int | None] = [None, *(n for n in numbers if not self.parts[n].effect.stays_in_gap)]
        driven: list[int | None] = [None, *(n for n in numbers if self.parts[n].effect.stays_in_gap)]
        for pair in product(geometry, driven):
            yield tuple(n for n in pair if n is not None)

    def _prior(self, key: Sequence[str]) -> float:
        families = len({part.effect.id for part in self.parts})
        return len(key) * float(np.log(priors.CATALOGUE / priors.NOTHING / max(families, 1)))

    def _places(self, numbers: Sequence[int]) -> npt.NDArray[np.intp]:
        """Where shapes have their columns, with their rates."""
        own = [places for n in numbers for places in (self._own[n], self._rates[n])]
        return np.concatenate([np.zeros(0, dtype=np.intp), *own])

    def _target(self, numbers: Sequence[int]) -> tuple[float, FloatArray]:
        """Square of the gap less what formulas have beyond their columns, and its products with all columns."""
        weights = np.zeros(len(self._gram))
        weights[0] = 1.0
        weights[[int(self._beyond[n][0]) for n in numbers]] = -1.0
        products = self._gram @ weights
        return float(weights @ products), products

    def _named(self, numbers: tuple[int, ...], curved: bool = False) -> float:
        """Log evidence of shapes against nothing; ``curved`` with discrepancies in their own variables."""
        if not numbers:
            return 0.0
        square, products = self._target(numbers)
        roots = [self._roots[n] for n in numbers]
        if not all(root.shape[1] for root in roots):
            return -np.inf
        places = np.concatenate([*(self._own[n] for n in numbers), *(self._rates[n] for n in numbers)])
        S, g = self._gram[np.ix_(places, places)], products[places]
        root = _blocks([*roots, *(self._slow[n] for n in numbers)])
        theta = np.linalg.pinv(root.T @ S @ root, rcond=1e-8, hermitian=True) @ (root.T @ g)
        sizes, visible, left, slow, log_prior = list[float](), list[float](), list[float](), list[FloatArray](), 0.0
        ends = np.cumsum([0, *(r.shape[1] for r in roots)])
        for number, (a, b) in zip(numbers, pairwise(ends), strict=True):
            seen = float(np.linalg.norm(theta[a:b]))
            sizes.append(float(self._sizes[np.argmin(np.abs(np.log(self._sizes / max(seen, 1e-9))))]))
            part = self.parts[number]
            value = roots[len(visible)] @ theta[a:b]
            slow.append(np.diag(np.abs(value[0]) * np.array(part.effect.slow)) if part.rates.size else np.zeros((0, 0)))
            moved = part.columns @ value
            shown = float(np.linalg.norm(self._beyond_zeros(moved)))
            visible.append(shown if part.effect.stays_in_gap else float(np.linalg.norm(moved)))
            left.append((_LEFT_EXACT if not part.effect.stays_in_gap else _left_by(part)) * shown)
            log_prior -= float(np.log(len(self._sizes)))
            log_prior += self._plausible(number, roots, theta[a:b], numbers)
        scaled = [*(r * size / np.sqrt(r.shape[1]) for r, size in zip(roots, sizes, strict=True)), *slow]
        self._left[numbers] = float(np.linalg.norm(left))
        if len(numbers) > 1:  # what is beside a thing that gives way to a force takes more than that may leave
            more = self._left_of(numbers[1:]) - (square - float(theta @ root.T @ g))
            if np.sqrt(max(more, 0.0)) < _left_by(self.parts[numbers[1]]) * visible[1]:
                return -np.inf
        if min(visible) < max(_LEAST_BESIDE * max(visible), self._floor):
            return -np.inf
        lost = 0.5 * (square - self._gram[0, 0])
        if not curved:
            return float(log_prior - lost + _evidence(S, g, _blocks(scaled)))
        values = []
        for share in range(len(priors.PHYSICS)):
            curves = [self._curve(n, size, share) for n, size in zip(numbers, visible, strict=True)]
            every = np.concatenate([places, *(own for own, _ in curves)])
            whole = _blocks([*scaled, *(curve for _, curve in curves)])
            values.append(_evidence(self._gram[np.ix_(every, every)], products[every], whole))
        return float(log_prior - lost + float(log_sum(values, weights=priors.PHYSICS)))

    def _curve(self, number: int, size: float, share: int) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Places and prior root of a shape's discrepancy: in the position, or in the force where it gives way to it."""
        part = self.parts[number]
        site = {key: part.shape[key] for key in ("about", "friction")} if part.effect.stays_in_gap else None
        law = next(
            n for n, law in enumerate(self.laws) if law.site == site and (site or law.law.signal == "piston_position")
        )
        places = self._of_law[law]
        root = curve_roots(len(places), (_SMOOTH,))[0]
        seen = float(np.trace(root.T @ self._gram[np.ix_(places, places)] @ root))
        epsilon = (_EPSILONS_DRIVEN if site else _EPSILONS_EXACT)[share]
        return places, root * (epsilon * size / np.sqrt(max(seen, 1e-300)))

    def _left_of(self, numbers: tuple[int, ...]) -> float:
        """Chi-square that shapes leave of the gap."""
        if numbers not in self._chi_square:
            square, products = self._target(numbers)
            self._chi_square[numbers] = square - _gain(self._gram, products, self._places(numbers))
        return self._chi_square[numbers]

    def _plausible(self, number: int, roots: Sequence[FloatArray], theta: FloatArray, numbers: Sequence[int]) -> float:
        """Log share of the posterior where values are plausible, with some left for what nobody thought of."""
        root, inside = roots[list(numbers).index(number)], 1.0
        values, stds = root @ theta, np.sqrt(np.sum(root**2, axis=1))
        for parameter, value, std in zip(self.parts[number].effect.parameters, values, stds, strict=True):
            if std > 0:
                inside *= float(ndtr((parameter.high - value) / std) - ndtr((parameter.low - value) / std))
        return float(np.log((1 - _IMPOSSIBLE) * inside + _IMPOSSIBLE))

    def _laws(self, numbers: tuple[int, ...]) -> tuple[list[tuple[GapLaw, float]], float]:
        """Laws beside a set with their log odds against no law; and the log evidence of what the set may leave."""
        places = self._places(numbers)
        products = self._target(numbers)[1]
        S = self._gram[np.ix_(places, places)]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
        inverse = np.linalg.pinv(S * np.outer(scale, scale), rcond=1e-10, hermitian=True) * np.outer(scale, scale)
        found, leftovers = np.full(len(self.laws), -np.inf), np.full(len(self.laws), -np.inf)
        least = float(np.hypot(self._left.get(tuple(numbers), 0.0), self._floor))
        driven = {self.parts[n].effect.stays_in_gap for n in numbers}
        for width in {len(own) for own in self._of_law}:
            alike = [n for n, own in enumerate(self._of_law) if len(own) == width]
            index = np.array([self._of_law[n] for n in alike])
            across = self._gram[index[:, :, None], places[None, None, :]]
            grams = self._gram[index[:, :, None], index[:, None, :]] - across @ inverse @ across.transpose(0, 2, 1)
            own = products[index] - across @ (inverse @ products[places])
            roots = curve_roots(width, _LENGTHS)
            bayes = log_mean(log_mean(curve_evidence(grams, own, roots, self._sizes), axis=1))
            gains = np.einsum("ti,tij,tj->t", own, np.linalg.pinv(grams, rcond=1e-8, hermitian=True), own) - width
            large = np.sqrt(np.maximum(gains, 0.0)) > least
            own_variable = np.array([any(self.laws[n].is_of(d) for d in driven) for n in alike])
            found[alike] = np.where(large, bayes, -np.inf)
            leftovers[alike] = np.where(large | own_variable, -np.inf, bayes)
        variables = [(law.law.signal, law.law.other) for law in self.laws]
        each = -np.log(len(set(variables))) - np.log([variables.count(own) for own in variables])
        nothing = max(0.0, float(log_sum(leftovers + each)))
        unknown = float(np.log(priors.UNKNOWN / priors.NOTHING))
        return [(law, unknown + e + f) for law, e, f in zip(self.laws, each, found, strict=True)], nothing


def _left_by(part: GapColumns) -> float:
    """Share of what gives way to a force that it may leave: play is a corner in time, which forces know less well."""
    return _LEFT_PLAY if part.effect.shape_units else _LEFT_DRIVEN


def _sharpest(rows: GapRows, effect: Effect, beside: FloatArray) -> list[GapColumns]:
    """Of shapes that differ in a number only, as a width, the one that takes most beside any law of position.

    Some of them are tried; where their neighbours take another chi-square, the number is searched between them.
    """
    found: list[GapColumns] = []
    for _, group in groupby(effect.gap_shapes(rows.views[0]), lambda shape: _place(effect, shape)):
        shapes = list(group)[::_TRIED]
        trials = {n: part for n, shape in enumerate(shapes) if (part := gap_columns(rows, effect, shape)) is not None}
        if len(trials) < 2:
            found += trials.values()
            continue
        taken = {n: _taken(part, beside, rows.values) for n, part in trials.items()}
        best = max(taken, key=lambda n: taken[n])
        near = [n for n in (best - 1, best + 1) if n in taken]
        if max(taken[best] - taken[n] for n in near) <= _LEAST_GRID:
            found.append(trials[best])
            continue
        number = next(key for key in shapes[best] if key not in effect.discrete_shapes)

        def at(log: float, shape: Shape = shapes[best], number: str = number) -> GapColumns:
            part = gap_columns(rows, effect, {**shape, number: float(np.exp(log))})
            assert part is not None  # as its neighbours
            return part

        ends = np.log([shapes[n][number] for n in sorted({best, *near})])
        log = optimize.fminbound(
            lambda log: -_taken(at(float(log)), beside, rows.values), ends[0], ends[-1], xtol=_FINE
        )
        found.append(at(float(log)))
    return found


def _place(effect: Effect, shape: Shape) -> tuple[tuple[str, float], ...]:
    """What of a shape has but a few values."""
    return tuple(item for item in shape.items() if item[0] in effect.discrete_shapes)


def _taken(part: GapColumns, beside: FloatArray, gap: FloatArray) -> float:
    """Chi-square that a shape takes of the gap."""
    own = np.hstack([part.columns, part.rates])
    basis = np.linalg.qr((own - beside @ (beside.T @ own)) / np.maximum(np.linalg.norm(own, axis=0), 1e-300))[0]
    return float(np.sum((basis.T @ gap) ** 2))


def _gain(gram: FloatArray, products: FloatArray, places: npt.NDArray[np.intp]) -> float:
    """Chi-square that some columns take by least squares."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[places], 1e-300))
    inverse = np.linalg.pinv(gram[np.ix_(places, places)] * np.outer(scale, scale), rcond=1e-10, hermitian=True)
    own = scale * products[places]
    return float(own @ inverse @ own)


def _blocks(parts: Sequence[FloatArray]) -> FloatArray:
    """Block-diagonal matrix."""
    whole = np.zeros(tuple(np.sum([part.shape for part in parts], axis=0)))
    row = column = 0
    for part in parts:
        whole[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    return whole


def _evidence(gram: FloatArray, products: FloatArray, root: FloatArray) -> float:
    """Log Bayes factor of parameters with the prior covariance ``root root'``."""
    factor = np.linalg.cholesky(np.eye(root.shape[1]) + root.T @ gram @ root)
    turned = np.linalg.solve(factor, root.T @ products)
    return float(0.5 * turned @ turned - np.sum(np.log(np.diag(factor))))
