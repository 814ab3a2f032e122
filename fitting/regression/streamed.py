"""Least squares over more rows than fit in memory, segment by segment.

Rows ``[A b]`` of a segment are folded into a triangle by orthogonal transformations (``[R; A_k] = Q_k R'``): it keeps
all that least squares needs of any number of rows, and unlike normal equations it does not square the condition number.
A second walk through the segments gives the residuals. Rows of short recordings are one part, and kept.

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

_Part = Sequence[WhiteRows]
#: What is put under the whitened rows of all joints: a prior's.
Closing = Callable[[_Part], _Part]


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

    def closing(prior: Prior | None) -> Closing:
        return lambda rows: rows if prior is None else with_prior(rows, design.parameters, prior, late)

    parts = _parts(design, noise, fitted, extra)
    R = _folded(parts, closing(None if prior is None else prior.unsettled()), _expected(design, extra))
    if prior is not None and prior.arm is not None:
        prior = prior.settled(R[:, :-1], R[:, -1])
        R = triangle([R, np.column_stack(prior.arm_rows(R.shape[1] - 1))])
    found = solve([WhiteRows(R[:, :-1], R[:, -1], ())], names)
    return _shared(_whole(found, R[:, :-1], parts, closing(prior)), design, prior), prior


def _shared(fit: Fit, design: Design, prior: Prior | None) -> Fit:
    """Add to the fit its share from the data."""
    return fit if prior is None else replace(fit, share=data_share(fit.covariance, design.parameters, prior))


def folded(
    design: Design, noise: NoiseModel, fitted: Sequence[int], extra: Extra, closing: Closing = lambda rows: rows
) -> FloatArray:
    """Compute the triangle of all joints' whitened rows ``[A b]`` over some segments (as :func:`fit_rows`)."""
    return _folded(_parts(design, noise, fitted, extra), closing, _expected(design, extra))


def _parts(design: Design, noise: NoiseModel, fitted: Sequence[int], extra: Extra | None) -> Sequence[_Part]:
    """Return whitened rows of all joints: of all segments at once, or of one whenever it is asked for."""
    if not design.stored:
        return [whitened(design, noise, fitted, extra)]
    return LateSequence(lambda place: whitened(design, noise, (fitted[place],), extra), len(fitted))


def _closed(parts: Sequence[_Part], closing: Closing) -> Iterator[_Part]:
    """Walk through the parts, the prior's rows under the last."""
    for number, rows in enumerate(parts, start=1):
        yield closing(rows) if number == len(parts) else rows


def _expected(design: Design, extra: Extra | None) -> tuple[WhiteRows, ...]:
    """Return what the extra columns' parameters are expected to be, as rows."""
    return () if extra is None else extra.expected_rows(len(design.parameters))


def _folded(parts: Sequence[_Part], closing: Closing, expected: tuple[WhiteRows, ...]) -> FloatArray:
    """Compute the triangle of all rows ``[A b]``, of what is expected too."""
    every = chain(_closed(parts, closing), [(rows,) for rows in expected])
    return triangle(np.vstack([np.column_stack([r.A, r.b]) for r in rows]) for rows in every)


def _whole(found: Fit, R: FloatArray, parts: Sequence[_Part], closing: Closing) -> Fit:
    """Return the fit of the rows behind the triangle of ``found``: with their residual, and their basis when it is
    asked for.
    """
    missing = [[r.b - r.A @ found.theta for r in rows] for rows in _closed(parts, closing)]
    residual = tuple(np.concatenate(joint) for joint in zip(*missing, strict=True))

    @cache
    def orthonormal() -> list[FloatArray]:
        """``Q = A U`` on the whole rows, as large as all of them together; ``U`` the triangle's with its own basis."""
        in_columns = np.linalg.lstsq(R[:, found.determined], found.orthonormal[0], rcond=None)[0]
        shown = [[r.A[:, found.determined] @ in_columns for r in rows] for rows in _closed(parts, closing)]
        return [np.vstack(joint) for joint in zip(*shown, strict=True)]

    basis = LateSequence(lambda joint: orthonormal()[joint], len(residual))
    return replace(found, residual=residual, orthonormal=basis)
