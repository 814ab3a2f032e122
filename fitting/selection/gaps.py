"""Posterior over what bends positions, from the gap between two position sensors of a joint.

Hypotheses are sets: at most one error of geometry or of an encoder, at most one thing that gives way to a force, at
most one law of something else. The evidence is that of :mod:`fitting.selection.evidence`, on rows that nothing but a
delay between the sensors explains beforehand. Beside each name is a smooth discrepancy in its own variable; what a
set may leave in any variable, a share of what it explains, is no law.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise, product

import numpy as np
import numpy.typing as npt
import scipy
from scipy.linalg import block_diag

from fitting.arrays import FloatArray
from fitting.effects import effects
from fitting.effects.base import Effect, Shape
from fitting.regression.solving import inverse_root
from fitting.residual.findings import LEAST
from fitting.residual.kinematics import GapColumns, GapLaw, GapRows, GapScore, gap_columns, gap_laws, with_unsure
from fitting.residual.terms import Term
from fitting.selection import priors
from fitting.selection.decision import laws_win, needed
from fitting.selection.evidence import DEAD, bayes_factor, curve_evidence, curve_roots, log_mean, log_sum

#: Sets whose discrepancies and laws are looked at, by what their formulas alone are worth, beside every single name.
_NEAR = 6
#: Chance of a value that no structure and no encoder has: a compliance below zero, a pin that is off by a decimetre.
_IMPOSSIBLE = 1e-9
#: Share of what a set explains that it may leave in any variable: of a force that a model knows, of
#: geometry, and of a law.
_LEFT_DRIVEN, _LEFT_PLAY, _LEFT_EXACT, _LEFT_LAW = 0.02, 0.1, 0.01, 0.1
#: Rows of what a set leaves beyond noise that hold as much as one row of noise.
_ROWS_A_WORD = 5.0
#: Root mean square of whitened rows, about a tenth of the noise of one reading, that a sound sensor's scale may be off.
_LEAST_ROW = 0.25
#: Least share of the other that the smaller of two effects has to be.
_LEAST_BESIDE = 0.01
#: How far nature is from the formula in its own variable, as share of what it explains; weights are those of physics.
_EPSILONS_DRIVEN, _EPSILONS_EXACT = (0.002, 0.006, 0.015), (0.0005, 0.002, 0.005)
#: How many of its deviations a model's force may be off, which knows of white noise only; with the same weights.
_LOADS_OFF = (1.0, 3.0, 10.0)
#: Correlation lengths of laws, in sixteenths of the range: a scale's error may repeat a dozen times along it.
_LENGTHS = (0.5, *priors.LENGTHS)
#: Of shapes that differ in a number only every so manieth is tried; chi-square between neighbours above which the
#: number is searched, and how finely, relative to it.
_TRIED, _LEAST_GRID, _FINE = 3, 4.0, 1e-3
#: Share of a column's square that rounding makes.
_ROUNDED = 1e-22
#: Correlation length of a discrepancy, in sixteenths of its variable's range.
_SMOOTH = 4.0


#: What changes where a model has the arm: at most one error of geometry, by name; and that something gives way between
#: the two sensors, so that each is right on its own side.
Pose = tuple[str, ...]
APART = "apart"


@dataclass(frozen=True)
class GapSet:
    """One explanation of a gap: shapes of at most two effects, and at most one law beside them."""

    parts: tuple[GapColumns, ...] = ()
    law: GapLaw | None = None

    @property
    def pose(self) -> Pose:
        """The part of it that changes where the model has the arm."""
        return tuple(APART if part.effect.between_sensors else part.effect.id for part in self.parts)

    def terms(self, joint: int) -> tuple[Term, ...]:
        """Return its effects and its law as terms of a joint."""
        laws = () if self.law is None else (Term(self.law.law, joint),)
        return (*(Term(part.effect, joint, dict(part.shape)) for part in self.parts), *laws)

    @property
    def names(self) -> tuple[str, ...]:
        """Reported identity: effects, and the variable of a law."""
        own = () if self.law is None else (f"{self.law.law.signal}/{self.law.law.other}",)
        return (*(part.effect.id for part in self.parts), *own)


@dataclass(frozen=True)
class GapConclusion:
    """One thing that is reported of a gap: an effect (``part``), or else the law of its set.

    Attributes
    ----------
    chosen : the set that it is a member of
    name : as :attr:`GapSet.names` has it
    probability : that it is this; ``rivals`` which other effects may be in its place, with probabilities
    laws : which laws may, the most probable first
    """

    chosen: GapSet
    name: str
    part: GapColumns | None
    probability: float
    rivals: tuple[tuple[str, float], ...]
    laws: tuple[tuple[str, float], ...]
    names: float
    """Probability of any effect in its place."""

    @property
    def beaten(self) -> bool:
        """True of an effect beside which laws are too probable."""
        return self.part is not None and laws_win(self.probability, self.names, sum(p for _, p in self.laws))


@dataclass(frozen=True)
class GapPosterior:
    """Explanations of one joint's gap with their probabilities, the most probable first; each set of names once."""

    rows: GapRows
    sets: tuple[tuple[GapSet, float], ...] = field(default_factory=lambda: ((GapSet(), 1.0),))

    def conclusions(self) -> tuple[GapConclusion, ...]:
        """Draw conclusions: the best set, without members that others make uncertain, each member with its rivals."""
        chances = {frozenset(own.names): p for own, p in self.sets}
        best = self.sets[0][0]
        while best.names:
            absent = {
                name: sum(p for other, p in chances.items() if other <= set(best.names) - {name}) for name in best.names
            }
            worst = max(absent, key=lambda name: absent[name])
            if absent[worst] <= 1.0 - priors.CREDIBLE:
                break
            best = next(own for own, _ in self.sets if set(own.names) <= set(best.names) - {worst})
        concluded = tuple(self._conclusion(best, name) for name in best.names)
        for name, law in ((one.name, one.laws[0][0]) for one in concluded if one.beaten):
            wanted = {law, *best.names} - {name}
            other = next((own for own, _ in self.sets if law in own.names and set(own.names) <= wanted), None)
            if other is not None:
                return tuple(self._conclusion(other, name) for name in other.names)
        return concluded

    def without(self, names: Collection[str]) -> GapPosterior:
        """Return what is left where sets with one of these names were refused: what speaks for them is there."""
        left = tuple((own, p) for own, p in self.sets if not set(own.names) & set(names))
        return replace(self, sets=left or ((GapSet(), 0.0),))

    def _conclusion(self, best: GapSet, name: str) -> GapConclusion:
        """Conclude on one member of a set, with its rivals in other sets until they reach 95 % together."""
        part = next((part for part in best.parts if part.effect.id == name), None)
        own, others = 0.0, dict[str, float]()
        for other, p in self.sets:
            if name in other.names:
                own += p
                continue
            for instead in (n for n in other.names if n not in best.names):
                others[instead] = others.get(instead, 0.0) + p
        listed = sorted(((rival, p) for rival, p in others.items() if p >= LEAST), key=lambda pair: -pair[1])
        laws, effects = ([pair for pair in listed if ("/" in pair[0]) is law] for law in (True, False))
        named = sum(p for _, p in effects) + (0.0 if part is None else own)
        return GapConclusion(best, name, part, own, tuple(needed(effects, own)), tuple(laws), named)

    def scores(self, chosen: GapSet) -> tuple[GapScore, ...]:
        """Fit a set's effects jointly, with the chi-square that each takes beside the other."""
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
        """Fit a set's law beside its effects: values, covariance and chi-square gain."""
        assert chosen.law is not None
        rows = self.rows
        beside = np.hstack([*(np.hstack([part.columns, part.rates]) for part in chosen.parts), rows.base])
        y = rows.values - sum((part.beyond for part in chosen.parts), np.zeros(len(rows.values)))
        C = rows.whitened([chosen.law.columns(view) for view in rows.views])
        basis = _orthonormal(beside)[0]
        left, target = _beyond(basis, C), _beyond(basis, y)
        covariance = np.linalg.pinv(left.T @ left, rcond=1e-8, hermitian=True)
        values = covariance @ (left.T @ target)
        return values, np.asarray(covariance, dtype=float), float(target @ left @ values)


