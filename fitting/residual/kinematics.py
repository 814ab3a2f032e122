"""Kinematics first: a joint encoder against a piston encoder tells sensor and linkage errors without any dynamics.

The gap between the measured piston position and ``x(q)`` of the measured joint position is zero for a perfect machine.
Effects that bend positions are scored on it like effects on efforts are scored on residuals: whitened by the gap's own
noise, chi-square against the price of parameters. What is accepted is *rebuilt* into the positions or the linkage, and
the gap is looked at again, so that large errors are not left to a linear correction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import linalg

from daq.machine.machine_file import Machine
from fitting.effects.base import DriveView, Effect, Shape, has_both_positions
from fitting.regression.design import Design
from fitting.regression.noise import Pairing, moving_stretches
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
    """Gap of one joint where it moves: the whitening of its noise, and the whitened series of each segment.

    A sensor that stands says one thing, however often it is read: such rows are no witness.
    """

    design: Design
    joint: int
    whitening: Whitening
    indices: tuple[int, ...]

    @cached_property
    def values(self) -> tuple[FloatArray, ...]:
        """The whitened gap of each segment."""
        return self.whitened([self.design.segments[i].gap[:, self.joint] for i in self.indices])

    def whitened(self, series: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
        """What stands beside each segment's gap, (N,) or (N, k) at full rate, as the gap is whitened."""
        keeps = [self.whitening.kept(self.design.blocks[self.joint][i].keep) for i in self.indices]
        return tuple(
            self.whitening(self.design.bank.reduce(own))[keep] for own, keep in zip(series, keeps, strict=True)
        )

    @property
    def chi_square(self) -> float:
        """Sum of squares of the whitened gap."""
        return float(sum(v @ v for v in self.values))


def gap_rows(design: Design, fitted: Sequence[int], pairs: Sequence[Pairing], joint: int) -> GapRows:
    """Whitened gap of a joint over the loaded segments; its noise is that of (train less repeat)."""
    indices = tuple(i for i in fitted if design.segments[i].loaded)
    series = []
    for pair in pairs:
        a, b = design.segments[pair.train], design.segments[pair.repeat]
        left = slice(pair.train_start, pair.train_start + pair.length)
        right = slice(pair.repeat_start, pair.repeat_start + pair.length)
        difference = (a.gap[left, joint] - b.gap[right, joint]) / np.sqrt(2.0)
        series += moving_stretches(difference, a.rest[left, joint] | b.rest[right, joint], design.bank)
    if not series:
        series = _without_law_of_position(design, indices, joint)
    # Where it hardly moves, nothing tells its noise, and nothing can be told of the gap.
    return GapRows(design, joint, whitening(series, design.bank), indices if series else ())


def _without_law_of_position(design: Design, indices: Sequence[int], joint: int) -> list[FloatArray]:
    """Without a repeat, the gap's noise is what a smooth function of the joint position leaves of it."""
    parts = [
        part
        for i in indices
        for part in moving_stretches(
            np.column_stack([design.segments[i].q[:, joint], design.segments[i].gap[:, joint]]),
            design.segments[i].rest[:, joint],
            design.bank,
        )
    ]
    if not parts:
        return []
    q, gap = np.concatenate(parts).T
    basis = spline_basis(q, 8)
    left = gap - basis @ np.linalg.lstsq(basis, gap, rcond=1e-8)[0]
    return np.split(left, np.cumsum([len(part) for part in parts])[:-1])


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
    if not sum(map(len, rows.values)):
        return [], rows
    result: list[GapScore] = []
    for effect in effects:
        for shape in effect.shapes(own[0]):
            full = [effect.gap_columns(view, shape) for view in own]
            if any(column is None for column in full):
                break
            C = np.vstack(rows.whitened([c for c in full if c is not None]))
            score = _fitted(rows, own, effect, shape, C)
            if score is not None:
                result.append(replace(score, joint=joint))
    return sorted(result, key=lambda s: -s.gain), rows


def _fitted(rows: GapRows, views: Sequence[DriveView], effect: Effect, shape: Shape, C: FloatArray) -> GapScore | None:
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
        parts = rows.whitened([c for c in changes if c is not None])
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
    """Root mean square of the filtered gap where the joint moves, m; without what a score explains of it."""
    values = []
    for index in indices:
        segment = design.segments[index]
        if not segment.loaded:
            continue
        gap = segment.gap[:, joint]
        change = None
        if without is not None and views is not None:
            change = without.effect.gap_change(views[index][joint], without.shape, without.values)
        values.append(design.bank.reduce(gap if change is None else gap - change)[design.blocks[joint][index].keep])
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2))) if sum(map(len, values)) else 0.0


def checkable(machine: Machine) -> tuple[int, ...]:
    """Joints whose kinematics can be checked without dynamics."""
    return tuple(j for j in range(len(machine.joints)) if has_both_positions(machine, j))


def corrected(corrections: Corrections, finding: GapScore) -> Corrections:
    """The corrections with one more finding (or one more step of the same finding) rebuilt into them."""
    joint = corrections.machine.joints[finding.joint].name
    return finding.effect.apply_to_signals(corrections, joint, finding.shape, finding.values)
