"""Fit of joint efforts with equal weights: every row of every joint counts alike, whatever the noise is like.

Rows are filtered joint efforts (N m or N) over all fitted recordings, ``unloaded`` ones at the joint's mean lever arm::

    r (p1 A1 - p2 A2 - c v)  =  r D_i(x, v, a) theta_i  +  Y_b(q, q', q'') beta  +  r E eta

What is minimised is what a user sees, the error of the effort, beside the divergence from a plausible arm
(:mod:`fitting.regression.plausible_arm`). It does not ask for a right model, as weights by a noise spectrum do. Rows
are folded into one triangle per joint (:func:`fitting.regression.streamed.triangle`), so that recordings of any length
and any scale per joint are solved from it. Deviations are those of a sandwich (``hac``, see
:mod:`fitting.estimators.covariance`): the residual of a model that is not whole is neither white nor of one size.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy

from daq.recordings.recording_checks import runs
from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.estimators.base import Estimate
from fitting.estimators.covariance import Colour, autoregression, check_colour, series_scores
from fitting.estimators.least_squares import solve
from fitting.estimators.ols import OrdinaryLeastSquares
from fitting.regression.design import Design, Extra
from fitting.regression.plausible_arm import ALONE
from fitting.regression.prior import Prior, data_share, rows_of_prior
from fitting.regression.solving import Factor, Fit, factor
from fitting.regression.streamed import triangle

#: Standard errors by which least squares has to be better on positions left out, and the rise of the training error up
#: to which a plausible arm costs nothing that a motion could refuse.
REFUSED, FREE = 2.0, 1.01
#: Share of a joint's positions that is left out at either end.
OUTER = 0.25
#: Chance that a right fit exceeds what is reported to be its error at most, and short recordings of two equal noises.
CHANCE = 1e-3
_SHORT = 20  # rows below which a series determines nothing of its own colour
#: Logarithm of the least variance of noise over that of the effort, how many are tried, and what is not probable.
_QUIET, _GRID, _IMPROBABLE = -60.0, 601, 40.0


class EffortRows:
    """Joint-effort rows of some segments, all of them or as one triangle per joint.

    Parameters
    ----------
    design, indices, extra : whose segments, and columns beside those of the design
    posed : take an ``unloaded`` row at the lever arm where the joint stood, and not at its mean one
    """

    def __init__(
        self, design: Design, indices: Sequence[int], extra: Extra | None = None, *, posed: bool = False
    ) -> None:
        self._design, self._indices, self._extra = design, tuple(indices), extra
        self._levers = None if posed else mean_levers(design)
        self._made: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}

    @property
    def _joints(self) -> range:
        return range(len(self._design.machine.joints))

    @cached_property
    def triangles(self) -> list[FloatArray]:
        """Per joint ``R`` (at most p + 1, p + 1) with ``R'R = [A b]'[A b]`` over its rows."""
        return [triangle(np.column_stack(part) for part in self.parts(joint)) for joint in self._joints]

    @cached_property
    def rows(self) -> IntArray:
        """Number of rows of each joint, (n,)."""
        kept = [[self._design.blocks[joint][i].keep for i in self._indices] for joint in self._joints]
        return np.array([sum(int(np.count_nonzero(keep)) for keep in own) for own in kept])

    def stacked(self, folded: bool = False) -> tuple[FloatArray, FloatArray, IntArray]:
        """Stack columns (R, p), target (R,) and joint (R,) of all rows; of the triangles where ``folded``."""
        tables = self.triangles
        if not folded:
            tables = [np.vstack([np.column_stack(part) for part in self.parts(joint)]) for joint in self._joints]
        whole = np.vstack(tables)
        return whole[:, :-1], whole[:, -1], np.repeat(np.arange(len(tables)), [len(own) for own in tables])

    @property
    def columns(self) -> int:
        """Number of parameters: drive, base, effects."""
        return int(self.triangles[0].shape[1]) - 1

    def parts(self, joint: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Return columns (M, p) and target (M,) of one joint by segment, rows at rest left out."""
        for index in self._indices:
            columns, target = self._part(joint, index)
            keep = self._design.blocks[joint][index].keep
            yield columns[keep], target[keep]

    def _part(self, joint: int, index: int) -> tuple[FloatArray, FloatArray]:
        """Return columns (M, p) and target (M,) of a joint in one segment, with rest; cached where there is memory."""
        if (joint, index) in self._made:
            return self._made[joint, index]
        design, extra = self._design, self._extra
        segment, block = design.segments[index], design.blocks[joint][index]
        r = segment.r[:, joint]
        if self._levers is not None and not segment.loaded:
            r = np.full(len(segment), self._levers[joint])
        target, own = block.effort(design.bank, r)
        columns = block.wide(own)
        if extra is not None:
            columns = extra.beside(columns, design.bank, joint, index, r)
        if not design.stored:
            self._made[joint, index] = columns, target
        return columns, target

    def errors(self, theta: FloatArray) -> FloatArray:
        """Compute the RMS of each joint's error (n,), N m or N, not a number where a joint has no rows."""
        sums = np.array([np.sum((R[:, -1] - R[:, :-1] @ theta) ** 2) for R in self.triangles])
        return np.asarray(np.sqrt(sums / np.where(self.rows > 0, self.rows, np.nan)))

    def least_squares(self, prior: Prior) -> FloatArray:
        """Solve least squares for the parameters (p,) with the prior of moving masses, without the plausible arm's."""
        return self._solved(self._stacked, prior.unsettled(), self.spread)[0]

    @cached_property
    def spread(self) -> float:
        """Divisor that makes a row's noise unity: root of the residual's variance, of all joints per degree of
        freedom (:func:`noise_variance`), and of how much longer it is correlated than white noise (:func:`long_run`).
        """
        variance, theta = noise_variance(self.triangles, int(self.rows.sum()))
        residual = self._residual(theta)
        squares = np.array([float(e @ e) for e in residual])
        if not squares.sum() > 0:
            return 1.0
        colour = float(np.sum(squares * [long_run(e) for e in residual]) / squares.sum())
        return float(np.sqrt(variance * colour))

    @cached_property
    def _stacked(self) -> FloatArray:
        """The triangles of all joints, one below the other."""
        return np.vstack(self.triangles)

    @property
    def _effects(self) -> int:
        return 0 if self._extra is None else len(self._extra.names)

    def _residual(self, theta: FloatArray) -> list[FloatArray]:
        parts = [[b - A @ theta for A, b in self.parts(joint)] for joint in self._joints]
        return [np.concatenate(own) if own else np.zeros(0) for own in parts]

    def _solved(self, stacked: FloatArray, prior: Prior, spread: float) -> tuple[FloatArray, Factor]:
        unit = np.vstack([stacked / spread, self._prior_rows(prior)])
        found = factor(unit[:, :-1], self._effects)
        return found.root @ (found.Q.T @ unit[:, -1]), found

    def _prior_rows(self, prior: Prior) -> FloatArray:
        """Return prior rows ``[A b]`` (R, p + 1) of unit noise."""
        parameters = self._design.parameters
        without = replace(prior, delay=None, delay_std=None)
        known = np.column_stack(rows_of_prior(parameters, without, self.columns))
        expected = () if self._extra is None else self._extra.expected_rows(len(parameters))
        return np.vstack([known, *(np.column_stack([own.A, own.b]) for own in expected)])

    def settled(self, prior: Prior) -> Prior:
        """Return the prior at the point that fits these rows; without the plausible arm where they refuse it."""
        found = replace(prior, refused=False).settled(*self._unit_rows(prior, self._stacked))
        errors = [self.errors(self._solved(self._stacked, p, self.spread)[0]) for p in (found, prior.unsettled())]
        return replace(prior.unsettled(), refused=True) if self._refuses_arm(found, *errors) else found

    def possible(self, prior: Prior) -> FloatArray:
        """Compute the drives' and base parameters nearest to the rows among the physically possible."""
        assert prior.arm is not None
        return prior.arm.optimum(*self._unit_rows(prior, self._stacked), weight=ALONE).theta

    def _unit_rows(self, prior: Prior, stacked: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rows ``A, b`` of unit noise with all that is known a priori but for the arm."""
        unit = np.vstack([stacked / self.spread, self._prior_rows(prior.unsettled())])
        return unit[:, :-1], unit[:, -1]

    def _refuses_arm(self, prior: Prior, with_arm: FloatArray, without: FloatArray) -> bool:
        """Return True where least squares beat the fit with the plausible arm on positions left out of both.

        Inside one motion least squares looks better, whatever the truth: it has more freedom, and rows a moment apart
        share what the model lacks. So it is asked where neither has been: each joint's lowest and highest quarter of
        positions is left out in turn, both are fitted to the rest, and their squared errors on what was left out are
        compared, stretch of time by stretch of time. Where least squares is better by more than :data:`REFUSED`
        standard errors, the machine file, the time axis or the base model is wrong, and a plausible arm hides it.

        Parameters
        ----------
        prior : at the arm's point
        with_arm, without : (n,) errors of the two fits to all rows (:meth:`errors`)
        """
        first, second = (float(np.nansum(self.rows * e**2)) for e in (with_arm, without))
        if prior.point is None or not first > FREE**2 * second:
            return False
        differences = [change for out in self._outer() for change in self._left_out(prior, out)]
        error = float(np.std(differences, ddof=1) * np.sqrt(len(differences))) if len(differences) > 1 else np.inf
        return float(np.sum(differences)) > REFUSED * error

    def _outer(self) -> Iterator[dict[int, BoolArray]]:
        """Return each segment's rows in the lowest and in the highest quarter of each joint's positions."""
        design = self._design
        places = {i: design.bank.reduce(design.segments[i].q) for i in self._indices if design.segments[i].loaded}
        for joint, own in enumerate(np.vstack(list(places.values())).T if places else []):
            low, high = np.quantile(own, [OUTER, 1.0 - OUTER])
            yield {i: q[:, joint] < low for i, q in places.items()}
            yield {i: q[:, joint] > high for i, q in places.items()}

    def elsewhere(self, prior: Prior, theta: FloatArray) -> FloatArray:
        """Compute by how much (n,) errors on held-out positions exceed those of a fit to all, as mean squares.

        In units of the drives' efforts; 0 where they are not. A model that is not whole errs more where it was not
        fitted, which no covariance of its parameters knows.
        """
        joints, design = range(len(self.triangles)), self._design
        sums, counts = np.zeros(len(joints)), np.zeros(len(joints))
        for out in self._outer():
            rest = self._rest(out)
            settled = prior if prior.point is None else prior.settled(*self._unit_rows(prior, rest))
            other = self._solved(rest, settled, self.spread)[0]
            for i, where in out.items():
                levers = np.abs(design.bank.reduce(design.segments[i].r))
                for joint in joints:
                    kept = where & design.blocks[joint][i].keep
                    A, b = (
                        own[kept] / levers[kept, joint].reshape(-1, *[1] * (own.ndim - 1))
                        for own in self._part(joint, i)
                    )
                    sums[joint] += np.sum((b - A @ other) ** 2 - (b - A @ theta) ** 2)
                    counts[joint] += len(b)
        return np.asarray(np.maximum(sums / np.maximum(counts, 1), 0.0))

    def _rest(self, out: Mapping[int, BoolArray]) -> FloatArray:
        """Return the triangle of all rows but those that are left out."""
        return triangle(
            np.column_stack(self._part(joint, i))[
                self._design.blocks[joint][i].keep & ~out.get(i, np.zeros(1, dtype=bool))
            ]
            for joint in range(len(self.triangles))
            for i in self._indices
        )

    def _left_out(self, prior: Prior, out: Mapping[int, BoolArray]) -> list[float]:
        """Compute the squared error with the arm less that without on the rows ``out``, by stretch of time."""
        joints, blocks = self._joints, self._design.blocks
        rest = self._rest(out)
        ends = prior.settled(*self._unit_rows(prior, rest)), prior.unsettled()
        fits = [self._solved(rest, own, self.spread)[0] for own in ends]
        changes = []
        for i, where in out.items():
            change = np.zeros(len(where))
            for joint in joints:
                A, b = self._part(joint, i)
                first, second = (b - A @ theta for theta in fits)
                change += np.where(blocks[joint][i].keep, first**2 - second**2, 0.0)
            changes += [float(np.sum(change[run])) for run in runs(where)]
        return changes

    def ordinary(self, wanted: IntArray, frozen: FloatArray, colour: Colour) -> Estimate:
        """Solve ordinary least squares of the columns ``wanted``, all others frozen at ``frozen`` (p,).

        Of long recordings the triangles are solved. A second walk through the rows gives residuals, and with
        ``Q = A root`` the scores that the covariance is made of: each segment of each joint is a series of its own
        there, and what neighbouring segments have in common at their seam, one correlation time of some minutes, is
        left out.
        """
        known = frozen.copy()
        known[wanted] = 0.0
        long = self._design.stored
        columns, target, groups = self.stacked(folded=long)
        A, b = columns[:, wanted], target - columns @ known
        if not long:
            return OrdinaryLeastSquares(colour=colour).fit(A, b, groups=groups)
        check_colour(colour)
        solution = solve(A, b)
        known[wanted] = solution.theta
        rng = np.random.default_rng(20)  # the same residual gives the same deviation
        squares, freedom = np.zeros((2, len(self._joints)))
        S = np.zeros((solution.rank, solution.rank))
        for joint in self._joints:
            for own, measured in self.parts(joint):
                Q, e = own[:, wanted] @ solution.root, measured - own @ known
                squares[joint] += float(e @ e)
                freedom[joint] += len(e) - float(np.sum(Q**2))
                if colour != "white" and len(e):
                    S += series_scores(Q, e, colour, rng)
        # Freedom of all joints: rows less rank; a leverage sums to the rank.
        free = float(freedom.sum())
        middle = float(squares.sum()) / free if colour == "white" else S * ((free + solution.rank) / free)
        return Estimate(
            theta=solution.theta,
            covariance=solution.covariance(middle),
            residual_std=np.sqrt(squares / np.where(freedom > 1e-6, freedom, np.nan)),
            groups=np.arange(len(squares)),
            condition_number=solution.condition_number,
            determined=solution.determined,
        )

    def fit(self, prior: Prior) -> Fit:
        """Fit the most probable parameters with equal weights beside a settled prior, with sandwich deviations."""
        theta, found = self._solved(self._stacked, prior, self.spread)
        determined = np.zeros(self.columns, dtype=bool)
        determined[found.determined] = True
        rng = np.random.default_rng(20)
        closing = self._prior_rows(prior)[:, :-1] @ found.root
        S = np.zeros((found.root.shape[1], found.root.shape[1]))
        residual = self._residual(theta)
        for joint, e in enumerate(residual):
            if len(e):
                A = np.vstack([own for own, _ in self.parts(joint)])
                S += series_scores(A @ found.root / self.spread, e / self.spread, "hac", rng)
        # A prior's row is as uncertain as it states; what it adds takes no degree of freedom.
        count, rank = int(self.rows.sum()), found.root.shape[1]
        taken = max(rank - float(np.sum(closing**2)), 0.0)
        S = S * count / max(count - taken, 1.0) + closing.T @ closing
        parameters = self._design.parameters
        return Fit(
            theta=theta,
            covariance=found.root @ S @ found.root.T,
            determined=determined,
            orthonormal=tuple(np.zeros((len(e), 0)) for e in residual),
            residual=tuple(residual),
            condition_number=factor(self._stacked[:, :-1], self._effects).condition_number,
            share=data_share(found.root @ found.root.T, parameters, prior),
        )


def noise_variance(triangles: Sequence[FloatArray], rows: int) -> tuple[float, FloatArray]:
    """Estimate the variance of a row's noise, and the most probable parameters (p,) with it.

    Where rows are many, the squares that least squares leaves per degree of freedom. Where they are hardly more than
    the columns, or fewer, least squares leaves nothing, whatever the noise is; but a contribution is no larger than its
    joint's own effort, so that what is in directions too weak for that is noise. With ``d`` the singular values of the
    columns in such sizes, ``c = U'b`` and ``s`` the noise, ``c_i ~ N(0, d_i^2 + s^2)``, and the rest of ``b`` is noise
    alone (evidence of MacKay, Neural Computation 4 (1992) 415); the variance is its mean over ``s``, all of which are
    as probable beforehand.

    Parameters
    ----------
    triangles : per joint ``R`` (.., p + 1) with ``R'R = [A b]'[A b]``
    rows : how many rows they are made of
    """
    sizes = [float(np.linalg.norm(R[:, -1])) for R in triangles]
    whole, power = np.vstack(triangles), float(np.sum(np.square(sizes)))
    own = np.zeros(whole.shape[1] - 1)
    if not power > 0:
        return 0.0, own
    for R, size in zip(triangles, sizes, strict=True):
        own += np.sum(R[:, :-1] ** 2, axis=0) / size**2 if size > 0 else 0.0
    largest = np.divide(1.0, np.sqrt(own), out=np.zeros_like(own), where=own > 0)
    U, d, V = np.linalg.svd(whole[:, :-1] * largest, full_matrices=False)
    c = U.T @ whole[:, -1]
    beside, free = float(np.sum((whole[:, -1] - U @ c) ** 2)), max(rows - len(d), 0)

    def deviance(log: FloatArray) -> FloatArray:
        """Compute twice the negative log probability of logarithms (k,) of the variance."""
        variance = np.exp(log)
        total = d**2 + variance[:, None]
        return np.asarray(np.sum(np.log(total) + c**2 / total, axis=1) + (free - 1) * log + beside / variance)

    log = np.log(power / rows) + np.linspace(_QUIET, 0.0, _GRID)
    for _ in range(2):
        found = deviance(log)
        near = np.flatnonzero(found < found.min() + _IMPROBABLE)
        log = np.linspace(log[max(near[0] - 1, 0)], log[min(near[-1] + 1, _GRID - 1)], _GRID)
    found = deviance(log)
    chance = np.exp((found.min() - found) / 2)
    variance = float(chance @ np.exp(log) / chance.sum())
    return variance, largest * (V.T @ (d * c / (d**2 + variance)))


def long_run(series: FloatArray) -> float:
    """Compute a series' long-run variance over its variance, at least 1: by :func:`autoregression`."""
    if len(series) < _SHORT or not series.any():
        return 1.0
    taps = autoregression(series)
    innovations = scipy.signal.lfilter(taps, [1.0], series)[len(taps) - 1 :]
    return max(1.0, float(np.var(innovations) / np.sum(taps) ** 2 / np.mean(series**2)))


def mean_levers(design: Design) -> FloatArray:
    """Compute the RMS of each joint's lever arm over the loaded segments, (n,), m/rad; 1 where it has none."""
    joints = len(design.machine.joints)
    loaded = [s for s in design.segments if s.loaded]
    if not loaded:
        return np.ones(joints)
    squares = np.sum([np.sum(s.r**2, axis=0) for s in loaded], axis=0)
    return np.asarray(np.sqrt(squares / sum(len(s) for s in loaded)))


def predicted_std(rows: EffortRows, fit: Fit) -> FloatArray:
    """Compute the standard deviation (n,), N m or N, of each joint's predicted effort by uncertain parameters.

    Root mean square over some rows; not a number where a joint has none.
    """
    squares = [float(np.sum((R[:, :-1] @ fit.covariance) * R[:, :-1])) for R in rows.triangles]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0) / np.where(rows.rows > 0, rows.rows, np.nan)))