def gap_posterior(rows: Mapping[Pose, GapRows], driven: Collection[str] | None = None) -> GapPosterior:
    """Compute the posterior of every set of effects and laws of a joint's gap.

    Parameters
    ----------
    rows : the gap with the forces that an arm has in each pose; the first one for those that are missing
    driven : what may give way to a force; None: anything that does
    """
    first = next(iter(rows.values()))
    if not len(first.values):
        return GapPosterior(first)
    weighed = list[_Weighed]()
    for number, (pose, own) in enumerate(rows.items()):

        def asked(one: Pose, pose: Pose = pose, first: bool = not number) -> bool:
            return one == pose or (first and one not in rows)

        weighed += _Evidence(own, pose if number else None, driven).weighed(asked)
    tempered = _tempered(weighed)
    both = zip((one.own for one in weighed), np.exp(tempered - float(log_sum(tempered))).tolist(), strict=True)
    return GapPosterior(first, tuple(sorted(both, key=lambda pair: -pair[1])))


@dataclass(frozen=True)
class _Weighed:
    """A set with its log odds, and how far differences from others like it count where it is the best."""

    own: GapSet
    odds: float
    share: Callable[[GapSet], float]


def _tempered(weighed: Sequence[_Weighed]) -> FloatArray:
    """Compute log odds of sets, differences between alike ones as far as they count.

    What the best of them leaves beyond noise is smooth: only every so many rows add information.
    """
    result, places = np.array([one.odds for one in weighed]), dict[str, list[int]]()
    for number, one in enumerate(weighed):
        if one.own.names:
            driven = next((part.effect.id for part in one.own.parts if part.effect.between_sensors), "")
            places.setdefault(driven, []).append(number)
    for alike in places.values():
        best = weighed[max(alike, key=lambda n: weighed[n].odds)]
        result[alike] = best.odds - best.share(best.own) * (best.odds - result[alike])
    return result


