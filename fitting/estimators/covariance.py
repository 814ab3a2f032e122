"""Covariance of parameters when the residual is coloured, and rows condensed to equations of unit noise by it.

A machine's residual is filtered noise and what the model lacks, and both hang together over many samples (a crane's
has autocorrelation 0.93 at 50 ms). The textbook ``sigma^2 (A'A)^-1`` then promises several times too much. With
``A^+ = root Q'`` the covariance is ``root S root'``, ``S`` the covariance of ``Q'e``; three ways to ``S`` are here:

``white``      ``sigma^2 I``: the textbook's.
``hac``        Newey and West's sum over lags of the scores ``u_t = Q_t e_t``, the residual whitened first by an
               autoregression (after Andrews and Monahan), the bandwidth from the data. Asks nothing of the residual
               but that it forgets; also right where its size changes with the motion.
``bootstrap``  residuals are drawn anew: an autoregression takes most of the colour out, its innovations are drawn in
               circular blocks, and are coloured again (``post-blackening``). Asks for one spectrum per joint; holds
               on to short series better than a sum over lags.

Sources: Newey and West, Econometrica 55 (1987) 703; Andrews, Econometrica 59 (1991) 817; Andrews and Monahan,
Econometrica 60 (1992) 953; Davison and Hinkley, *Bootstrap Methods and their Application* (1997), 8.2.3;
Politis and White, Econometric Reviews 23 (2004) 53, with the correction in 28 (2009) 372.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy
from scipy import linalg

from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.estimators.base import Rows
from fitting.estimators.least_squares import Solution, solve

#: How a covariance treats colour: a name as above, or a fixed number of lags for a plain Newey-West sum.
Colour = int | Literal["white", "hac", "bootstrap"]

COLOURS = ("white", "hac", "bootstrap")
_STRONGEST = 0.97  # of an autoregression: a root any nearer to one is a trend, not a colour
_SHORT = 20  # rows below which a series determines nothing of its own colour
_DRAWS = 400  # leaves 3.5 % of chance in a standard deviation
_MOST_ORDER = 10


def scores_covariance(
    solution: Solution,
    residual: FloatArray,
    colour: Colour,
    group: IntArray,
    counted: BoolArray | None = None,
) -> FloatArray | float:
    """Compute the covariance of ``Q'e``: (rank, rank), or one variance for a white residual.

    ``counted`` (R,) is False for rows that were left out (their residual is zero and they take no freedom).
    """
    check_colour(colour)
    count = len(residual) if counted is None else int(np.count_nonzero(counted))
    free = count - solution.rank
    if free <= 0:
        return float("nan")
    if colour == "white":
        return float(residual @ residual) / free
    S = np.zeros((solution.rank, solution.rank))
    rng = np.random.default_rng(20)  # the same residual gives the same deviation
    for label in np.unique(group):
        own = group == label
        if colour == "bootstrap" and counted is not None:
            own = own & counted
        S += series_scores(solution.Q[own], residual[own], colour, rng)
    return np.asarray(S * (count / free))


def series_scores(Q: FloatArray, e: FloatArray, colour: Colour, rng: np.random.Generator) -> FloatArray:
    """Compute ``Q'e``'s covariance (rank, rank) of one series in time order, with no factor for fitted parameters.

    ``Q`` (n, rank) has columns of one size, or some rows of such ones.
    """
    if colour == "bootstrap":
        draws = residual_draws(e, _DRAWS, rng) @ Q
        return np.asarray(draws.T @ draws / _DRAWS)
    if colour == "hac":
        return _whitened_sum(Q, e)
    return _bartlett(Q * e[:, None], 0 if colour == "white" else int(colour))


def check_colour(colour: Colour) -> None:
    """Refuse what is no :data:`Colour` (``ValueError``)."""
    if isinstance(colour, str):
        if colour not in COLOURS:
            raise ValueError(f"there is no covariance '{colour}'; use one of {', '.join(COLOURS)} or a number of lags")
    elif colour < 0:
        raise ValueError(f"lags is {colour}, it cannot be negative")


def _bartlett(U: FloatArray, lags: int) -> FloatArray:
    """Compute ``sum_|l| <= lags (1 - |l| / (lags + 1)) sum_t u_t u_(t-l)'`` of one series (n, k)."""
    S = U.T @ U
    for lag in range(1, min(lags, len(U) - 1) + 1):
        G = U[lag:].T @ U[:-lag]
        S += (1.0 - lag / (lags + 1.0)) * (G + G.T)
    return S


