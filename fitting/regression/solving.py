"""Least squares of whitened rows: the rank is decided, and what the rows do not determine is left out.

Source: G. Golub and C. Van Loan, *Matrix Computations*, 2013, section 5.4 (QR with column pivoting).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg

from fitting.arrays import BoolArray, FloatArray, IntArray, unit_gram


@dataclass(frozen=True)
class WhiteRows:
    """Whitened rows of one joint over the fitted segments.

    Attributes
    ----------
    A : (R, p) base columns, then the extra ones
    b : (R,) target
    sections : per fitted segment (index in the design, rows kept by position in the whitened series)
    """

    A: FloatArray
    b: FloatArray
    sections: tuple[tuple[int, BoolArray], ...]


@dataclass(frozen=True)
class Fit:
    """Generalised least-squares fit of a design.

    Attributes
    ----------
    theta : (p,) parameters: drive, base, extra
    covariance : (p, p), from the whitened rows (unit noise)
    determined : (p,) False for parameters that these rows do not determine (their value is 0)
    orthonormal : per joint (R_j, rank) rows of an orthonormal basis of the column space
    residual : per joint (R_j,) whitened residual
    condition_number : of the column-scaled whitened matrix
    share : (p,) of each parameter's information that came from the rows and not from a prior; None: all of it
    hidden : (p,) part of the variances that laws make up for: parameters may be off by it, efforts not; None: nothing
    """

    theta: FloatArray
    covariance: FloatArray
    determined: BoolArray
    orthonormal: Sequence[FloatArray]
    residual: tuple[FloatArray, ...]
    condition_number: float
    share: FloatArray | None = field(default=None, repr=False)
    hidden: FloatArray | None = field(default=None, repr=False)

    @property
    def std(self) -> FloatArray:
        """Standard deviations of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def whitened(self) -> bool:
        """True where its rows were weighed by a noise that they are explained down to."""
        return any(own.shape[1] for own in self.orthonormal)

    @property
    def chi_square(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(sum(r @ r for r in self.residual))


@dataclass(frozen=True)
class Factor:
    """Pivoted QR of a least-squares problem, rank decided.

    Attributes
    ----------
    Q, R : (N, rank), (rank, rank) of the determined columns, at unit norm, in the order of ``determined``
    determined : (rank,) numbers of these columns
    root : (p, rank) with ``(A'A)^-1 = root root'`` on them, zero rows for the others
    """

    Q: FloatArray
    R: FloatArray
    determined: IntArray
    root: FloatArray

    @property
    def condition_number(self) -> float:
        """Condition of the determined columns, each at unit norm."""
        if not len(self.R):
            return 1.0
        singular = linalg.svdvals(self.R / np.linalg.norm(self.R, axis=0))
        return float(singular[0] / singular[-1])


def factor(A: FloatArray, extra: int = 0) -> Factor:
    """Factor ``A`` (N, p) by pivoted QR; undetermined columns are left out, not guessed.

    The rank is decided on unit columns at 1e-9 of the largest pivot; the last ``extra`` columns come last.
    """
    p = A.shape[1]
    scale = np.linalg.norm(A, axis=0)
    used = np.flatnonzero(scale > 0)
    # Effects come last: where a law could stand in for a base column, the base keeps its meaning.
    scale = np.where(np.arange(p) < p - extra, scale, 1e3 * scale)
    Q, R, order = linalg.qr(A[:, used] / scale[used], mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    rank = int(np.count_nonzero(pivots > 1e-9 * pivots[0])) if len(pivots) else 0
    Q, R, determined = Q[:, :rank], R[:rank, :rank], used[order[:rank]]
    root = np.zeros((p, rank))
    root[determined] = linalg.solve_triangular(R, np.eye(rank)) / scale[determined][:, None]
    return Factor(Q, R, determined, root)


def inverse_root(gram: FloatArray, rank: float = 1e-10) -> FloatArray:
    """Compute ``U`` (p, live), ``U U' = gram^+`` of columns' products, so that ``A U`` is orthonormal.

    Directions below ``rank`` of the largest, for columns of unit size, are undetermined.
    """
    unit, size = unit_gram(gram)
    values, vectors = np.linalg.eigh(unit)
    live = values > rank * values.max(initial=0.0)
    return np.asarray(vectors[:, live] / np.sqrt(values[live]) / size[:, None])


def solve(rows: Sequence[WhiteRows], extra_names: tuple[str, ...] = ()) -> Fit:
    """Solve least squares on whitened rows (:func:`factor`)."""
    A = np.vstack([r.A for r in rows])
    b = np.concatenate([r.b for r in rows])
    found = factor(A, len(extra_names))
    projected = found.Q.T @ b
    determined = np.zeros(A.shape[1], dtype=bool)
    determined[found.determined] = True
    residual = b - found.Q @ projected
    ends = np.cumsum([len(r.b) for r in rows])
    return Fit(
        theta=found.root @ projected,
        covariance=found.root @ found.root.T,
        determined=determined,
        orthonormal=tuple(np.split(found.Q, ends[:-1])),
        residual=tuple(np.split(residual, ends[:-1])),
        condition_number=found.condition_number,
    )
