"""Evidence of terms: how much more likely the whitened rows are with a term than without it.

The rows are whitened, so their noise is a standard normal one, and the base parameters have a flat prior: they are
projected out. With columns ``C``, prior covariance ``L L'`` of their parameters, ``S = C'C - (Q'C)'(Q'C)`` what the
base leaves of the columns and ``g = C'e`` their products with the residual ``e`` of the base, the logarithm of the
Bayes factor against no term is::

    h' (I + H)^-1 h / 2 - log det(I + H) / 2,    H = L' S L,   h = L' g.

No parameter has a price: a wide prior pays by the determinant.

Sizes are measured in what can be seen of them: the root of the chi-square that the term takes, its *amplitude*. It is
log-uniform from :data:`~fitting.selection.priors.SMALLEST` to what the joint's whole effort is, and averaged out on a
grid. Given the amplitude, a named effect's ``k`` parameters have Zellner's g-prior (any direction of what is visible is
alike), and a spline law's coefficients are a smooth random curve.

Sources: D. MacKay, "Bayesian interpolation", Neural Computation 4, 1992; A. Zellner, "On assessing prior distributions
and Bayesian regression analysis with g-prior distributions", 1986; C. Rasmussen and C. Williams, Gaussian Processes for
Machine Learning, 2006 (curves).
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import scipy
from scipy import linalg

from fitting.arrays import FloatArray, IntArray, unit_gram
from fitting.residual.confirmation.local import Local
from fitting.selection import priors

#: Squared share of a column's norm below which what the base leaves of it is rounding.
DEAD = 1e-8
#: Share of the largest eigenvalue below which one is rounding.
ROUNDING = 1e-10


def bayes_factor(gram: FloatArray, products: FloatArray, root: FloatArray) -> float:
    """Compute the log Bayes factor of parameters with one prior, by the formula above.

    Parameters
    ----------
    gram, products : (k, k) and (k,), what the base explains taken off
    root : (k, r) of the prior covariance ``root root'``
    """
    factor = np.linalg.cholesky(np.eye(root.shape[1]) + root.T @ gram @ root)
    turned = np.linalg.solve(factor, root.T @ products)
    return float(0.5 * turned @ turned - np.sum(np.log(np.diag(factor))))


def log_sum(values: npt.ArrayLike, axis: int = -1, weights: npt.ArrayLike = 1.0) -> FloatArray:
    """Compute the logarithm of the weighted sum of exponentials along an axis."""
    values = np.asarray(values, dtype=float)
    top = np.max(values, axis=axis, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    total = np.sum(np.asarray(weights) * np.exp(values - top), axis=axis)
    return np.asarray(np.log(np.maximum(total, 1e-300)) + np.squeeze(top, axis=axis))


def log_mean(values: npt.ArrayLike, axis: int = -1) -> FloatArray:
    """Compute the logarithm of the mean of exponentials along an axis."""
    values = np.asarray(values, dtype=float)
    return np.asarray(log_sum(values, axis) - np.log(values.shape[axis]))


def log_means(values: FloatArray, counts: IntArray) -> FloatArray:
    """Compute :func:`log_mean` of each of several groups of consecutive values, of ``counts`` values each."""
    starts = np.cumsum(counts) - counts
    return np.asarray(np.maximum(np.logaddexp.reduceat(values, starts), np.log(1e-300)) - np.log(counts))


def named_evidence(gain: FloatArray, live: FloatArray, amplitudes: FloatArray) -> FloatArray:
    """Compute log Bayes factors (T, A) of effects whose formula is exactly nature's.

    Parameters
    ----------
    gain : (T,) chi-square that a least-squares fit of the term takes
    live : (T,) number of its directions that the base leaves
    amplitudes : (A,)
    """
    live = np.maximum(live, 1)[:, None]
    g = amplitudes**2 / live
    return np.asarray(0.5 * gain[:, None] * g / (1.0 + g) - 0.5 * live * np.log1p(g))


@cache
def curve_roots(functions: int, lengths: tuple[float, ...]) -> FloatArray:
    """Compute roots (lengths, n, n) of a spline's prior covariances.

    Coefficients ``d`` sixteenths of the range apart have the correlation ``exp(-d^2 / (2 length^2))``. Their mean is
    as large as their spread along the signal: a constant alone is no law of it, and nothing of a law has to be zero on
    average.
    """
    places = np.linspace(0.0, 15.0, functions)
    apart = places[:, None] - places[None, :]
    centre = np.eye(functions) - 1.0 / functions
    roots = []
    for length in lengths:
        along = centre @ np.exp(-0.5 * (apart / length) ** 2) @ centre
        values, vectors = np.linalg.eigh(along + np.trace(along) / functions)
        roots.append(vectors * np.sqrt(np.maximum(values, 0.0)))
    return np.array(roots)


def curve_evidence(gram: FloatArray, products: FloatArray, roots: FloatArray, amplitudes: FloatArray) -> FloatArray:
    """Compute log Bayes factors (T, L, A) of splines: ``gram`` (T, n, n), ``products`` (T, n), ``roots`` (L, n, n)."""
    H = np.einsum("lia,tij,ljb->tlab", roots, gram, roots, optimize=True)
    h = np.einsum("lia,ti->tla", roots, products)
    size = np.maximum(np.einsum("tlaa->tl", H), 1e-300)
    values, vectors = np.linalg.eigh(H / size[..., None, None])
    values = np.maximum(values, 0.0)[..., None, :]
    turned = np.einsum("tlab,tla->tlb", vectors, h / np.sqrt(size)[..., None])[..., None, :]
    scale = (amplitudes**2)[:, None]
    spread = 1.0 + scale * values
    return np.asarray(0.5 * np.sum(scale * turned**2 / spread - np.log(spread), axis=-1))


def expected_curve(
    gram: FloatArray, products: FloatArray, lengths: tuple[float, ...], amplitudes: FloatArray
) -> FloatArray:
    """Compute a spline's prior at the most probable length and amplitude: rows (n, n) of unit noise around zero.

    Parameters
    ----------
    gram, products : (n, n) and (n,) of the spline, what the base explains taken off
    lengths, amplitudes : those that there may be
    """
    roots = curve_roots(len(products), lengths)
    values = curve_evidence(gram[None], products[None], roots, amplitudes)[0]
    length, size = np.unravel_index(int(np.argmax(values)), values.shape)
    root = roots[length]
    seen = max(float(np.trace(root.T @ gram @ root)), 1e-300)
    spread, vectors = np.linalg.eigh(root @ root.T)
    std = np.sqrt(np.maximum(spread, ROUNDING * spread[-1])) * float(amplitudes[size]) / np.sqrt(seen)
    return np.asarray((vectors / std).T)


def with_curve(model: Local, columns: FloatArray) -> tuple[Local, FloatArray]:
    """Add a smooth curve's ``columns`` (M, n) to a model, and return all parameters' moves (p + n,).

    The curve's prior is that of :func:`expected_curve`, in the noise that it leaves.
    """
    r, whole, noise = model.residual, np.hstack([model.columns, columns]), model.noise
    free = columns - model.columns @ np.linalg.solve(model.known, model.columns.T @ columns)
    for _ in range(2):
        sizes = priors.amplitudes(float(np.sqrt(r @ r / noise)))
        curve = expected_curve(columns.T @ free / noise, free.T @ r / noise, priors.LENGTHS, sizes)
        precision = linalg.block_diag(model.precision, noise * curve.T @ curve)
        values = np.asarray(np.linalg.solve(whole.T @ whole + precision, whole.T @ r))
        rest = r - whole @ values
        noise = max(float(rest @ rest) / model.rows, 1e-30)
    return Local(whole, rest, precision, noise, model.rows), values


def formula_gains(gram: FloatArray, products: FloatArray, curves: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute formulas' chi-square gains (T, F) of what splines could, and live directions (T, F).

    Parameters
    ----------
    gram, products : (T, n, n) and (T, n) of the splines, what the base explains taken off
    curves : (T, F, n, 2) coefficients; a formula has one amplitude or two
    """
    half = np.einsum("tij,tfja->tfia", gram, curves, optimize=True)
    H = np.einsum("tfia,tfib->tfab", curves, half, optimize=True)
    h = np.einsum("tfia,ti->tfa", curves, products, optimize=True)
    unit, size = unit_gram(H)
    values, vectors = np.linalg.eigh(unit)
    live = values > DEAD
    turned = np.einsum("tfab,tfa->tfb", vectors, h / size)
    return np.sum(np.where(live, turned**2 / np.where(live, values, 1.0), 0.0), axis=-1), np.sum(live, axis=-1)


