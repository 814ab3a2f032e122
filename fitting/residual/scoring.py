"""Scores of candidate terms: what each would gain if it were fitted *together with* the base.

With whitened rows ``A`` (base and accepted terms) and ``Q`` an orthonormal basis of their space, a candidate's
columns ``C`` lower the residual's sum of squares by::

    gain = g' S^-1 g,    g = C' e,    S = C'C - (Q'C)'(Q'C),

with ``e`` the residual of the present model: exactly the chi-square that a full refit with the candidate would gain, at
the cost of one small solve. ``S`` is what survives projecting the base out of the candidate.

A direction of ``S`` that survives with less than 1e-4 of its norm is rounding or geometry, and is not used.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from daq.scratch import ScratchArrays
from fitting.arrays import FloatArray, IntArray
from fitting.effects.base import Effect
from fitting.effects.bounds import inside, limits
from fitting.residual.laws import laws
from fitting.residual.null import BIAS_SHARE, Null
from fitting.residual.terms import Model, Term

#: Times the bias from which on a value is compared as it is.
FAR_BEYOND = 2.0
_BATCH_COLUMNS = 64  # built at once at full rate: fits a processor's cache
#: Numbers in all columns above which those of one joint at a time are in memory, the others in a file (128 MB).
_MOST_NUMBERS = 16_000_000
_NEXT_TO_NOTHING = 1e-200  # a prior about zero that no bound but one at zero cuts
_DEAD = 1e-8  # squared: columns survive with at least 1e-4 of their norm
_ROUNDING = 1e-12  # added to what a row of the prior has beside the base, which may be nothing


@dataclass(frozen=True)
class Score:
    """One candidate's score.

    Attributes
    ----------
    term : the candidate
    gain : chi-square that the refit gains inside the bounds of its parameters (:mod:`fitting.effects.bounds`)
    live : number of its directions that survive the projection, and that no bound holds
    values, stds : its parameters, inside their bounds, and their standard deviations without bounds
    free : its parameters without bounds
    surviving : largest share of a column's norm that survives projecting the base out, 0 to 1
    information : (k, k) inverse covariance of its parameters
    places : of what acts everywhere, by which share of the gain each joint's chi-square falls (or rises: negative);
        else empty
    grid : number of shapes that it was picked from
    null : its values on replicas without any effect, once they were drawn; gain and values are then unbiased
    taken : share of the null's bias that was taken off the values
    """

    term: Term
    gain: float
    live: int
    values: tuple[float, ...]
    stds: tuple[float, ...]
    surviving: float
    information: FloatArray = field(repr=False, compare=False)
    free: tuple[float, ...] = ()
    places: tuple[float, ...] = ()
    null: Null | None = None
    taken: float = 0.0
    grid: int = 1

    def against(self, null: Null) -> Score:
        """Take the bias that noise in the regressors makes off the score.

        A law keeps its gain: a spline has no value that noise would push to one side, and few draws know little of
        its many coefficients.
        """
        if not isinstance(self.term.content, Effect):
            return replace(self, null=null)
        moved, gain = self._moved(BIAS_SHARE * null.bias)
        if gain > FAR_BEYOND**2 * float(null.bias @ self.information @ null.bias):
            taken, (moved, gain) = 0.0, self._moved(0.0)  # no bias makes this: candidates are compared as they are
        else:
            taken = BIAS_SHARE
        return replace(self, null=null, taken=taken, gain=gain, values=tuple(moved.tolist()))

    def _moved(self, off: FloatArray | float) -> tuple[FloatArray, float]:
        """Compute an effect's values (k,) inside its bounds with this taken off the free ones, and what they gain."""
        assert isinstance(self.term.content, Effect)
        free = np.asarray(self.free or self.values) - off
        held = inside(limits(self.term.content), self.information, self.information @ free, free)
        moved = free if held is None else held.values
        return moved, float(moved @ self.information @ moved)

    @property
    def plausible(self) -> bool:
        """True for a law, and for an effect whose values are ones of it."""
        effect = self.term.content
        return not isinstance(effect, Effect) or effect.plausible(self.values, self.stds)

    @cached_property
    def log_inside(self) -> float:
        """Log share of the posterior that lies inside the bounds of an effect's parameters, over the prior's.

        Its values are inside (:mod:`fitting.effects.bounds`); a half-line prior has half of a free one's mass.
        """
        effect = self.term.content
        if not isinstance(effect, Effect):
            return 0.0
        if not self.plausible:
            return -np.inf
        before = effect.possible([0.0] * len(self.values), [_NEXT_TO_NOTHING] * len(self.values))
        return float(np.log(max(effect.possible(self.values, self.stds), 1e-300) / before))

    @property
    def trusted(self) -> float:
        """Share of the gain that counts, once replicas have shown what noise in the regressors makes of it."""
        if self.null is None or not self.gain > 0:
            return 1.0
        if not isinstance(self.term.content, Effect):
            return 1.0 / self.null.inflation_along(np.asarray(self.values))
        return self.null.weight(self.fitted, self.information) / self.gain

    @property
    def fitted(self) -> FloatArray:
        """Values as they were fitted, (k,), with the bias that was taken off them."""
        values = np.asarray(self.values, dtype=float)
        return values if self.null is None else values + self.taken * self.null.bias


