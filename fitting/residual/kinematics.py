"""Kinematics first: a joint encoder against a piston encoder tells sensor and linkage errors without any dynamics.

The gap between the measured piston position and ``x(q)`` of the measured joint position is zero for a perfect machine.
Effects that bend positions are scored on it like effects on efforts are scored on residuals: whitened by the gap's own
noise, chi-square against the price of parameters. What is accepted is *rebuilt* into the positions or the linkage, and
the gap is looked at again, so that large errors are not left to a linear correction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import linalg

from daq.machine.machine_file import Machine
from fitting.effects.base import DriveView, Effect, Shape, has_both_positions
from fitting.regression.design import Design
from fitting.regression.noise import Pairing
from fitting.residual.views import Views
from fitting.signals.corrections import Corrections
from fitting.signals.spectrum import Whitening, whitening
from fitting.signals.splines import spline_basis

FloatArray = npt.NDArray[np.float64]

#: Steps of a fit by chords; it ends once one takes less than a hundredth of a chi-square of one.
_CHORDS, _LEAST_GAIN = 12, 1.0
#: Values beyond this are no error of a position sensor, m or rad.
_FARTHEST = 1.0


@dataclass(frozen=True)
class GapScore:
    """One shape of an effect on one joint's gap; fields as in :class:`fitting.residual.scoring.Score`."""

    effect: Effect
    joint: int
    shape: Shape
    gain: float
    live: int
    values: tuple[float, ...]
    stds: tuple[float, ...]
    plausible: bool


@dataclass(frozen=True)
class GapRows:
    """Gap of one joint: the whitening of its noise, and the whitened series of each segment."""

    whitening: Whitening
    indices: tuple[int, ...]
    values: tuple[FloatArray, ...]

    @property
    def chi_square(self) -> float:
        """Sum of squares of the whitened gap."""
        return float(sum(v @ v for v in self.values))


def gap_rows(design: Design, fitted: Sequence[int], pairs: Sequence[Pairing], joint: int) -> GapRows:
    """Whitened gap of a joint over the loaded segments; its noise is that of (train less repeat)."""
    bank = design.bank
    indices = tuple(i for i in fitted if design.segments[i].loaded)
    series = []
    for pair in pairs:
        first = design.segments[pair.train].gap[pair.train_start : pair.train_start + pair.length, joint]
        second = design.segments[pair.repeat].gap[pair.repeat_start : pair.repeat_start + pair.length, joint]
        series.append((first - second) / np.sqrt(2.0))
    if not series:
        series = _without_law_of_position(design, indices, joint)
    white = whitening(series, bank)
    return GapRows(white, indices, tuple(white(bank.reduce(design.segments[i].gap[:, joint])) for i in indices))


def _without_law_of_position(design: Design, indices: Sequence[int], joint: int) -> list[FloatArray]:
    """Without a repeat, the gap's noise is what a smooth function of the joint position leaves of it."""
    basis = spline_basis(np.concatenate([design.segments[i].q[:, joint] for i in indices]), 8)
    gap = np.concatenate([design.segments[i].gap[:, joint] for i in indices])
    left = gap - basis @ np.linalg.lstsq(basis, gap, rcond=1e-8)[0]
    return np.split(left, np.cumsum([len(design.segments[i]) for i in indices])[:-1])


def score_gaps(
    design: Design,
    views: Views,
    fitted: Sequence[int],
    pairs: Sequence[Pairing],
    effects: Sequence[Effect],
    joint: int,
) -> tuple[list[GapScore], GapRows]:
    """What every shape of all effects that bend positions takes of one joint's gap, most first."""
    rows = gap_rows(design, fitted, pairs, joint)
    own = [views[i][joint] for i in rows.indices]
    result: list[GapScore] = []
    for effect in effects:
        for shape in effect.shapes(own[0]):
            full = [effect.gap_columns(view, shape) for view in own]
            if any(column is None for column in full):
                break
            C = np.vstack([rows.whitening(design.bank.reduce(c)) for c in full if c is not None])
            score = _fitted(design, rows, own, effect, shape, C)
            if score is not None:
                result.append(replace(score, joint=joint))
    return sorted(result, key=lambda s: -s.gain), rows


def _fitted(
    design: Design, rows: GapRows, views: Sequence[DriveView], effect: Effect, shape: Shape, C: FloatArray
) -> GapScore | None:
    """Least squares of one shape, its formula taken as it is, not to first order.

    By chords: what the values of the last step leave is solved for with the columns at zero.
    """
    scale = np.maximum(np.linalg.norm(C, axis=0), 1e-300)
    eigenvalues, vectors = linalg.eigh((C / scale).T @ (C / scale))
    live = eigenvalues > 1e-8
    if not live.any():
        return None
    root = vectors[:, live] / eigenvalues[live] @ vectors[:, live].T

    def left(values: FloatArray) -> FloatArray:
        changes = [effect.gap_change(view, shape, values.tolist()) for view in views]
        parts = [rows.whitening(design.bank.reduce(c)) for c in changes if c is not None]
        return np.asarray(np.concatenate(rows.values) - np.concatenate(parts))

    residual, best = np.concatenate(rows.values), np.zeros(C.shape[1])
    before = float(residual @ residual)
    least = before
    for _ in range(_CHORDS):
        values = best + root @ ((C / scale).T @ residual) / scale
        if not np.all(np.abs(values) < _FARTHEST):
            break
        try:
            trial = left(values)
        except ValueError:  # no linkage has such lengths
            break
        now = float(trial @ trial)
        if not now < least:
            break
        done = least - now < 0.01 * _LEAST_GAIN
        residual, best, least = trial, values, now
        if done:
            break
    stds = np.sqrt(np.sum(vectors[:, live] ** 2 / eigenvalues[live], axis=1)) / scale
    stds = np.where(np.linalg.norm(C, axis=0) > 0, stds, 0.0)
    plausible = effect.plausible(best.tolist(), stds.tolist())
    count = int(np.count_nonzero(live))
    return GapScore(effect, 0, shape, before - least, count, tuple(best.tolist()), tuple(stds.tolist()), plausible)


def gap_error(
    design: Design, indices: Sequence[int], joint: int, views: Views | None = None, without: GapScore | None = None
) -> float:
    """Root mean square of the filtered gap, m; without what a score explains of it."""
    values = []
    for index in indices:
        segment = design.segments[index]
        if not segment.loaded:
            continue
        gap = segment.gap[:, joint]
        change = None
        if without is not None and views is not None:
            change = without.effect.gap_change(views[index][joint], without.shape, without.values)
        values.append(design.bank.reduce(gap if change is None else gap - change))
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2))) if values else 0.0


def checkable(machine: Machine) -> tuple[int, ...]:
    """Joints whose kinematics can be checked without dynamics."""
    return tuple(j for j in range(len(machine.joints)) if has_both_positions(machine, j))


def corrected(corrections: Corrections, finding: GapScore) -> Corrections:
    """The corrections with one more finding (or one more step of the same finding) rebuilt into them."""
    joint = corrections.machine.joints[finding.joint].name
    return finding.effect.apply_to_signals(corrections, joint, finding.shape, finding.values)
