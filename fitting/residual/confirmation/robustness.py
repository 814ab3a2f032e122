"""Inflation: by how much the rows that show a term are noisier than in the noise model.

The noise is measured where a motion was made twice, over all of it alike, and within some per cent. Where it depends on
the motion (a sign that is unsure near reversals, knocks), or is correlated for longer than was measured, chance reaches
further for a term that acts just there. On a machine whose model is not exact, what the final model leaves is neither
white nor small. So the gain of a term is worth less by ``phi``, which is seen as

    max(1, w, w c),   w = sum_t u_t^2 e_t^2 / sum_t u_t^2,   c = sum_f S(f) |U(f)|^2 / sum_f |U(f)|^2,

``u`` what the fitted term contributes less what the base takes of it, ``U`` its spectrum, ``e`` what the model with it
leaves and ``S`` its spectrum over its mean square, an autoregression (Burg's): how large it is where the term acts, and
how slow. Right noise gives one, but a term that acts in few rows is seen at anything: the logarithm has the variance
``2 / n + 2 k / N``, ``n = (sum u^2)^2 / sum u^4`` the rows that show the term, ``k`` the order of the autoregression
and ``N`` its rows. As probable as not the noise is right, or off by any factor up to :data:`~_MOST`; a gain keeps the
mean of ``1 / phi`` under what that leaves. It is the same in the gate and in the probabilities.

Sources: White, Econometrica 48 (1980) 817 (rows of unequal noise); Priestley, *Spectral Analysis and Time Series*,
1981, 7.8 (the variance of autoregressive spectra); and those of :mod:`fitting.estimators.covariance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.estimators.covariance import autoregression
from fitting.residual.terms import Model

#: Share of what is left, in squares, up to which a contribution is rounding.
_ROUNDING = 1e-16
#: Rows of a joint below which no autoregression is fitted.
_SHORT = 40
#: Largest factor by which noise may be off.
_MOST = 100.0


class Leftover:
    """Residual of a model, by which gains are divided.

    Parameters
    ----------
    residual : by joint (R_j,), whitened
    sections : of each joint the rows of each fitted segment, in time order; rows of a prior are in none
    """

    def __init__(self, residual: Mapping[int, FloatArray], sections: Mapping[int, Sequence[slice]]) -> None:
        self._squares = {joint: r**2 for joint, r in residual.items()}
        self._taps = {j: autoregression(r) if len(r) >= _SHORT and r.any() else np.ones(1) for j, r in residual.items()}
        self._parts = {
            joint: [(part, _spectrum(r, self._taps[joint], part)) for part in sections[joint] if part.stop > part.start]
            for joint, r in residual.items()
        }

    @classmethod
    def of(cls, model: Model, shown: Mapping[int, FloatArray] | None = None) -> Leftover:
        """Return the leftover of a fitted model, or of it with a term of these (R_j,) by joint, on these joints."""
        residual = dict(enumerate(model.fit.residual))
        if shown is not None:
            residual = {joint: residual[joint] - own for joint, own in shown.items()}
        return cls(residual, {joint: [part for _, part in model.sections(joint)] for joint in residual})

    def inflation(self, shown: Mapping[int, FloatArray]) -> float:
        """Compute ``phi`` of contributions (R_j,) by joint."""
        power, coloured, uneven, fourth, unsure = 0.0, 0.0, 0.0, 0.0, 0.0
        for joint, own in shown.items():
            squares, sums = self._squares[joint], np.zeros(4)
            for part, density in self._parts[joint]:
                u = own[part]
                transform = np.abs(np.fft.fft(u, 2 * len(u))) ** 2 / (2 * len(u))
                sums += [float(u @ u), float(transform @ density), float(u**2 @ squares[part]), float(np.sum(u**4))]
            if sums[0] > 0:
                power, uneven, fourth = power + sums[0], uneven + sums[2], fourth + sums[3]
                coloured += sums[2] * sums[1] / sums[0]
                unsure += sums[0] * 2.0 * (len(self._taps[joint]) - 1) / len(squares)
        left = sum(float(np.sum(self._squares[joint])) for joint in shown)
        if not power > _ROUNDING * left or max(coloured, uneven) <= power:
            return 1.0
        seen = max(coloured, uneven) / power
        variance = 2.0 * fourth / power**2 + (unsure / power if coloured > uneven else 0.0)
        right = np.exp(-0.5 * np.log(seen) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
        right /= right + 1.0 / np.log(_MOST)
        return float(1.0 / (right + (1.0 - right) / seen))


def _spectrum(residual: FloatArray, taps: FloatArray, part: slice) -> FloatArray:
    """Compute a joint's residual power density over its mean square, padded to twice the length of the stretch."""
    size, points = float(np.mean(residual**2)), 2 * (part.stop - part.start)
    if len(taps) == 1 or points < len(taps):  # white, or too short a stretch to separate frequencies
        return np.ones(points)
    innovations = float(np.mean(np.convolve(residual, taps, mode="valid") ** 2))
    return np.asarray(innovations / size / np.abs(np.fft.fft(taps, points)) ** 2)