def joint_evidence(
    gram: FloatArray, products: FloatArray, scales: FloatArray, first: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute log Bayes factors of parameters with independent priors of these scales: (.., p, p), (.., p), (K, p).

    Returns
    -------
    (.., K) log Bayes factors, (.., K) amplitude of what the parameters from number ``first`` on contribute at the
    posterior mean, and (.., K, first) that mean of those before.
    """
    H = scales[:, :, None] * gram[..., None, :, :] * scales[:, None, :]
    values, vectors = np.linalg.eigh(H)
    values = np.where(values > ROUNDING * values[..., -1:], values, 0.0)
    turned = np.einsum("...ij,...i->...j", vectors, scales * products[..., None, :]) * (values > 0)
    mean = scales * np.einsum("...ij,...j->...i", vectors, turned / (1.0 + values))
    rest = gram[..., None, first:, first:]
    shown = np.sqrt(np.maximum(np.einsum("...i,...ij,...j->...", mean[..., first:], rest, mean[..., first:]), 0.0))
    return 0.5 * np.sum(turned**2 / (1.0 + values) - np.log1p(values), axis=-1), shown, mean[..., :first]


@cache
def least_gain(live: int, choices: int = 1) -> float:
    """Compute the least chi-square to report an effect of ``live`` parameters in ``choices`` shapes."""
    sizes = priors.amplitudes(priors.USUAL_EFFORT)
    prior = np.log(priors.CATALOGUE / priors.NOTHING / priors.USUAL_FAMILIES / choices)

    def missing(gain: float) -> float:
        own = named_evidence(np.array([gain]), np.array([float(live)]), sizes)[0]
        return float(log_mean(own) + prior - priors.CREDIBLE_ODDS)

    return float(scipy.optimize.brentq(missing, 0.0, 1e4))
