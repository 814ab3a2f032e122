"""Models that are linear about their optimum, beside one another.

Of such a model, with residual ``r``, columns ``J`` and information ``G`` of what is left, a part that is left out has

    log p = -1/2 (r'r + r'J G^-1 J'r) / s^2 - 1/2 log det(I + J G^-1 J')

so what only the part itself could have shown is not held against a model, and pays for being open instead. ``s^2`` is
not known: with that of each model, the parts' density falls by half the logarithm of the sum of squares for each
independent row, of which there are as many as what the larger model leaves has.

Source: S. Geisser and W. Eddy, J. Am. Stat. Assoc. 74, 1979 (predictive density of what is left out).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.arrays import BoolArray, FloatArray
from fitting.residual.confirmation.confirmation import Density, OnValidate
from fitting.residual.confirmation.cross_validation import HeldOut


@dataclass(frozen=True)
class Local:
    """A model about its optimum.

    Attributes
    ----------
    columns : (M, p), 0 in rows that are not fitted
    residual : (M,), 0 in rows that are not fitted
    precision : (p, p) of the parameters before any data, times the noise
    noise : variance of an independent row
    rows : how many independent rows there are
    """

    columns: FloatArray
    residual: FloatArray
    precision: FloatArray
    noise: float
    rows: float

    @property
    def known(self) -> FloatArray:
        """Information of rows and prior on the parameters together, (p, p), times the noise."""
        return self.columns.T @ self.columns + self.precision

    @property
    def covariance(self) -> FloatArray:
        """Of the parameters, (p, p)."""
        return np.asarray(self.noise * np.linalg.inv(self.known))

    def left_out(self, folds: Sequence[BoolArray]) -> tuple[FloatArray, FloatArray]:
        """Compute sum of squares and log determinant (folds,) of the module's text of each part (M,) left out."""
        known, squares, open_ones = self.known, [], []
        for fold in folds:
            own, r = self.columns[fold], self.residual[fold]
            rest, products = known - own.T @ own, own.T @ r
            squares.append(float(r @ r + products @ np.linalg.solve(rest, products)))
            open_ones.append(np.linalg.slogdet(known)[1] - np.linalg.slogdet(rest)[1])
        return np.array(squares), np.array(open_ones)


def beside(
    before: Local, after: Local, folds: Sequence[BoolArray], blocks: Sequence[BoolArray]
) -> tuple[HeldOut, float, float]:
    """Compare a model with a simpler one on held-out parts, with its sum of squares and the simpler one's.

    The gain is that of ``folds``; whether it hangs on a single part is asked of ``blocks``: a single one shows nothing.
    """
    gain, _, after_squares, before_squares = _gain(before, after, folds)
    other, parts, *_ = _gain(before, after, blocks)
    if len(parts) < 2:
        return HeldOut(0.0, 0.0, len(parts), 0.0), after_squares, before_squares
    spread = float(np.std(parts, ddof=1) * np.sqrt(len(parts)))
    alike = other - float(parts.max())
    return HeldOut(gain, gain / max(spread, 1e-12), len(parts), alike), after_squares, before_squares


def _gain(before: Local, after: Local, folds: Sequence[BoolArray]) -> tuple[float, FloatArray, float, float]:
    (was, one), (now, other) = before.left_out(folds), after.left_out(folds)
    total, first = max(float(now.sum()), 1e-30), float(was.sum())
    log = float(np.log(first / total))
    parts = after.rows * abs(log) * (was - now) / max(abs(first - total), 1e-30) + one - other
    return float(parts.sum()), parts, total, first


def elsewhere(before: tuple[Local, Local], after: tuple[Local, Local]) -> OnValidate:
    """Compare a model with a simpler one on another motion: of both the model, and the same on that motion."""
    (_, here), (new, there) = before, after
    shown, squares = here.residual - there.residual, [float(own.residual @ own.residual) for own in (here, there)]
    scale = max(min(squares), 1e-30) / here.rows
    logs = []
    for model, moved in (before, after):
        density = Density(np.zeros(moved.columns.shape[1])).with_rows(moved.columns, moved.residual, scale)
        logs.append(density.log(model.covariance, np.arange(moved.columns.shape[1])))
    seen, expected = there.columns.T @ shown, float(shown @ shown) / scale
    spread = 2.0 * float(np.sqrt(expected + float(seen @ new.covariance @ seen) / scale**2))
    gain = (squares[0] - squares[1]) / scale
    return OnValidate(gain, expected, spread, 2.0 * (logs[1] - logs[0]), bool(shown.any()))