class _Evidence:
    """Evidence of sets of one pose, or of all, all from whitened columns less what a delay explains."""

    def __init__(self, rows: GapRows, pose: Pose | None = None, driven: Collection[str] | None = None) -> None:
        self._zeros, self._count = _orthonormal(rows.zeros)[0], len(rows.values)
        self.parts: list[GapColumns] = []
        self._left: dict[tuple[int, ...], float] = {}
        self._grids: dict[str, float] = {}  # numbers of a grid, of which a shape has one
        self._floor = _LEAST_ROW * float(np.sqrt(self._count))
        self._chi_square: dict[tuple[int, ...], float] = {}
        self.laws = list(gap_laws(rows.views))
        smooth = rows.whitened([self.laws[0].columns(view) for view in rows.views])
        beside = _orthonormal(np.hstack([rows.base, rows.zeros, smooth]))[0]
        shapes = {effect: len(own) for effect in effects() if (own := effect.gap_shapes(rows.views[0]))}
        self._families = len(shapes)
        for effect, count in shapes.items():
            posed = pose is None or (APART if effect.between_sensors else effect.id) in pose
            if not posed or (effect.between_sensors and driven is not None and effect.id not in driven):
                continue
            found = _best_shapes(rows, effect, beside)
            self._grids[effect.id] = count / max(len(found), 1)
            self.parts += [with_unsure(rows, part) for part in found]
        self.parts = [part for part in self.parts if not self._is_compliance(part)]
        basis = _orthonormal(rows.base)[0]

        def free(own: FloatArray) -> FloatArray:
            left = _beyond(basis, own)
            left[:, np.linalg.norm(left, axis=0) < 1e-6 * np.maximum(np.linalg.norm(own, axis=0), 1e-300)] = 0.0
            return left

        # Shapes by orthonormal columns: squares of their own, that nearly cancel, hold no digits.
        visible = [_orthonormal(free(part.columns), DEAD) for part in self.parts]
        self._roots = [root for _, root in visible]
        columns = [rows.values[:, None], *(own for own, _ in visible), *(p.beyond[:, None] for p in self.parts)]
        columns += [part.rates for part in self.parts] + [part.unsure for part in self.parts]
        columns += [rows.whitened([law.columns(view) for view in rows.views]) for law in self.laws]
        self._white = free(np.hstack(columns))
        self._gram = self._white.T @ self._white
        ends = np.cumsum([c.shape[1] for c in columns])
        places = (np.arange(a, b) for a, b in pairwise(ends))
        self._own, self._beyond, self._rates, self._unsure = ([next(places) for _ in self.parts] for _ in range(4))
        self._of_law = list(places)
        self._slow = [inverse_root(self._gram[np.ix_(own, own)], DEAD) for own in self._rates]
        self._sizes = priors.amplitudes(float(np.sqrt(self._gram[0, 0])))

    def _is_compliance(self, part: GapColumns) -> bool:
        """Return whether a shape is so far within its width that it equals the compliance without one at its site."""
        own = _beyond(self._zeros, part.columns)
        for other in self.parts if part.effect.shape_units else ():
            if not other.effect.shape_units and other.shape.items() <= part.shape.items() and other.shape:
                linear = _orthonormal(_beyond(self._zeros, other.columns))[0]
                left = np.linalg.norm(_beyond(linear, own))
                return bool(left < _left_by(other) * np.linalg.norm(own))
        return False

    def weighed(self, asked: Callable[[Pose], bool] = lambda pose: True) -> list[_Weighed]:
        """Weigh the sets of the poses asked for, with log odds; of each set of names its best shapes."""
        alone = {(number,): self._named((number,)) for number in range(len(self.parts))}
        if not np.isfinite([*alone.values(), *(odds for _, odds in self._laws(())[0])]).any():
            # Nothing is more than a sound sensor's scale may be off.
            return [_Weighed(GapSet(), 0.0, self._share)] if asked(()) else []
        screened: dict[tuple[str, ...], list[tuple[float, tuple[int, ...]]]] = {}
        for numbers in self._combinations():
            key = tuple(self.parts[n].effect.id for n in numbers)
            odds = alone[numbers] if numbers in alone else self._named(numbers)
            screened.setdefault(key, []).append((odds, numbers))
        best = sorted(screened, key=lambda key: -max(screened[key])[0])
        keys = [key for key in screened if len(key) < 2 or key in best[:_NEAR]]
        found: dict[tuple[str, ...], tuple[GapSet, list[float]]] = {}
        for key in keys:
            near = sorted(screened[key], reverse=True)[:_NEAR]
            if not asked(GapSet(tuple(self.parts[n] for n in near[0][1])).pose):
                continue
            curved = np.array([self._named(numbers, curved=True) for _, numbers in near])
            each = float(np.log(priors.CATALOGUE / priors.NOTHING / max(self._families, 1)))
            prior = len(key) * each - np.log(len(screened[key])) - sum(np.log(self._grids[name]) for name in key)
            exact, numbers = near[int(np.argmax(curved))]
            own = GapSet(tuple(self.parts[n] for n in numbers))
            laws, leftovers = self._laws(numbers)
            found[own.names] = (own, [prior + max(float(log_sum(curved)), exact + leftovers)])
            for law, odds in laws:
                if any(law.is_of(part.effect.between_sensors) for part in own.parts) or not self._add_to(numbers, law):
                    continue  # a law of the very variable has the formula in it
                with_law = replace(own, law=law)
                found.setdefault(with_law.names, (with_law, []))[1].append(prior + exact + odds)
        return [_Weighed(own, float(log_sum(values)), self._share) for own, values in found.values()]

    def _share(self, best: GapSet) -> float:
        """Compute the share of differences from the best set to count."""
        numbers = [next(n for n, part in enumerate(self.parts) if part is own) for own in best.parts]
        curve = [] if best.law is None else [self._of_law[self.laws.index(best.law)]]
        left = self._left_in(numbers, np.concatenate([self._places(numbers), *curve]))
        return 1.0 / (1.0 + _ROWS_A_WORD * max(left / self._count - 1.0, 0.0))

    def _add_to(self, numbers: Sequence[int], law: GapLaw) -> bool:
        """Return whether effects take more beside a law than its curve may leave."""
        if not numbers:
            return True
        curve = self._of_law[self.laws.index(law)]
        nothing, alone, both = (
            self._left_in(numbers, places)
            for places in (curve[:0], curve, np.concatenate([curve, self._places(numbers)]))
        )
        return alone - both > _LEFT_LAW**2 * (nothing - alone)

    def _combinations(self) -> Iterator[tuple[int, ...]]:
        """List sets of at most one shape of each kind, by numbers: none, one, or both."""
        between = [part.effect.between_sensors for part in self.parts]
        geometry, driven = ([(), *((n,) for n, own in enumerate(between) if own == kind)] for kind in (False, True))
        return (first + second for first, second in product(geometry, driven))

    def _places(self, numbers: Sequence[int]) -> npt.NDArray[np.intp]:
        """Return the places of shapes' columns, with their rates and the uncertainty of their loads."""
        own = [places for n in numbers for places in (self._own[n], self._rates[n], self._unsure[n])]
        return np.concatenate([np.zeros(0, dtype=np.intp), *own])

    def _named(self, numbers: tuple[int, ...], curved: bool = False) -> float:
        """Compute log evidence of shapes against nothing; ``curved`` with discrepancies in their own variables."""
        if not numbers:
            return 0.0
        widths = [len(self._own[n]) for n in numbers]
        if not all(widths):
            return -np.inf
        less = np.zeros(len(self._gram))  # the gap less formulas' excess, by columns
        less[0], less[[int(self._beyond[n][0]) for n in numbers]] = 1.0, -1.0
        products = self._gram @ less
        square = float(less @ products)
        places = np.concatenate([*(self._own[n] for n in numbers), *(self._rates[n] for n in numbers)])
        S, g = self._gram[np.ix_(places, places)], products[places]
        root = block_diag(*map(np.eye, widths), *(self._slow[n] for n in numbers))
        theta = np.linalg.pinv(root.T @ S @ root, rcond=1e-8, hermitian=True) @ (root.T @ g)
        sizes, visible, left, log_prior = list[float](), list[float](), list[float](), 0.0
        slow, off = list[FloatArray](), list[FloatArray]()
        ends = np.cumsum([0, *widths])
        for number, (a, b) in zip(numbers, pairwise(ends), strict=True):
            seen = float(np.linalg.norm(theta[a:b]))
            sizes.append(float(self._sizes[np.argmin(np.abs(np.log(self._sizes / max(seen, 1e-9))))]))
            part = self.parts[number]
            value = self._roots[number] @ theta[a:b]
            slow.append(np.diag(np.abs(value[0]) * np.array(part.effect.slow if part.rates.size else [])))
            off.append(np.abs(value[0]) * np.eye(part.unsure.shape[1]))
            moved = part.columns @ value
            shown = float(np.linalg.norm(_beyond(self._zeros, moved)))
            visible.append(shown if part.effect.between_sensors else float(np.linalg.norm(moved)))
            left.append((_LEFT_EXACT if not part.effect.between_sensors else _left_by(part)) * shown)
            log_prior -= float(np.log(len(self._sizes)))
            log_prior += self._plausible(number, value)
        scaled = [*(np.eye(k) * size / np.sqrt(k) for k, size in zip(widths, sizes, strict=True)), *slow]
        self._left[numbers] = float(np.linalg.norm(left))
        if len(numbers) > 1:  # what is beside a thing that gives way to a force takes more than that may leave
            effect = self.parts[numbers[1]].effect
            alone = [n for n, part in enumerate(self.parts) if part.effect is effect]
            more = min(self._left_of((n,)) for n in alone) - self._left_of(numbers)
            if np.sqrt(max(more, 0.0)) < _left_by(self.parts[numbers[1]]) * visible[1]:
                return -np.inf
        if min(visible) < max(_LEAST_BESIDE * max(visible), self._floor):
            return -np.inf
        lost = 0.5 * (square - self._gram[0, 0])
        places = np.concatenate([places, *(self._unsure[n] for n in numbers)])
        values = []
        for share, factor in enumerate(_LOADS_OFF if curved else _LOADS_OFF[1:2]):
            curves = [self._curve(n, size, share) for n, size in zip(numbers, visible, strict=True)] if curved else []
            every = np.concatenate([places, *(own for own, _ in curves)])
            whole = block_diag(*scaled, *(factor * own for own in off), *(curve for _, curve in curves))
            values.append(bayes_factor(self._gram[np.ix_(every, every)], products[every], whole))
        evidence = float(log_sum(values, weights=priors.PHYSICS)) if curved else values[0]
        return float(log_prior - lost + evidence)

    def _curve(self, number: int, size: float, share: int) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Return places and prior root of a shape's discrepancy: in position, or in force where it gives way to it."""
        part = self.parts[number]
        site = {key: part.shape[key] for key in ("about", "friction")} if part.effect.between_sensors else None
        law = next(
            n for n, law in enumerate(self.laws) if law.site == site and (site or law.law.signal == "piston_position")
        )
        places = self._of_law[law]
        root = curve_roots(len(places), (_SMOOTH,))[0]
        seen = float(np.trace(root.T @ self._gram[np.ix_(places, places)] @ root))
        epsilon = (_EPSILONS_DRIVEN if site else _EPSILONS_EXACT)[share]
        return places, root * (epsilon * size / np.sqrt(max(seen, 1e-300)))

    def _left_of(self, numbers: tuple[int, ...]) -> float:
        """Compute the chi-square that shapes leave of the gap."""
        if numbers not in self._chi_square:
            places = np.concatenate([places for n in numbers for places in (self._own[n], self._rates[n])])
            self._chi_square[numbers] = self._left_in(numbers, places)
        return self._chi_square[numbers]

    def _left_in(self, numbers: Sequence[int], places: npt.NDArray[np.intp]) -> float:
        """Compute the chi-square of the gap, less formulas' excess, that some columns leave."""
        return float(np.sum(_beyond(_orthonormal(self._white[:, places])[0], self._gap(numbers)) ** 2))

    def _gap(self, numbers: Sequence[int]) -> FloatArray:
        """Return the gap (M,) less formulas' excess beyond their columns."""
        return np.asarray(self._white[:, 0] - self._white[:, [int(self._beyond[n][0]) for n in numbers]].sum(axis=1))

    def _plausible(self, number: int, values: FloatArray) -> float:
        """Compute the posterior's log share of plausible values, with some left for what nobody thought of."""
        stds = np.sqrt(np.sum(self._roots[number] ** 2, axis=1))
        possible = self.parts[number].effect.possible(values.tolist(), stds.tolist())
        return float(np.log((1 - _IMPOSSIBLE) * possible + _IMPOSSIBLE))

    def _laws(self, numbers: tuple[int, ...]) -> tuple[list[tuple[GapLaw, float]], float]:
        """Compute the log odds of laws beside a set against none; and the log evidence of what the set may leave."""
        # Less what the set explains; not by squares, of which little is left.
        basis = _orthonormal(self._white[:, self._places(numbers)])[0]
        left = _beyond(basis, np.column_stack([self._gap(numbers), self._white[:, np.concatenate(self._of_law)]]))
        curves = np.split(left[:, 1:], np.cumsum([len(curve) for curve in self._of_law])[:-1], axis=1)
        found, leftovers = np.full(len(self.laws), -np.inf), np.full(len(self.laws), -np.inf)
        least = float(np.hypot(self._left.get(tuple(numbers), 0.0), self._floor))
        driven = {self.parts[n].effect.between_sensors for n in numbers}
        for width in {len(own) for own in self._of_law}:
            alike = [n for n, own in enumerate(self._of_law) if len(own) == width]
            grams = np.array([curves[n].T @ curves[n] for n in alike])
            products = np.array([curves[n].T @ left[:, 0] for n in alike])
            roots = curve_roots(width, _LENGTHS)
            bayes = log_mean(log_mean(curve_evidence(grams, products, roots, self._sizes), axis=1))
            inverse = np.linalg.pinv(grams, rcond=1e-8, hermitian=True)
            gains = np.einsum("ti,tij,tj->t", products, inverse, products) - width
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
    """Return the share of a force that a compliance may leave: play is a corner in time, which forces resolve less."""
    return _LEFT_PLAY if part.effect.shape_units else _LEFT_DRIVEN


