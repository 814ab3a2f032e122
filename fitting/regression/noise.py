"""The noise floor: how much of a residual is measurement noise and disturbance.

With a `repeat` recording it is measured: the same motion twice, so the difference of the two *residuals* (not of the
raw signals, because the motion is never bit-identical) holds noise only, of twice the variance. Without one it
is estimated from what a very flexible model leaves, and reported as an estimate.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import TypeVar

import numpy as np

from daq.recordings.recording_checks import runs
from fitting.arrays import BoolArray, FloatArray
from fitting.regression.design import Design, Extra, NoiseModel, full_residual, moving_rows, white_noise_model
from fitting.regression.streamed import fit_rows
from fitting.signals.filters import FilterBank, lag_between
from fitting.signals.preparation import STILL, reach
from fitting.signals.spectrum import unit_whitening, whitening
from fitting.signals.splines import spline_basis

_T = TypeVar("_T")

#: Reduced rows that a repeated stretch needs to state something of the noise.
_LEAST_ROWS = 20
_MAX_LAG_SECONDS = 4.0
#: Two runs of one motion differ by less than this share of its spread; nowhere by more than the second, before they are
#: aligned to the sample.
_ALIKE, _NEAR = 0.02, 0.15
_PASSES = 2  # of a fit and the noise that it leaves
_COARSE = 4  # samples: steps of the first search for a lag
#: Training segments that a repeated one is laid upon at most, and segments that a noise is estimated from at most, of
#: hours cut into minutes: its spectrum has six coefficients, which an hour determines. All samples are fitted.
_MOST_LAID, _MOST_SEGMENTS = 20, 12


@dataclass(frozen=True)
class Pairing:
    """A stretch of a `repeat` segment and the stretch of a `train` segment with the same motion."""

    train: int
    repeat: int
    train_start: int
    repeat_start: int
    length: int

    @property
    def rows(self) -> tuple[slice, slice]:
        """The stretch in the `train` segment, and in the `repeat` segment."""
        begins = self.train_start, self.repeat_start
        return slice(begins[0], begins[0] + self.length), slice(begins[1], begins[1] + self.length)


def pair_repeats(design: Design) -> tuple[Pairing, ...]:
    """Find for each `repeat` segment the training segment it repeats, aligned in time.

    A segment is paired only if, after alignment, its joint positions follow the training motion to within 2 % of
    their spread. Where the ways to and from the motion differ, as those of a controller do that comes from elsewhere,
    the stretch between them is paired, if it is most of the recording.
    """
    pairs = []
    for repeat in design.indices("repeat"):
        place = design.segments[repeat].start
        near = sorted(design.indices("train"), key=lambda train: abs(design.segments[train].start - place))
        laid = [_laid(design, train, repeat) for train in sorted(near[:_MOST_LAID])]
        apart, best = min(laid, key=itemgetter(0), default=(np.inf, None))
        if best is not None and apart < _ALIKE and design.bank.rows(best.length) > _LEAST_ROWS:
            pairs.append(best)
    return tuple(pairs)


def _laid(design: Design, train: int, repeat: int) -> tuple[float, Pairing]:
    """Find the stretches of two segments that are one motion, and their largest distance over their spread."""
    a, b = design.segments[train].q, design.segments[repeat].q
    # A joint that is parked is where it is in both, and what it trembles is no motion.
    reaches = np.array([reach(joint, False) for joint in design.machine.joints])
    moves = np.maximum(np.ptp(a, axis=0), np.ptp(b, axis=0)) >= STILL * reaches
    a, b = (values[:, moves] if moves.any() else values for values in (a, b))
    spread = np.maximum(a.std(axis=0), 1e-9)
    most = int(_MAX_LAG_SECONDS * design.bank.rate_hz)
    whole = _aligned(Pairing(train, repeat, 0, 0, 0), a, b, most)
    apart = _apart(whole, a, b, spread)
    if apart < _ALIKE:
        return apart, whole
    lag = _lag_of_most(a, b, spread, most)
    late_a, late_b = max(0, -lag), max(0, lag)
    length = min(len(a) - late_a, len(b) - late_b)
    together = runs(_near(a[late_a:][:length], b[late_b:][:length], spread))
    run = max(together, key=lambda own: own.stop - own.start, default=slice(0, 0))
    if run.stop - run.start < 0.5 * min(len(a), len(b)):
        return apart, whole
    begins = late_a + run.start, late_b + run.start
    cut = replace(whole, train_start=begins[0], repeat_start=begins[1])
    middle = [values[begin:][: run.stop - run.start] for values, begin in zip((a, b), begins, strict=True)]
    inner = _aligned(cut, middle[0], middle[1], 2 * _COARSE)
    return _apart(inner, a, b, spread), inner


def _near(a: FloatArray, b: FloatArray, spread: FloatArray) -> BoolArray:
    """Return where (N,) all joints of two motions are at about the same place."""
    return np.asarray(np.all(np.abs(a - b) < _NEAR * spread, axis=1))


def _lag_of_most(a: FloatArray, b: FloatArray, spread: FloatArray, most: int) -> int:
    """Find the lag in samples at which two are near each other for longest, whatever else; to a few samples."""
    a, b = a[::_COARSE], b[::_COARSE]
    least = 0.5 * min(len(a), len(b))  # what a pair has to have together
    counts = {0: 0}
    for lag in range(-(most // _COARSE), most // _COARSE + 1):
        length = min(len(a) - max(0, -lag), len(b) - max(0, lag))
        if length >= least:
            counts[lag] = int(np.sum(_near(a[max(0, -lag) :][:length], b[max(0, lag) :][:length], spread)))
    return _COARSE * max(counts, key=lambda lag: counts[lag])


def _aligned(pair: Pairing, a: FloatArray, b: FloatArray, most: int) -> Pairing:
    """Shift the pair's beginning by the lag between ``a`` and ``b`` (N, n), in samples."""
    lag = lag_between(a, b, most)
    late_a, late_b = max(0, -lag), max(0, lag)
    length = min(len(a) - late_a, len(b) - late_b)
    return replace(pair, train_start=pair.train_start + late_a, repeat_start=pair.repeat_start + late_b, length=length)


