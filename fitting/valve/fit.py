"""Fitting a valve's model: a grid, then Gauss and Newton with the linear parameters projected out.

Least squares of the speed over the rows that are kept. The grid is over the delay and the edges, with the best gains
at each point; from its best point the shape is refined. Intervals are those of a jackknife over blocks that are
several times as long as a residual hangs together (one or two seconds): a few steps show all of an edge or of a spool's
lag, the fit follows them, and sums of scores (a sandwich) call what is left the noise. Recordings differ from one
another by more than blocks do, which counts where three or more were fitted. What a few blocks show is no better known
than a variance from a few values: 95 % are Student's, with Satterthwaite's degrees of freedom.

A model's peers are a line, an autoregression, and a curve of the command alone. All three get the same rows, the same
filters and the same recordings, and are judged on the same other motion; the autoregression runs freely there, on
nothing but commands.

Sources: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973 (variable projection); H. Kuensch, Ann. Stat. 17, 1989
(jackknife over blocks); K. Liang and S. Zeger, Biometrika 73, 1986 (between recordings); F. Satterthwaite, Biometrics
Bulletin 2, 1946 (degrees of freedom).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy

from fitting.arrays import BoolArray, FloatArray
from fitting.estimators.effort_fit import long_run
from fitting.regression.freedom import SIGMAS, coverage_factors, freedom_of, moved_without
from fitting.residual.confirmation.local import Local
from fitting.signals.filters import delayed, lagged, recursive
from fitting.valve.laws import Bounds
from fitting.valve.model import WAYS, Shape, Structure, columns, openings, solved, speeds
from fitting.valve.rows import Axis

#: s, and share of full command, of the grid.
DELAYS = tuple(np.round(np.arange(0.0, 0.65, 0.08), 3))
EDGES = (0.0, 0.02, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.4)
#: Of a search that begins anew with another shape.
COARSE = (DELAYS[::2], EDGES[::2])
#: Of the delay's profile, s.
PROFILE = tuple(np.round(np.arange(0.0, 0.61, 0.05), 3))
#: s, and how many there are at least, of the blocks of a jackknife.
BLOCK, LEAST_BLOCKS = 8.0, 20
#: Share of a cycle to which moments of a command and of a position are known beside one another, at the best.
CLOCK = 0.01
#: Of a number's scale: steps of derivatives. The command has steps itself, and a smaller one sees single samples.
_STEP = 1e-2
_ITERATIONS = 30


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    axis, structure : what was fitted to what
    shape : numbers that were searched
    gains : linear parameters by name: m/s per full command, 1/Pa, ...
    residual : (M,) m/s, measured minus predicted; 0 in rows that are left out
    """

    axis: Axis
    structure: Structure
    shape: Shape
    gains: Mapping[str, float]
    residual: FloatArray = field(repr=False)

    @property
    def misfit(self) -> float:
        """RMS of the error over that of the speed."""
        return relative(self.axis, self.residual)

    @cached_property
    def jacobian(self) -> tuple[tuple[str, ...], FloatArray]:
        """Names of all free parameters, and what each does to the predicted speed, (M, p); 0 in rows left out.

        What is at the end of its interval is not free.
        """
        axis, structure = self.axis, self.structure
        names, matrix = columns(axis, structure, self.shape)
        free = [n for n in names if self.gains[n] > 0]
        inside, ends = list[str](), list[float]()
        for name, (start, low, high) in structure.shape().items():
            step, here = _STEP * _scale_of((start, low, high)), self.shape[name]
            if low + 1e-6 * step < here < high - 1e-6 * step:
                inside.append(name)
                ends += [max(here - step, low), min(here + step, high)]
        shapes = [{**self.shape, inside[k // 2]: end} for k, end in enumerate(ends)]
        slopes = np.diff(speeds(axis, structure, shapes, self.gains))[:, ::2] / np.diff(ends)[::2]
        acting = np.any(slopes[axis.keep], axis=0)
        whole = np.hstack([matrix[:, [names.index(n) for n in free]], slopes[:, acting]])
        free += [name for name, own in zip(inside, acting, strict=True) if own]
        return tuple(free), np.where(axis.keep[:, None], whole, 0.0)

    @cached_property
    def rows(self) -> float:
        """Independent values of the residual in kept rows where what was added last acts: a leak at rest, too."""
        keep, e = self.axis.keep, self.residual[self.axis.keep]
        always = any(name.partition(".")[0] in self.structure.effects[-1:] for name in self.gains)
        acting = self.axis.reduced(((self.openings != 0.0) | always).astype(float))[keep]
        return max(float(acting.sum()) / long_run(e), 1.0)

    @cached_property
    def openings(self) -> FloatArray:
        """m/s (N,) before the filters by what the valve lets through, without what stiffness and leaks take."""
        parts = openings(self.axis, self.structure, self.shape)
        return np.asarray(sum(self.gains[name] * own for name, own in parts.items()))

    @cached_property
    def scaled(self) -> tuple[tuple[str, ...], FloatArray, FloatArray, float]:
        """Names, columns (M, p) of what is known before any data, those units (p,), and the noise, (m/s)^2 a row.

        Before any data a number of the shape is known to a quarter of its interval, a gain to its own size.
        """
        names, J = self.jacobian
        bounds = self.structure.shape()
        wide = [0.25 * (bounds[n][2] - bounds[n][1]) if n in bounds else self.gains[n] for n in names]
        return names, J * wide, np.array(wide), max(float(self.residual @ self.residual) / self.rows, 1e-30)

    @property
    def local(self) -> Local:
        """The model about its optimum, in the units of :attr:`scaled`."""
        names, columns, _, noise = self.scaled
        return Local(columns, self.residual, noise * np.eye(len(names)), noise, self.rows)

    def on(self, judged: Axis) -> tuple[Fit, Local]:
        """Refit on another motion: what the fit leaves of it, and :attr:`local` with the columns there."""
        there = replace(self, axis=judged, residual=np.where(judged.keep, judged.speed - predicted(judged, self), 0.0))
        (names, J), (own, _, wide, _) = there.jacobian, self.scaled
        columns = [J[:, names.index(name)] if name in names else np.zeros(len(J)) for name in own]
        moved = replace(self.local, columns=np.column_stack(columns) * wide, residual=there.residual, rows=there.rows)
        return there, moved

    @cached_property
    def covariance(self) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """Names of the free parameters, their covariance (p, p), and what each block moves (blocks, p)."""
        names, J, wide, noise = self.scaled
        r, inverse = self.residual, np.linalg.inv(J.T @ J + noise * np.eye(len(names)))
        groups = [np.flatnonzero(self.axis.recordings == number) for number in np.unique(self.axis.recordings)]
        length = min(BLOCK * self.axis.bank.reduced_rate_hz, len(r) / LEAST_BLOCKS)
        blocks = [b for g in groups for b in np.array_split(g, max(1, round(len(g) / length)))]
        moves = moved_without(J, r, blocks, noise)
        S = moves.T @ moves + noise**2 * inverse @ inverse
        if len(groups) >= 3:
            scores = inverse @ np.array([J[g].T @ r[g] for g in groups]).T
            between = np.sum(scores**2, axis=1) * (len(groups) / (len(groups) - 1))
            more = np.sqrt(np.maximum(between / np.maximum(np.diag(S), 1e-300), 1.0))
            S = S * np.outer(more, more)
        S = S * np.outer(wide, wide)
        if "delay" in names:
            place = names.index("delay")
            S[place, place] += (CLOCK / self.axis.bank.rate_hz) ** 2
        return names, S, moves * wide

    def spread(self, slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute standard deviations and half 95 % intervals (k,) by ``slopes`` (k, p) over free parameters."""
        _, S, moves = self.covariance
        std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, S, slopes), 0.0))
        return std, SIGMAS * coverage_factors(freedom_of(moves @ slopes.T)) * std

    def bar(self, name: str) -> tuple[float, float] | None:
        """Compute a parameter's :meth:`spread`; None at the end of its interval, or if absent."""
        names = self.covariance[0]
        if name not in names:
            return None
        std, half = self.spread(np.eye(len(names))[[names.index(name)]])
        return float(std[0]), float(half[0])


def relative(axis: Axis, residual: FloatArray) -> float:
    """Compute an error's (M,) RMS over the measured speed's, on kept rows."""
    keep = axis.keep
    return float(np.sqrt(np.mean(residual[keep] ** 2) / max(float(np.mean(axis.speed[keep] ** 2)), 1e-30)))


def _scale_of(bounds: Bounds) -> float:
    """Return a usual change of a number that is searched."""
    start, low, high = bounds
    return max(abs(start), 0.02 * (high - low)) if start else 0.05 * (high - low)


def predicted(axis: Axis, fit: Fit) -> FloatArray:
    """Predict filtered speed (M,) for an axis, of other recordings too."""
    return speeds(axis, fit.structure, [fit.shape], fit.gains)[:, 0]


def fitted(axis: Axis, structure: Structure, start: Shape | None = None, *, iterations: int = _ITERATIONS) -> Fit:
    """Fit the model to an axis.

    Parameters
    ----------
    start : where the search begins, as far as given; without a delay the grid is searched with the rest held
    """
    bounds = structure.shape()
    begun = {name: own[0] for name, own in bounds.items()} | dict(start or {})
    if start is None or "delay" not in start:
        begun |= _grid(axis, structure, begun, (DELAYS, EDGES) if start is None else COARSE)
    return _refined(axis, structure, {name: begun[name] for name in bounds}, (), iterations)


def profile(fit: Fit) -> list[tuple[float, float]]:
    """Compute the model's misfit over the delay, s, everything else at its best, each from the last."""
    found, best = list[tuple[float, float]](), fit.shape["delay"]
    for side in (sorted(d for d in PROFILE if d >= best), sorted((d for d in PROFILE if d < best), reverse=True)):
        own = fit
        for delay in side:
            own = _refined(fit.axis, fit.structure, {**own.shape, "delay": delay}, ("delay",), iterations=5)
            found.append((float(delay), own.misfit))
    return sorted(found)


def _grid(
    axis: Axis, structure: Structure, shape: Shape, points: tuple[tuple[float, ...], tuple[float, ...]]
) -> dict[str, float]:
    """Find a line's best delay and edges of a grid: one edge for both directions, then each its own."""
    structure, keep, y = replace(structure, curve="line"), axis.keep, axis.speed[axis.keep]

    def cost(own: dict[str, float]) -> float:
        matrix = columns(axis, structure, {**shape, **own})[1][keep]
        return float(np.linalg.norm(y - matrix @ solved(matrix, y)))

    best = min(({"delay": d, "edge.extend": e, "edge.retract": e} for d in points[0] for e in points[1]), key=cost)
    for way in WAYS:
        best = min(({**best, f"edge.{way}": edge} for edge in reversed(points[1])), key=cost)  # unseen: shut
    return best


def _refined(
    axis: Axis, structure: Structure, shape: Shape, held: tuple[str, ...], iterations: int = _ITERATIONS
) -> Fit:
    bounds = structure.shape()
    free = [name for name in shape if name not in held]
    scales = np.array([_scale_of(bounds[name]) for name in free])
    low, high = (np.array([bounds[name][k] for name in free]) / scales for k in (1, 2))
    keep, y = axis.keep, axis.speed

    def at(z: FloatArray) -> dict[str, float]:
        return {**shape, **dict(zip(free, (z * scales).tolist(), strict=True))}

    def solution(z: FloatArray) -> tuple[FloatArray, FloatArray, dict[str, float]]:
        names, matrix = columns(axis, structure, at(z))
        gains = solved(matrix[keep], y[keep])
        return matrix, gains, dict(zip(names, gains.tolist(), strict=True))

    def residual(z: FloatArray) -> FloatArray:
        matrix, gains, _ = solution(z)
        return np.asarray(y - matrix @ gains)[keep]

    def slope(z: FloatArray) -> FloatArray:
        matrix, gains, named = solution(z)
        steps = np.where(z + _STEP <= high, _STEP, -_STEP)
        moved = speeds(axis, structure, [at(own) for own in z + np.diag(steps)], named)
        bent = ((matrix @ gains)[:, None] - moved)[keep] / steps
        basis = np.linalg.qr(matrix[keep][:, gains > 0])[0]
        return np.asarray(bent - basis @ (basis.T @ bent))

    begin = np.clip([shape[name] for name in free] / scales, low + 1e-6, high - 1e-6)
    answer = scipy.optimize.least_squares(
        residual, begin, jac=slope, bounds=(low, high), max_nfev=iterations, xtol=1e-5, ftol=1e-7
    )
    matrix, gains, named = solution(answer.x)
    return Fit(axis, structure, at(answer.x), named, np.where(keep, y - matrix @ gains, 0.0))


#: Rows at the start of a stretch in which an autoregression has not forgotten that it began from nothing.
_SETTLING = 8


def peers_of(axis: Axis, judged: Axis) -> tuple[dict[str, float | None], Fit]:
    """Compute errors of peers fitted to an axis on another motion, RMS over the speed's, and the static curve.

    ``linear``: one gain and a delay; ``arx``: two poles, two zeros and a delay, simulated, None where that has no end;
    ``static``: a curve of the command and a delay, no pressures: what is handed out where nothing is better.
    """
    curve = fitted(axis, Structure(curve="monotone"))
    arx = min(_arx(axis, judged, lag) for lag in range(round(DELAYS[-1] * axis.bank.reduced_rate_hz) + 1))[1]
    errors = {
        "linear": min(_linear(axis, judged, delay) for delay in DELAYS)[1],
        "arx": arx if np.isfinite(arx) else None,
        "static": relative(judged, judged.speed - predicted(judged, curve)),
    }
    return errors, curve


def _linear(axis: Axis, judged: Axis, delay: float) -> tuple[float, float]:
    """Compute errors on the fitted rows and on others."""
    one, other = (
        own.reduced(delayed(own.signals.parts, own.signals.u, delay * axis.bank.rate_hz)) for own in (axis, judged)
    )
    gain = float(one[axis.keep] @ axis.speed[axis.keep]) / max(float(one[axis.keep] @ one[axis.keep]), 1e-30)
    return relative(axis, axis.speed - gain * one), relative(judged, judged.speed - gain * other)


def _arx(axis: Axis, judged: Axis, lag: int) -> tuple[float, float]:
    """Compute errors, simulated freely, on fitted and other rows: ``y_k = a y_(k-1..2) + b u_(k-lag..lag+1)``."""
    rows, right = [], []
    for u, y, keep in _series(axis):
        late = np.concatenate([np.full(lag, u[0]), u])[: len(u)]
        block = lagged(late, y, poles=2, zeros=2)
        kept = keep[2:] & keep[1:-1] & keep[:-2]
        rows.append(block[kept])
        right.append(y[2:][kept])
    a = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    if np.any(np.abs(np.roots([1.0, -a[0], -a[1]])) >= 1.0):
        return np.inf, np.inf
    return _simulated(axis, a, lag), _simulated(judged, a, lag)


def _simulated(axis: Axis, a: FloatArray, lag: int) -> float:
    errors = list[FloatArray]()
    for u, y, keep in _series(axis):
        late = np.concatenate([np.full(lag, u[0]), u])[: len(u)]
        out = recursive([a[2], a[3], 0.0], [1.0, -a[0], -a[1]], late)
        errors.append(np.where(keep & (np.arange(len(y)) >= _SETTLING), y - out, 0.0))
    return relative(axis, np.concatenate(errors))


def _series(axis: Axis) -> Iterator[tuple[FloatArray, FloatArray, BoolArray]]:
    """Return filtered command, speed and whether a row is kept (rows,), by stretch."""
    start = 0
    for part in axis.signals.parts:
        u = axis.bank.reduce(axis.signals.u[part])
        own = slice(start, start + len(u))
        start += len(u)
        yield u, axis.speed[own], axis.keep[own]