def _whitened_sum(Q: FloatArray, e: FloatArray) -> FloatArray:
    """Compute the long-run sum of the scores of one series, ``Q`` (n, k), ``e`` (n,).

    An autoregression ``a = T e`` takes most of the colour out of the residual. Then ``Q'e = (T^-T Q)'a``, and the
    scores ``v_t = (T^-T Q)_t a_t`` are nearly uncorrelated: a short Bartlett window does for them. Whitening the
    residual and not the scores keeps columns that swing (a motion's) right, where one coefficient per score does not.
    """
    if len(e) < _SHORT:
        return _bartlett(Q * e[:, None], 0)
    taps = autoregression(e)
    innovations = scipy.signal.lfilter(taps, [1.0], e)
    turned = scipy.signal.lfilter([1.0], taps, Q[::-1], axis=0)[::-1]
    V = turned * innovations[:, None]
    return _bartlett(V, _bandwidth(V))


def _bandwidth(V: FloatArray) -> int:
    """Compute Andrews' plug-in for the Bartlett kernel, equation 6.4, with one coefficient for all columns of scores.

    Their sums of products do not know which basis of the columns' space was taken, and neither does the covariance.
    """
    square = float(np.vdot(V, V))
    rho = min(abs(float(np.vdot(V[1:], V[:-1]))) / square, _STRONGEST) if square > 0 else 0.0
    return int(np.floor(1.1447 * (4.0 * rho**2 / (1.0 - rho**2) ** 2 * len(V)) ** (1.0 / 3.0)))


# --- block bootstrap ----------------------------------------------------------------------------------------------


