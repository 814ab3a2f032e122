"""Least squares over more rows than fit in memory, segment by segment.

Rows ``[A b]`` of a segment are folded into a triangle by orthogonal transformations (``[R; A_k] = Q_k R'``): it keeps
all that least squares needs of any number of rows, and unlike normal equations it does not square the condition number.
A second walk through the segments gives the residuals. Short recordings are solved with all rows at once.

Source: G. Golub and C. Van Loan, *Matrix Computations*, 2013, section 6.5; J. Demmel et al., "Communication-optimal
parallel and sequential QR and LU factorizations", SIAM J. Sci. Comput. 34, 2012 (sequential TSQR).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import chain

import numpy as np

from fitting.arrays import FloatArray, LateSequence
from fitting.regression.design import Design, Extra, NoiseModel, whitened
from fitting.regression.prior import Late, Prior, data_share, with_prior
from fitting.regression.solving import Fit, WhiteRows, solve

#: What is put under the whitened rows of all joints: a prior's.
Closing = Callable[[Sequence[WhiteRows]], Sequence[WhiteRows]]


def triangle(parts: Iterable[FloatArray]) -> FloatArray:
    """Compute ``R`` (at most p, p), ``R'R = A'A``, for rows ``A`` (.., p) that come in parts."""
    R: FloatArray | None = None
    for part in parts:
        R = np.asarray(np.linalg.qr(part if R is None else np.vstack([R, part]), mode="r"))
    if R is None:
        raise ValueError("no rows at all")
    return R


def fit_rows(
    design: Design,
    noise: NoiseModel,
    fitted: Sequence[int],
    extra: Extra | None = None,
    prior: Prior | None = None,
    late: Mapping[int, Late] | None = None,
) -> tuple[Fit, Prior | None]:
    """Fit jointly the whitened rows of some segments (:func:`fitting.regression.solving.solve`), in the memory that
    there is, and the prior at its point.

    Parameters
    ----------
    design, noise, fitted, extra : as in :func:`fitting.regression.design.whitened`
    prior, late : what else is fitted (:func:`fitting.regression.prior.with_prior`); None for nothing
    """
    names = () if extra is None else extra.names
    expected = () if extra is None else extra.expected_rows(len(design.parameters))

    def closing(prior: Prior | None) -> Closing:
        return lambda rows: rows if prior is None else with_prior(rows, design.parameters, prior, late)

    if not design.stored:
        white = whitened(design, noise, fitted, extra)
        if prior is not None and prior.arm is not None:
            rows = (*closing(prior.unsettled())(white), *expected)
            prior = prior.settled(np.vstack([r.A for r in rows]), np.concatenate([r.b for r in rows]))
        return _shared(solve(closing(prior)(white), names, expected), design, prior), prior
    walk = _Walk(design, noise, tuple(fitted), extra, closing(None if prior is None else prior.unsettled()))
    R = walk.folded()
    if prior is not None and prior.arm is not None:
        prior = prior.settled(R[:, :-1], R[:, -1])
        R = triangle([R, np.column_stack(prior.arm_rows(R.shape[1] - 1))])
        walk = _Walk(design, noise, tuple(fitted), extra, closing(prior))
    found = solve([WhiteRows(R[:, :-1], R[:, -1], ())], names)
    return _shared(_long_fit(found, R[:, :-1], walk), design, prior), prior


def _shared(fit: Fit, design: Design, prior: Prior | None) -> Fit:
    """Add to the fit its share from the data."""
    return fit if prior is None else replace(fit, share=data_share(fit.covariance, design.parameters, prior))


def folded(
    design: Design, noise: NoiseModel, fitted: Sequence[int], extra: Extra, closing: Closing = lambda rows: rows
) -> FloatArray:
    """Compute the triangle of all joints' whitened rows ``[A b]`` over some segments (as :func:`fit_rows`)."""
    return _Walk(design, noise, tuple(fitted), extra, closing).folded()


class _Walk:
    """Whitened rows of all joints, segment by segment, the prior's with the last; as often as asked."""

    def __init__(
        self, design: Design, noise: NoiseModel, fitted: tuple[int, ...], extra: Extra | None, closing: Closing
    ) -> None:
        self._design, self._noise, self._fitted = design, noise, fitted
        self._extra, self._closing = extra, closing

    def __iter__(self) -> Iterator[Sequence[WhiteRows]]:
        for index in self._fitted:
            rows: Sequence[WhiteRows] = whitened(self._design, self._noise, (index,), self._extra)
            yield self._closing(rows) if index == self._fitted[-1] else rows

    def folded(self) -> FloatArray:
        """Compute the triangle of all rows ``[A b]``, and of what the extra columns' parameters are expected to be."""
        expected = () if self._extra is None else self._extra.expected_rows(len(self._design.parameters))
        parts = chain(self, [(rows,) for rows in expected])
        return triangle(np.vstack([np.column_stack([r.A, r.b]) for r in rows]) for rows in parts)


def _long_fit(found: Fit, R: FloatArray, walk: _Walk) -> Fit:
    """Return the fit of the rows behind the triangle of ``found``: with their residual, and their basis when it is
    asked for.
    """
    parts = [[r.b - r.A @ found.theta for r in rows] for rows in walk]
    residual = tuple(np.concatenate(joint) for joint in zip(*parts, strict=True))
    in_columns = np.linalg.lstsq(R[:, found.determined], found.orthonormal[0], rcond=None)[0]

    @cache
    def orthonormal() -> list[FloatArray]:
        """``Q = A U`` on the whole rows, as large as all of them together; ``U`` the triangle's with its own basis."""
        parts = [[r.A[:, found.determined] @ in_columns for r in rows] for rows in walk]
        return [np.vstack(joint) for joint in zip(*parts, strict=True)]

    basis = LateSequence(lambda joint: orthonormal()[joint], len(residual))
    return replace(found, residual=residual, orthonormal=basis)