def parameter_error(rows: EffortRows, fit: Fit, floor: FloatArray) -> float:
    """Bound the error of some rows by the uncertainty of a fit's parameters, in noise floors.

    Root mean square over the joints of each joint's error in its floor. With ``C`` the covariance and ``X_j`` a joint's
    rows, its square is ``e' G e`` of a normal ``e``, ``G = C^(1/2)' (sum_j X_j'X_j / (N_j f_j^2 n)) C^(1/2)``: about a
    chi-square of ``tr(G)^2 / tr(G^2)`` degrees of freedom (Satterthwaite, Biometrics Bulletin 2, 1946).

    Parameters
    ----------
    rows : of the motion that is predicted
    fit : parameters and their covariance
    floor : (n,) noise floor of each joint
    """
    there = [j for j, count in enumerate(rows.rows) if count and floor[j] > 0]
    if not there:
        return 0.0
    grams = [rows.triangles[j][:, :-1].T @ rows.triangles[j][:, :-1] / (rows.rows[j] * floor[j] ** 2) for j in there]
    G = fit.covariance @ (np.sum(grams, axis=0) / len(there))
    mean, square = float(np.trace(G)), float(np.sum(G * G.T))
    if not mean > 0 or not square > 0:
        return 0.0
    freedom = mean**2 / square
    return float(np.sqrt(mean * scipy.stats.chi2.isf(CHANCE, freedom) / freedom))
