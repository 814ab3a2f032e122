"""Held-out gain of a term: the logarithm of the predictive density of blocks that were left out of the fit.

Whitened rows are cut into blocks of six seconds, or of fifty rows where the band is wider than 3 Hz (some ten
correlation times of what the filter and a first-order disturbance leave), dealt out over ten folds. Base, accepted
terms and candidate are refitted without a fold, and without a guard of a second (eight rows) on either side of it. The
rows that were left out then have the density

    b ~ N(A theta, I + A C A'),    C = (A_t'A_t)^-1 of the rows A_t that were fitted,

parameters' uncertainty included: a fold of which the others hold little neither confirms nor ruins anything. A term's
gain is twice the logarithm of the densities' ratio with and without it, also without the fold that shows it most: what
is in one block only is confirmed by no other. Only block Gram matrices are needed, so a fold costs two small solves.

Source: S. Geisser and W. Eddy, "A predictive approach to model selection", J. Amer. Stat. Assoc. 74, 1979.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.arrays import FloatArray, IntArray
from fitting.regression.solving import WhiteRows

BLOCK_SECONDS = 6.0
GUARD_SECONDS = 1.0
#: The same in rows, where that is shorter: fast motions are recorded shortly, and in a wide band.
BLOCK_ROWS, GUARD_ROWS = 50, 8
FOLDS = 10
#: Gain from which on a term is confirmed: odds of 19 to 1.
CONFIRMED = 2.0 * float(np.log(19.0))
#: Prior precision of unit columns that is none.
_FLAT = 1e-10


@dataclass(frozen=True)
class HeldOut:
    """Held-out gain of a term, on blocks that were left out of the fit.

    Attributes
    ----------
    gain : twice the logarithm of their density with the term over that without it, summed over all folds
    z : the same over its standard error, from the spread between folds
    blocks : number of folds
    alike : the same as ``gain`` without the fold that gains most
    inflation : noise of the rows that show it, as variance over the noise model's
        (:mod:`fitting.residual.confirmation.robustness`)
    """

    gain: float
    z: float
    blocks: int
    alike: float = np.inf
    inflation: float = 1.0

    @property
    def confirmed(self) -> float:
        """The smaller of the two gains against the noise of the rows that show it."""
        return min(self.gain, self.alike) / self.inflation


def held_out_gain(
    before: Sequence[WhiteRows], after: Sequence[WhiteRows], rate_hz: float, expected: bool = False
) -> HeldOut:
    """Compute the held-out gain of the last columns of a model beside the model without them.

    Which of the base's parameters are at zero belongs to each of the two, so that each has columns of its own.

    Parameters
    ----------
    before, after : whitened rows of every joint without and with the candidate, whose ``k`` columns are the last ones
        (a prior's rows, at the end of a joint or in a block of their own, are always fitted)
    rate_hz : rate of the rows
    expected : True where ``after`` has rows of what is expected of its parameters (a curve is smooth); else
        these are in any direction of what is seen of them, as large as all rows have it
    """
    candidate = after[0].A.shape[1] - before[0].A.shape[1]
    precision = np.zeros((after[0].A.shape[1],) * 2)
    if not expected:
        precision[-candidate:, -candidate:] = _as_seen(*_unit_columns(after), candidate)
    folds = zip(_densities(before, rate_hz), _densities(after, rate_hz, precision), strict=True)
    values = np.array([2.0 * (with_it - without) for without, with_it in folds])
    if len(values) < 2:
        return HeldOut(0.0, 0.0, len(values), 0.0)
    error = float(np.std(values, ddof=1) * np.sqrt(len(values)))
    gain = float(values.sum())
    return HeldOut(gain, gain / max(error, 1e-12), len(values), gain - float(values.max()))


def _densities(rows: Sequence[WhiteRows], rate_hz: float, expected: FloatArray | float = 0.0) -> Iterator[float]:
    """Log density of each fold, fitted without it; ``expected`` (p, p) is a prior precision of unit columns."""
    length = max(1, min(BLOCK_ROWS, round(BLOCK_SECONDS * rate_hz)))
    guard = max(1, min(GUARD_ROWS, round(GUARD_SECONDS * rate_hz)))
    A, b = _unit_columns(rows)
    block, position = _blocks(rows, length)
    fold = np.where(block >= 0, block % FOLDS, -1)
    inside = np.mod(position, length)
    for number in range(FOLDS):
        test = fold == number
        if not test.any():
            continue
        # Rows near a held-out block share its noise: the end of the block before and the start of the one after.
        before, after = np.isin(block + 1, block[test]), np.isin(block - 1, block[test])
        near = (before & (inside >= length - guard)) | (after & (inside < guard))
        train = ~test & ~(near & (block >= 0))
        gram = A[train].T @ A[train] + _FLAT * np.eye(A.shape[1]) + expected
        yield _log_density(gram, A[train].T @ b[train], A[test], b[test])


def _as_seen(A: FloatArray, b: FloatArray, candidate: int) -> FloatArray:
    """Compute Zellner's prior precision of the last columns: amplitudes as their fit to all rows has them."""
    base = A[:, :-candidate]
    left = A[:, -candidate:] - base @ _solve_gram(base.T @ base, base.T @ A[:, -candidate:])
    information = left.T @ left
    values = _solve_gram(information, left.T @ b)
    gain = float(values @ information @ values)
    return np.asarray(information * candidate / max(gain, float(candidate)) + _FLAT * np.eye(candidate))


def _log_density(gram: FloatArray, products: FloatArray, A: FloatArray, b: FloatArray) -> float:
    """Compute log density of ``b ~ N(A theta, I + A gram^-1 A')`` but for a constant; ``gram theta = products``."""
    own = A.T @ A
    left = b - A @ np.linalg.solve(gram, products)
    shadow = A.T @ left
    quadratic = float(left @ left - shadow @ np.linalg.solve(gram + own, shadow))
    return -0.5 * (quadratic + float(np.linalg.slogdet(gram + own)[1] - np.linalg.slogdet(gram)[1]))


def _blocks(rows: Sequence[WhiteRows], length: int) -> tuple[IntArray, IntArray]:
    """Assign each row its block's number and its position in its segment; -1 for rows always fitted.

    Blocks are numbered alike for all joints, so a stretch of time is held out as a whole.
    """
    starts: dict[int, int] = {}
    total = 0
    for index, kept in rows[0].sections:
        starts[index] = total
        total += len(kept) // length + 2  # one number is left free, so blocks of two segments are no neighbours
    blocks, positions = [], []
    for own in rows:
        own_blocks, own_positions = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
        for index, kept in own.sections:
            place = np.flatnonzero(kept)
            own_blocks.append(starts[index] + place // length)
            own_positions.append(place)
        extra = len(own.b) - sum(len(p) for p in own_positions)
        blocks.append(np.concatenate([*own_blocks, np.full(extra, -1, dtype=np.intp)]))
        positions.append(np.concatenate([*own_positions, np.zeros(extra, dtype=np.intp)]))
    return np.concatenate(blocks), np.concatenate(positions)


def _unit_columns(rows: Sequence[WhiteRows]) -> tuple[FloatArray, FloatArray]:
    """Scale columns (R, p) to unit norm; with the target (R,) of the rows of all joints."""
    A = np.vstack([r.A for r in rows])
    return A / np.maximum(np.linalg.norm(A, axis=0), 1e-300), np.concatenate([r.b for r in rows])


def _solve_gram(gram: FloatArray, products: FloatArray) -> FloatArray:
    """Solve least squares by a Gram matrix of unit columns, (p,) or (p, k), without directions below 1e-10."""
    values, vectors = np.linalg.eigh(gram)
    live = values > 1e-10 * values[-1]
    return np.asarray((vectors[:, live] / values[live]) @ (vectors[:, live].T @ products))