def _apart(pair: Pairing, a: FloatArray, b: FloatArray, spread: FloatArray) -> float:
    """Compute the standard deviation of a pair's difference, the worst joint, over ``spread`` (n,)."""
    left, right = pair.rows
    difference = a[left] - b[right]
    return float(np.max(difference.std(axis=0) / spread))


def difference_noise(
    design: Design, theta: FloatArray, pairs: Sequence[Pairing], joint: int, extra: Extra | None = None
) -> list[FloatArray]:
    """Compute a joint's full-rate noise, (N,) per pair: difference of the two residuals over root two."""
    result = []
    for pair in pairs:
        first = full_residual(design, theta, joint, pair.train, extra)
        second = full_residual(design, theta, joint, pair.repeat, extra)
        left, right = pair.rows
        result.append((first[left] - second[right]) / np.sqrt(2.0))
    return result


def _difference_stretches(design: Design, theta: FloatArray, pairs: Sequence[Pairing], joint: int) -> list[FloatArray]:
    """Cut what both runs spend at rest for long out of :func:`difference_noise`."""
    stretches = []
    for pair, series in zip(pairs, difference_noise(design, theta, pairs, joint), strict=True):
        left, right = pair.rows
        first, second = design.segments[pair.train].rest[left, joint], design.segments[pair.repeat].rest[right, joint]
        stretches += moving_stretches(series, first | second, design.bank)
    return stretches


def effort_floor(design: Design, theta: FloatArray, pairs: Sequence[Pairing]) -> FloatArray:
    """Compute each joint's noise floor in its effort unit, (n,): std of (train less repeat) residual over root two."""
    floors = []
    for joint in range(len(design.machine.joints)):
        values = []
        for pair in pairs:
            a, b = design.segments[pair.train], design.segments[pair.repeat]
            left, right = pair.rows
            first = (a.r[:, joint] * full_residual(design, theta, joint, pair.train))[left]
            second = (b.r[:, joint] * full_residual(design, theta, joint, pair.repeat))[right]
            kept = moving_rows(design.bank, a.rest[left, joint] | b.rest[right, joint])
            reduced = design.bank.reduce(first - second)
            values.append(reduced[kept] if kept.any() else reduced)
        floors.append(float(np.std(np.concatenate(values)) / np.sqrt(2.0)))
    return np.array(floors)


