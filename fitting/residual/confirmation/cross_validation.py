"""Block cross-validation of a term on the training recordings.

Whitened rows are cut into blocks of six seconds, or of fifty rows where the band is wider than 3 Hz (some ten
correlation times of what the filter and a first-order disturbance leave), dealt out over ten folds. Base, accepted
terms and candidate are refitted without a fold, and without a guard of a second (eight rows) on either side of it;
the chi-square that the candidate takes off the held-out rows is its gain there. Only block Gram matrices are needed,
so a fold costs one small solve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.regression.solving import WhiteRows

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

BLOCK_SECONDS = 6.0
GUARD_SECONDS = 1.0
#: The same in rows, where that is shorter: fast motions are recorded shortly, and in a wide band.
BLOCK_ROWS, GUARD_ROWS = 50, 8
FOLDS = 10


@dataclass(frozen=True)
class HeldOut:
    """Gain of a term on held-out blocks.

    Attributes
    ----------
    gain : chi-square taken off the held-out rows, summed over all folds
    z : the same over its standard error, from the spread between blocks
    blocks : number of blocks
    own_noise : noise of the rows that show it, as variance over what the noise model says
        (:mod:`fitting.residual.confirmation.robustness`)
    own_gain : chi-square of the whole term against that noise
    """

    gain: float
    z: float
    blocks: int
    own_noise: float = 1.0
    own_gain: float = np.inf


def held_out_gain(
    rows: Sequence[WhiteRows], candidate: int, rate_hz: float, precision: FloatArray | None = None
) -> HeldOut:
    """Gain of the last ``candidate`` columns on held-out blocks.

    Parameters
    ----------
    rows : whitened rows of every joint, candidate columns last (a prior's row at the end of a joint is always fitted)
    candidate : number of its columns
    rate_hz : rate of the rows
    precision : (candidate, candidate) of what is expected of its parameters before any data, around zero: a curve's
        ends may be shown by one block only, and without that block nothing else would say how large they are
    """
    length = max(1, min(BLOCK_ROWS, round(BLOCK_SECONDS * rate_hz)))
    guard = max(1, min(GUARD_ROWS, round(GUARD_SECONDS * rate_hz)))
    A, b = unit_columns(rows)
    known = None
    if precision is not None:
        sizes = np.linalg.norm(np.vstack([r.A[:, -candidate:] for r in rows]), axis=0)
        sizes = np.where(sizes > 0.0, sizes, 1.0)  # a column that no row shows stays zero
        known = precision / np.outer(sizes, sizes)
    block, position = _blocks(rows, length)
    fold = np.where(block >= 0, block % FOLDS, -1)
    changes: dict[int, float] = {}
    inside = np.mod(position, length)
    for number in range(FOLDS):
        test = fold == number
        if not test.any():
            continue
        # Rows near a held-out block share its noise: the end of the block before and the start of the one after.
        before, after = np.isin(block + 1, block[test]), np.isin(block - 1, block[test])
        near = (before & (inside >= length - guard)) | (after & (inside < guard))
        train = ~test & ~(near & (block >= 0))
        gram, products = A[train].T @ A[train], A[train].T @ b[train]
        errors = []
        for columns in (A.shape[1] - candidate, A.shape[1]):
            if known is not None and columns == A.shape[1]:
                gram[-candidate:, -candidate:] += known
            theta = solve_gram(gram[:columns, :columns], products[:columns])
            errors.append((b[test] - A[test, :columns] @ theta) ** 2)
        for own in np.unique(block[test]):
            here = block[test] == own
            changes[int(own)] = float(np.sum(errors[0][here]) - np.sum(errors[1][here]))
    values = np.array(list(changes.values()))
    if len(values) < 2:
        return HeldOut(0.0, 0.0, len(values))
    error = float(np.std(values, ddof=1) * np.sqrt(len(values)))
    return HeldOut(float(values.sum()), float(values.sum() / max(error, 1e-12)), len(values))


def _blocks(rows: Sequence[WhiteRows], length: int) -> tuple[IntArray, IntArray]:
    """Block number and position in its segment of every row; -1 for rows that are always fitted.

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


def unit_columns(rows: Sequence[WhiteRows]) -> tuple[FloatArray, FloatArray]:
    """Columns (R, p), scaled to unit norm, and target (R,) of the rows of all joints."""
    A = np.vstack([r.A for r in rows])
    return A / np.maximum(np.linalg.norm(A, axis=0), 1e-300), np.concatenate([r.b for r in rows])


def solve_gram(gram: FloatArray, products: FloatArray) -> FloatArray:
    """Least squares from a Gram matrix of unit columns, (p,) or (p, k); directions below 1e-10 are left out."""
    values, vectors = np.linalg.eigh(gram)
    live = values > 1e-10 * values[-1]
    return np.asarray((vectors[:, live] / values[live]) @ (vectors[:, live].T @ products))
