"""Bases for laws of one variable whose shape is not known: cubic splines, and curves that never fall."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy

from fitting.arrays import FloatArray

#: Degree of a free curve's slope.
DEGREE = 3


def spline_knots(values: npt.ArrayLike, functions: int) -> FloatArray:
    """Place a clamped cubic B-spline's knots for ``functions`` functions, inner ones at quantiles of ``values``."""
    values = np.asarray(values, dtype=float)
    inner = functions - 4
    if inner < 0:
        raise ValueError("a cubic spline has at least four basis functions")
    low, high = float(values.min()), float(values.max())
    if high <= low:
        high = low + 1.0
    quantiles = np.quantile(values, np.linspace(0, 1, inner + 2)[1:-1])
    # Half quantiles, half even: quantiles alone leave no knots where a variable is rare.
    even = np.linspace(low, high, inner + 2)[1:-1]
    return np.concatenate([[low] * 4, (quantiles + even) / 2, [high] * 4])


def evaluate(knots: FloatArray, values: npt.ArrayLike, coefficients: FloatArray | None = None) -> FloatArray:
    """Evaluate basis functions at ``values``, shape (N, functions), or their sum (N,) with ``coefficients``; constant
    beyond the outer knots."""
    inside = np.clip(np.asarray(values, dtype=float), knots[0], knots[-1])
    # Coefficients of the identity: all functions at once, in compiled code.
    return np.asarray(
        scipy.interpolate.BSpline(knots, np.eye(len(knots) - 4) if coefficients is None else coefficients, 3)(inside)
    )


def spline_basis(values: npt.ArrayLike, functions: int) -> FloatArray:
    """Evaluate a basis over the range of ``values`` itself, (N, functions)."""
    return evaluate(spline_knots(values, functions), values)


def free_curve(opening: FloatArray, power: float, reach: float) -> list[FloatArray]:
    """Compute a free curve's parts (N,): integrals over ``(o / reach)^power`` of Bernstein's polynomials.

    Beyond the largest command that was fitted it goes on as it ends.
    """
    whole = np.power(opening / reach, power)
    share = np.minimum(whole, 1.0)
    rest, order = 1.0 - share, DEGREE + 1
    rising, falling = [np.ones_like(share)], [np.ones_like(share)]
    for _ in range(order):
        rising.append(rising[-1] * share)
        falling.append(falling[-1] * rest)
    parts, tail = list[FloatArray](), np.zeros_like(share)
    for i in range(order, 0, -1):
        tail = tail + scipy.special.comb(order, i) * rising[i] * falling[order - i]
        parts.insert(0, tail / order)
    return [*parts[:-1], parts[-1] + whole - share]