def noise_model(
    design: Design,
    fitted: Sequence[int],
    pairs: Sequence[Pairing],
    start: NoiseModel | None = None,
    anew: Collection[int] | None = None,
) -> NoiseModel:
    """Estimate each joint's whitening, alternating between fit and noise (feasible generalised least squares).

    ``start`` is a noise that is known already, of which only that of the joints ``anew`` has changed.
    """
    joints = len(design.machine.joints)
    model = white_noise_model(joints) if start is None else start
    loaded, unloaded = ([i for i in fitted if design.segments[i].loaded == there] for there in (True, False))
    if design.stored:
        pairs, loaded, unloaded = spread(pairs), spread(loaded), spread(unloaded)
    for _ in range(_PASSES):
        theta = fit_rows(design, model, fitted)[0].theta
        found, free = [], []
        for joint in range(joints):
            if anew is not None and joint not in anew:
                found.append(model.of(joint, True))
                free.append(model.of(joint, False))
                continue
            if pairs:
                series = _difference_stretches(design, theta, pairs, joint)
            else:
                series = _flexible_residual(design, theta, loaded or unloaded, joint)
            # A joint that stood still all the time has no rows to weigh.
            found.append(whitening(series, design.bank) if series else unit_whitening())
            series = _flexible_residual(design, theta, unloaded, joint) if loaded and unloaded else []
            free.append(whitening(series, design.bank) if series else found[-1])
        model = NoiseModel(tuple(found), bool(pairs), tuple(free) if loaded and unloaded else ())
    return model


def spread(items: Sequence[_T]) -> list[_T]:
    """Choose at most :data:`_MOST_SEGMENTS` of them, evenly spread; all if no more."""
    if len(items) <= _MOST_SEGMENTS:
        return list(items)
    return [items[round(k)] for k in np.linspace(0, len(items) - 1, _MOST_SEGMENTS)]


def _flexible_residual(design: Design, theta: FloatArray, fitted: Sequence[int], joint: int) -> list[FloatArray]:
    """Compute a joint's full-rate residual after splines in its own position and speed, with and without its sign.

    Splines are fitted to filtered rows that move, and taken off rows at the full rate: directions that the former
    hardly show would be made up on the latter. So a spline is expected to be no larger than the residual itself (one
    row's worth of a ridge on columns of unit size), and long rests are cut out.
    """
    segments = [design.segments[i] for i in fitted]
    rows = []
    for variable in ("x", "v"):
        values = np.concatenate([getattr(s, variable)[:, joint] for s in segments])
        basis = spline_basis(values, 8)
        sign = np.sign(np.concatenate([s.v[:, joint] for s in segments]))
        rows.append(np.hstack([basis, basis * sign[:, None]]))
    columns = np.hstack(rows)
    ends = np.cumsum([len(s) for s in segments])
    parts = np.split(columns, ends[:-1])
    residuals = [full_residual(design, theta, joint, index) for index in fitted]
    keeps = [design.blocks[joint][index].keep for index in fitted]
    A = np.vstack([design.bank.reduce(part)[keep] for part, keep in zip(parts, keeps, strict=True)])
    b = np.concatenate([design.bank.reduce(r)[keep] for r, keep in zip(residuals, keeps, strict=True)])
    if not len(b):
        return []
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-12)
    ridge = np.vstack([A / scale, np.eye(A.shape[1])])
    coefficients = np.linalg.lstsq(ridge, np.concatenate([b, np.zeros(A.shape[1])]), rcond=None)[0] / scale
    freedom = float(np.sqrt(len(b) / max(len(b) - A.shape[1], 1)))
    return [
        stretch
        for residual, part, keep, segment in zip(residuals, parts, keeps, segments, strict=True)
        if keep.any()
        for stretch in moving_stretches(freedom * (residual - part @ coefficients), segment.rest[:, joint], design.bank)
    ]


def moving_stretches(series: FloatArray, rest: BoolArray, bank: FilterBank) -> list[FloatArray]:
    """Find stretches of a series (N,) or (N, k) between long rests that fill the identification filter's window.

    A drive at rest holds any effort up to its static friction; that is neither noise nor model.
    """
    dwells = [run for run in runs(rest) if run.stop - run.start > 2 * bank.half]
    edges = [0, *(edge for run in dwells for edge in (run.start, run.stop)), len(series)]
    stretches = [series[start:stop] for start, stop in zip(edges[::2], edges[1::2], strict=True)]
    return [stretch for stretch in stretches if bank.rows(len(stretch))]