def _best_shapes(rows: GapRows, effect: Effect, beside: FloatArray) -> list[GapColumns]:
    """Choose, of shapes that differ in one number, as a width, the one that gains most beside any law of position.

    Some of them are tried; where their neighbours take another chi-square, the number is searched between them.
    """

    def discrete(shape: Shape) -> list[tuple[str, float]]:
        return [item for item in shape.items() if item[0] in effect.discrete_shapes]

    found: list[GapColumns] = []
    for _, group in groupby(effect.gap_shapes(rows.views[0]), discrete):
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
        log = scipy.optimize.fminbound(
            lambda log: -_taken(at(float(log)), beside, rows.values), ends[0], ends[-1], xtol=_FINE
        )
        found.append(at(float(log)))
    return found


def _taken(part: GapColumns, beside: FloatArray, gap: FloatArray) -> float:
    """Compute the chi-square that a shape takes of the gap beside an orthonormal basis."""
    basis = _orthonormal(_beyond(beside, np.hstack([part.columns, part.rates])))[0]
    return float(np.sum((basis.T @ gap) ** 2))


def _beyond(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Project columns (M, ..) off an orthonormal basis (M, r)."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def _orthonormal(columns: FloatArray, least: float = _ROUNDED) -> tuple[FloatArray, FloatArray]:
    """Orthonormalise columns (M, k) to the k' that they show, with the values (k, k') of each.

    Directions with less than a share ``least`` of a column's square are none.
    """
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = np.inf
    own, sizes, turned = np.linalg.svd(columns / norms, full_matrices=False)
    live = sizes**2 > least
    return own[:, live], turned[live].T / sizes[live] / norms[:, None]