class _InMemory(dict[int | None, FloatArray]):
    """Arrays in memory, as :class:`daq.scratch.ScratchArrays` has them in a file."""

    def rows(self, place: int | None, rows: slice) -> FloatArray:
        return self[place][rows]

    def put_rows(self, place: int | None, start: int, values: FloatArray) -> None:
        self[place][start : start + len(values)] = values


class Candidates:
    """Candidate terms with their whitened columns in the rows of one design.

    Columns are made once. Those that hold the model's own force go stale when the model changes; scores from stale
    columns are good enough to see who matters, and :meth:`refresh` makes the columns of those anew.
    """

    def __init__(self, model: Model, terms: Sequence[Term], grid: Sequence[int], once: bool = False) -> None:
        """Build the columns; ``grid[i]`` is the size of the grid that candidate ``i`` was picked from.

        Where they are scored ``once``, beside this model alone, columns are made when they are looked at, and not kept.
        """
        self.terms, self.grid = tuple(terms), tuple(grid)
        self._widths = [term.width for term in self.terms]
        groups: dict[int | None, list[int]] = {}
        for number, term in enumerate(self.terms):
            groups.setdefault(term.place, []).append(number)
        self._groups = dict(sorted(groups.items(), key=lambda own: own[0] is not None))  # what acts on all joints first
        self._starts: dict[int | None, dict[int, int]] = {}
        for place, own in self._groups.items():
            ends = np.cumsum([self._widths[n] for n in own]).tolist()
            self._starts[place] = dict(zip(own, [0, *ends[:-1]], strict=True))
        rows: dict[int | None, int] = dict(enumerate(map(len, model.fit.residual)))
        rows[None] = sum(rows.values())
        size = sum(self._widths[n] * rows[place] for place, own in self._groups.items() for n in own)
        self._columns = ScratchArrays() if size > _MOST_NUMBERS else _InMemory()  # by place: a row for each column
        self._grams: dict[int, FloatArray] = {}  # of each candidate's own columns: no model changes them
        self._only = model if once else None
        for place, numbers in () if once else self._groups.items():
            self._columns[place] = self._built(model, place, numbers).T

    def follow(self, before: Model, model: Model) -> None:
        """Make the columns anew of joints whose effort was moved, or whose noise is another, since ``before``."""
        old, new = before.design.blocks, model.design.blocks
        changed = {
            n
            for n in range(len(new))
            if old[n] is not new[n]
            or any(before.noise.of(n, loaded) is not model.noise.of(n, loaded) for loaded in (True, False))
        }
        for place, numbers in self._groups.items():
            if place in changed or (place is None and changed):
                self._columns[place] = self._built(model, place, numbers).T

    def refresh(self, model: Model, numbers: Collection[int]) -> list[int]:
        """Make the columns of these candidates anew, from the model's present forces; return those that hold any."""
        all_stale: list[int] = []
        for place, own in self._groups.items():
            stale = [n for n in own if n in numbers and self.terms[n].uses_model]
            if not stale:
                continue
            fresh, done = self._built(model, place, stale).T, 0
            for run in self._runs(place, stale):
                self._columns.put_rows(place, run.start, fresh[done : done + run.stop - run.start])
                done += run.stop - run.start
            all_stale += stale
        return all_stale

    def scores(self, model: Model, numbers: Collection[int] | None = None) -> dict[int, Score]:
        """Score every candidate with a live direction, by its number; ``numbers``: of these only."""
        result: dict[int, Score] = {}
        for place, group in self._groups.items():
            asked = group if numbers is None else [n for n in group if n in numbers]
            if not asked:
                continue
            C = self._of(place, asked)
            if place is None:
                Q, residual = np.vstack(model.fit.orthonormal), np.concatenate(model.fit.residual)
            else:
                Q, residual = model.fit.orthonormal[place], model.fit.residual[place]
            shadow, products = Q.T @ C, C.T @ residual
            by_data = shadow if model.unpriored is None else model.unpriored @ shadow
            for chosen, where in self._of_one_width(asked):
                shade, seen = (np.moveaxis(part[:, where], 0, 1) for part in (shadow, by_data))
                whole = np.array([self._grams[n] for n in chosen])
                gram = whole - shade.swapaxes(1, 2) @ shade
                plain = gram if by_data is shadow else whole - seen.swapaxes(1, 2) @ seen
                own_terms = [(self.terms[n], self.grid[n]) for n in chosen]
                norms = np.einsum("tii->ti", whole)
                freely = _scored_freely(own_terms, model.held, shade, gram, plain, products[where], norms)
                for member, score in freely.items():
                    if place is None and score.gain > 0:
                        score = _placed(score, model, C[:, where[member]], shade[member])
                    result[chosen[member]] = score
        return result

    def _of_one_width(self, numbers: Sequence[int]) -> Iterator[tuple[list[int], IntArray]]:
        """Group candidates (T,) by width k, with (T, k) their columns' places among those of ``numbers``."""
        widths = np.array([self._widths[n] for n in numbers])
        starts = np.cumsum(widths) - widths
        for width in np.unique(widths).tolist():
            members = np.flatnonzero(widths == width).tolist()
            yield [numbers[m] for m in members], starts[members][:, None] + np.arange(width)

    def width(self, number: int) -> int:
        """Return the number of a candidate's columns."""
        return self._widths[number]

    def products(self, model: Model, joint: int, numbers: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Compute the Gram matrix (p, p) of candidates' columns less the model, and products with its residual.

        Columns are those of ``numbers`` one after the other; all act on this joint alone.
        """
        C = self._of(joint, numbers)
        shadow = model.fit.orthonormal[joint].T @ C
        return C.T @ C - shadow.T @ shadow, C.T @ model.fit.residual[joint]

    def contributions(self, model: Model, numbers: Sequence[int], values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute what candidates of one place contribute there (R, N), and the base's share of it (rank, N).

        ``values`` (P, N) are of their columns one after the other.
        """
        place = self.terms[numbers[0]].place
        Q = np.vstack(model.fit.orthonormal) if place is None else model.fit.orthonormal[place]
        raw = self._of(place, numbers) @ values
        return raw, Q.T @ raw

    def shown(self, model: Model, number: int, values: Sequence[float]) -> dict[int, FloatArray]:
        """Compute a candidate's contribution with these values less the model's share: by joint, (R_j,)."""
        place = self.terms[number].place
        raw = self._of(place, [number]) @ np.asarray(values)
        if place is not None:
            Q = model.fit.orthonormal[place]
            return {place: raw - Q @ (Q.T @ raw)}
        parts = np.split(raw, np.cumsum([len(r) for r in model.fit.residual])[:-1])
        shadow = sum(Q.T @ part for Q, part in zip(model.fit.orthonormal, parts, strict=True))
        return {joint: part - model.fit.orthonormal[joint] @ shadow for joint, part in enumerate(parts)}

    def _of(self, place: int | None, numbers: Sequence[int]) -> FloatArray:
        """Return these candidates' columns in a row; all act at this place."""
        if self._only is not None:
            return self._built(self._only, place, numbers)
        parts = [self._columns.rows(place, run) for run in self._runs(place, numbers)]
        return parts[0].T if len(parts) == 1 else np.concatenate(parts).T

    def _runs(self, place: int | None, numbers: Sequence[int]) -> Iterator[slice]:
        """List the runs of these candidates' columns among their place's."""
        starts, start, stop = self._starts[place], 0, 0
        for n in numbers:
            if starts[n] != stop:
                if stop > start:
                    yield slice(start, stop)
                start = starts[n]
            stop = starts[n] + self._widths[n]
        yield slice(start, stop)

    def _built(self, model: Model, place: int | None, numbers: Sequence[int]) -> FloatArray:
        joints = range(len(model.views[0])) if place is None else range(place, place + 1)
        ends = np.cumsum([len(model.fit.residual[joint]) for joint in joints])
        block = np.empty((sum(self._widths[n] for n in numbers), int(ends[-1]))).T
        _white_columns(model, [self.terms[n] for n in numbers], joints, np.split(block, ends[:-1]))
        for views in model.views:
            for view in views:
                view.cache.clear()  # what shapes shared is of no use any more
        for chosen, where in self._of_one_width(numbers):
            own = np.moveaxis(block[:, where], 0, 1)
            self._grams.update(zip(chosen, own.swapaxes(1, 2) @ own, strict=True))
        return block


def _placed(score: Score, model: Model, columns: FloatArray, shadow: FloatArray) -> Score:
    """Split the score's gain by joint; ``columns`` are in the rows of all joints, ``shadow`` is Q'C."""
    fit, values, shares, start = model.fit, np.asarray(score.values), [], 0
    for Q, residual in zip(fit.orthonormal, fit.residual, strict=True):
        shown = columns[start : start + len(residual)] @ values - Q @ (shadow @ values)
        shares.append(float(shown @ (2.0 * residual - shown)) / score.gain)
        start += len(residual)
    return replace(score, places=tuple(shares))


def score_terms(model: Model, terms: Sequence[Term], grid: Sequence[int]) -> list[Score]:
    """Score a few candidates in a row; those without a live direction are left out."""
    scores = Candidates(model, terms, grid).scores(model)
    return [scores[number] for number in sorted(scores)]


def white_columns(model: Model, term: Term) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Whiten one joint's term in its rows' order, and return which rows are unloaded."""
    joint, design = term.joint or 0, model.design
    rows = len(model.fit.residual[joint])
    out = np.zeros((rows, term.width))
    _white_columns(model, [term], range(joint, joint + 1), [out])
    unloaded = np.zeros(rows, dtype=bool)
    for index, part in model.sections(joint):
        unloaded[part] = not design.segments[index].loaded
    return out, unloaded


def _batches(terms: Sequence[Term]) -> Iterator[tuple[list[Term], slice]]:
    """Group terms by about so many columns as are built at once, each with its columns' place."""
    batch, start, end = list[Term](), 0, 0
    for term in terms:
        batch.append(term)
        end += term.width
        if end - start >= _BATCH_COLUMNS:
            yield batch, slice(start, end)
            batch, start = [], end
    if batch:
        yield batch, slice(start, end)


def _white_columns(model: Model, terms: Sequence[Term], joints: range, out: Sequence[FloatArray]) -> None:
    """Write whitened columns of terms in these joints' rows, in the fit's order, into ``out`` per joint."""
    design, ends, batches = model.design, [0] * len(joints), list(_batches(terms))
    for index in model.fitted:
        views, segment = model.views[index], design.segments[index]
        whitenings = [model.noise.of(joint, segment.loaded) for joint in joints]
        kept = [np.flatnonzero(design.kept(model.noise, joint, index)) for joint in joints]
        rows = [slice(end, end + len(own)) for end, own in zip(ends, kept, strict=True)]
        for batch, part in batches:
            columns = [term.columns(views) for term in batch]
            for number, joint in enumerate(joints):
                full = np.empty((len(segment), part.stop - part.start), order="F")
                start = 0
                for term, own in zip(batch, columns, strict=True):
                    full[:, start : start + own.shape[-1]] = own[:, joint] if term.everywhere else own
                    start += own.shape[-1]
                out[number][rows[number], part] = whitenings[number](design.bank.reduce(full))[kept[number]]
        ends = [own.stop for own in rows]
    for joint, own, end in zip(joints, out, ends, strict=True):
        own[end:] = 0.0  # a prior's row knows nothing of candidates, but for a delay's
        _prior_of_delays(model, terms, joint, own)


def _prior_of_delays(model: Model, terms: Sequence[Term], joint: int, columns: FloatArray) -> None:
    """Fill a joint's last row where a delay is expected: the delay's column (:mod:`fitting.regression.prior`)."""
    expected = None if model.prior is None else model.prior.delay_of(joint)
    start = 0
    for term in terms if expected is not None else ():
        if term.delays_effort and term.joint == joint and expected is not None:
            columns[-1, start] = 1.0 / expected[1]
        start += term.width


def _scored(
    terms: Sequence[tuple[Term, int]], gram: FloatArray, plain: FloatArray, products: FloatArray, norms: FloatArray
) -> Iterator[tuple[int, Score]]:
    """Score terms of one width ``k``: ``gram`` (T, k, k), ``products`` and ``norms`` (T, k).

    ``plain`` (T, k, k) is the Gram matrix beside the base by the data alone: what is dead there is known from
    the prior of the base only, and a candidate is none.
    """
    there = np.asarray(np.isfinite(norms).all(axis=1) & (norms > 1e-20).any(axis=1))
    scale = np.sqrt(np.where(there[:, None], np.maximum(norms, 1e-300), 1.0))
    size = scale[:, :, None] * scale[:, None, :]
    unit, own_unit = (np.where(there[:, None, None], own / size, 0.0) for own in (plain, gram))
    eigenvalues, vectors = np.linalg.eigh(unit)
    live = np.asarray(eigenvalues > _DEAD)
    # In the live directions the candidate has the information that is left beside base and prior.
    alive = live[:, :, None] & live[:, None, :]
    middle = np.where(alive, vectors.swapaxes(1, 2) @ own_unit @ vectors, 0.0)
    middle[:, range(middle.shape[1]), range(middle.shape[1])] += ~live
    inverse = np.where(alive, np.linalg.inv(middle), 0.0)
    turned = np.einsum("tij,ti->tj", vectors, products / scale)
    solved = np.einsum("tij,tj->ti", inverse, turned)
    gains = np.sum(turned * solved, axis=1)
    values = np.einsum("tij,tj->ti", vectors, solved) / scale
    stds = np.sqrt(np.einsum("tij,tjk,tik->ti", vectors, inverse, vectors).clip(0)) / scale
    surviving = np.sqrt(np.max(np.einsum("tii->ti", plain).clip(0) / scale**2, axis=1))
    # A column that the base takes whole leaves rounding, of either sign: nothing is known of its parameter.
    determined = np.einsum("tii->ti", unit) > _DEAD
    information = np.where(determined[:, :, None] & determined[:, None, :], gram, 0.0)
    for number, (term, grid) in enumerate(terms):
        count = int(np.count_nonzero(live[number]))
        if not there[number] or not count:
            continue
        free, errors, gain = values[number], tuple(stds[number].tolist()), float(gains[number])
        own = tuple(free.tolist())
        if isinstance(term.content, Effect):
            determined_products = np.where(determined[number], products[number], 0.0)
            bounded = inside(limits(term.content), information[number], determined_products, free)
            if bounded is not None:
                own, gain, count = tuple(bounded.values.tolist()), bounded.gain, max(1, count - len(bounded.held))
        found = Score(
            term=term,
            gain=gain,
            live=count,
            values=own,
            stds=errors,
            surviving=float(surviving[number]),
            information=information[number],
            free=tuple(free.tolist()),
            grid=grid,
        )
        yield number, found


def _scored_freely(
    terms: Sequence[tuple[Term, int]],
    held: tuple[FloatArray, FloatArray],
    shade: FloatArray,
    gram: FloatArray,
    plain: FloatArray,
    products: FloatArray,
    norms: FloatArray,
) -> dict[int, Score]:
    """Score terms as :func:`_scored`, each with those of the base's parameters let go that are positive beside it.

    A row of the prior holds a parameter at zero that would be negative without the term. With the term it may be
    positive, and then the row is left out. Which rows are left out is found for every term, from all of them:
    parameters that are negative beside the term, too, are held again.

    Parameters
    ----------
    held : (h, rank), (h,) of :attr:`fitting.residual.terms.Model.held`
    shade : (T, rank, k) the terms' columns in the base's basis
    """
    best = dict(_scored(terms, gram, plain, products, norms))
    sets = {number: tuple(range(len(held[1]))) for number in best} if len(held[1]) else {}
    while sets:
        rows = next(iter(sets.values()))
        chosen = [number for number, own in sets.items() if own == rows]
        basis, left = (part[list(rows)] for part in held)
        known = np.linalg.inv(np.eye(len(rows)) - basis @ basis.T + _ROUNDING * np.eye(len(rows)))
        cross = -basis @ shade[chosen]
        taken, alone = known @ cross, float(left @ known @ left)
        own_gram = gram[chosen] - cross.swapaxes(1, 2) @ taken
        own_products = products[chosen] - np.einsum("thk,h->tk", taken, left)
        sets = {number: own for number, own in sets.items() if own != rows}
        for member, score in _scored([terms[n] for n in chosen], own_gram, plain[chosen], own_products, norms[chosen]):
            number = chosen[member]
            low = known @ (left - cross[member] @ np.asarray(score.values)) > 0
            if low.any() and not low.all():
                sets[number] = tuple(row for row, negative in zip(rows, low, strict=True) if not negative)
            elif not low.any() and score.gain + alone > best[number].gain and score.gain > 0:
                whole = 1.0 + alone / score.gain
                best[number] = replace(score, gain=whole * score.gain, information=whole * score.information)
    return best


def catalogue_terms(model: Model, effects: Sequence[Effect]) -> tuple[list[Term], list[int]]:
    """List every effect on every joint it applies to, in every shape, with each one's grid size."""
    terms: list[Term] = []
    grid: list[int] = []
    machine = model.design.machine
    views = model.views[model.fitted[0]]
    for effect in effects:
        for joint in (None,) if effect.machine_wide else range(len(machine.joints)):
            if not effect.applies(machine, joint or 0):
                continue
            shapes = effect.shapes(views[joint or 0])
            variants = [()] if joint is None else effect.variants(machine, joint)
            own = [
                Term(effect, joint, {**shape, **({"other": float(others[0])} if others else {})})
                for others in variants
                for shape in shapes
            ]
            terms.extend(own)
            grid.extend([len(own)] * len(own))
    return terms, grid


def law_terms(model: Model) -> tuple[list[Term], list[int]]:
    """List every spline law of every joint."""
    joints = range(len(model.design.machine.joints))
    terms = [Term(law, joint) for joint in joints for law in laws(model.views, joint, model.fitted)]
    return terms, [1] * len(terms)