def residual_draws(residual: npt.ArrayLike, draws: int, rng: np.random.Generator) -> FloatArray:
    """Draw series with the colour of a residual anew: (draws, n).

    An autoregression (order by Akaike's criterion) takes the colour out, its innovations are drawn in circular blocks
    of :func:`block_length`, and the same autoregression, started at rest a while before, colours them again.

    Parameters
    ----------
    residual : (n,) one series in time order
    draws : how many
    rng : where chance comes from
    """
    e = np.asarray(residual, dtype=float)
    n = len(e)
    if n < _SHORT:
        return rng.choice(e - e.mean(), (draws, n)) if n else np.zeros((draws, 0))
    taps = autoregression(e)
    innovations = scipy.signal.lfilter(taps, [1.0], e)[len(taps) - 1 :]
    innovations = innovations - innovations.mean()
    # What the autoregression forgets by a factor of e in 1 / (1 - 0.97) rows, it forgets in ten times that.
    start = 0 if len(taps) == 1 else min(n, 330)
    block = block_length(innovations)
    need = n + start
    first = rng.integers(0, len(innovations), (draws, -(-need // block)))
    index = (first[:, :, None] + np.arange(block)) % len(innovations)
    drawn = innovations[index.reshape(draws, -1)[:, :need]]
    return np.asarray(scipy.signal.lfilter([1.0], taps, drawn, axis=1)[:, start:])


def autoregression(e: FloatArray) -> FloatArray:
    """Fit the prediction error filter ``[1, -phi_1, ..., -phi_k]`` of a series, by Burg's method; ``k`` by Akaike.

    Burg's filter has its zeros inside the unit circle, so its inverse never grows, and on short series it takes a
    strong colour for less of itself than Yule and Walker's does (Kay, *Modern Spectral Estimation*, 7.6).
    """
    n = len(e)
    forward = backward = np.asarray(e, dtype=float)
    power = float(forward @ forward) / n
    best, taps = np.ones(1), np.ones(1)
    cost = n * np.log(power) if power > 0 else -np.inf
    for order in range(1, min(_MOST_ORDER, n // 10) + 1):
        f, b = forward[1:], backward[:-1]
        both = float(f @ f + b @ b)
        if both <= 1e-24 * n * max(power, 1e-300):
            break
        k = -2.0 * float(f @ b) / both
        forward, backward = f + k * b, b + k * f
        taps = np.append(taps, 0.0) + k * np.append(taps, 0.0)[::-1]
        power *= 1.0 - k**2
        if power <= 0:
            break
        new = n * np.log(power) + 2 * order
        if new < cost:
            best, cost = taps, new
    return best


def block_length(series: FloatArray) -> int:
    """Compute the length of circular blocks (Politis and White); at least the cube root of the length.

    ``b = (2 G^2 n / D)^(1/3)``, ``G = sum |k| r_k``, ``D = 4/3 (sum r_k)^2`` over a flat-top window that reaches twice
    as far as the last autocorrelation above ``2 sqrt(log10(n) / n)``.
    """
    n = len(series)
    most = max(5, int(np.ceil(np.sqrt(n))))
    centred = series - series.mean()
    power = float(centred @ centred)
    least = max(1, round(float(np.cbrt(n))))
    if power <= 0:
        return least
    r = np.array([centred[k:] @ centred[: n - k] for k in range(min(2 * most, n - 1) + 1)]) / power
    alive = np.flatnonzero(np.abs(r[1 : most + 1]) > 2.0 * np.sqrt(np.log10(n) / n))
    reach = min(2 * (int(alive[-1]) + 1 if alive.size else 1), len(r) - 1)
    k = np.arange(1, reach + 1)
    window = np.clip(2.0 * (1.0 - k / reach), 0.0, 1.0)
    G = 2.0 * float(np.sum(window * k * r[1 : reach + 1]))
    total = 1.0 + 2.0 * float(np.sum(window * r[1 : reach + 1]))
    b = float(least)
    if total > 0:
        b = float((2.0 * G**2 * n / (4.0 / 3.0 * total**2)) ** (1 / 3))
    return min(max(round(b), least), max(least, int(3 * np.sqrt(n))))


@dataclass(frozen=True)
class Information:
    """``rows theta = target + n``, ``n`` of unit covariance: all that ``A theta = b + e`` holds of ``theta``.

    Attributes
    ----------
    solution : least squares of the (weighted) rows
    covariance : (p, p) of its parameters
    rows, target : (rank, p), (rank,)
    """

    solution: Solution
    covariance: FloatArray
    rows: FloatArray
    target: FloatArray


def information(rows: Rows, colour: Colour) -> Information:
    """Condense weighted rows.

    ``Q'A theta = Q'b - Q'e`` with ``Q`` an orthonormal basis of the columns; a Cholesky factor of the covariance of
    ``Q'e`` makes the noise one. Where too few rows are left to estimate the noise, it counts as one.
    """
    root = np.sqrt(rows.weights)
    A, b = rows.A * root[:, None], rows.b * root
    solution = solve(A, b)
    residual = b - A @ solution.theta
    middle = scores_covariance(solution, residual, colour, rows.group, rows.weights > 0)
    S = np.eye(solution.rank) * middle if np.ndim(middle) == 0 else np.asarray(middle)
    # Exact rows have a noise of rounding only; below this they are as good as exact.
    least = (1e-9 * float(np.linalg.norm(b)) / np.sqrt(max(len(b), 1))) ** 2
    S = S + least * np.eye(solution.rank) if np.isfinite(S).all() else np.eye(solution.rank)
    reduced, target = solution.Q.T @ A, solution.Q.T @ b
    if solution.rank and S.any():
        L = linalg.cholesky(S, lower=True)
        reduced = linalg.solve_triangular(L, reduced, lower=True)
        target = linalg.solve_triangular(L, target, lower=True)
    return Information(solution, solution.covariance(middle), reduced, target)
