"""The simple formula that comes nearest to a measured law: a hint at its physics, not an explanation.

Five one-shape families are tried on the law's curve, each with an offset of its own (a constant is the base model's):
power, exponential, threshold, sine and step. The shape is searched on a grid and then between its points; amplitude and
offset follow by least squares weighted with the curve's own uncertainty.

The same families, without an offset, are what a law is likely to be before any data (:func:`simple_curves`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy

from fitting.arrays import FloatArray
from fitting.signals.splines import evaluate

#: Shapes that are tried of every family before the best is searched between its neighbours.
_SHAPES = 40
#: Shapes of every family that represent it before any data, and places at which a spline is fitted to one.
_FEW_SHAPES, _PLACES = 16, 120
#: Standard deviations below this share of their median are taken for it: no point of a curve is exact.
_LEAST_STD = 0.05


@dataclass(frozen=True)
class SimpleFormula:
    """The nearest simple formula.

    Attributes
    ----------
    kind : ``power``, ``exponential``, ``threshold``, ``sine`` or ``step``
    shape : exponent (without unit), or length, threshold, wavelength, place of the step, in the signal's unit
    rising : of a threshold, whether it acts above (True) or below; else True
    amplitude : difference of its largest and smallest value over the signal's range, in the curve's unit
    share : share of the curve's weighted variance that it explains, 0 to 1
    """

    kind: str
    shape: float
    rising: bool
    amplitude: float
    share: float


@dataclass(frozen=True)
class _Family:
    kind: str
    columns: Callable[[FloatArray, float], FloatArray]
    low: float
    high: float
    rising: bool = True


def nearest_formula(grid: npt.ArrayLike, value: npt.ArrayLike, std: npt.ArrayLike) -> SimpleFormula | None:
    """Find the family and shape that leave least of a curve; None where it is flat.

    Parameters
    ----------
    grid : (N,) the signal, rising
    value, std : (N,) the curve and its standard deviation
    """
    x, y, noise = (np.asarray(part, dtype=float) for part in (grid, value, std))
    weights = 1.0 / np.maximum(noise, max(_LEAST_STD * float(np.median(noise)), 1e-300))
    weights = weights / weights.max() if noise.max() > 0 else np.ones_like(x)
    whole = _left(np.ones((len(x), 1)), y, weights)
    if whole <= 1e-24 * float(np.sum((weights * y) ** 2)) or whole == 0.0:
        return None
    found = [_fitted(family, x, y, weights, whole) for family in _families(x)]
    # A sine has one more amplitude than the others: it pays as much as one of N points would explain by chance.
    return max(found, key=lambda own: own.share - (1.0 / len(x) if own.kind == "sine" else 0.0))


@lru_cache(maxsize=4096)
def simple_curves(knots: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the short list as coefficients of a cubic spline over its range, and each curve's share of it.

    Returns
    -------
    coefficients : (F, n, 2) of the spline whose clamped knots are ``knots``; the second column is that of a sine's
        phase, else zero
    weights : (F,) summing to 1; every kind has the same share, however many shapes it has
    """
    x = np.linspace(knots[0], knots[-1], _PLACES)
    nearest = np.linalg.pinv(evaluate(np.asarray(knots), x))
    families = _families(x)
    kinds = [family.kind for family in families]
    curves, weights = [], []
    for family in families:
        share = 1.0 / (len(set(kinds)) * kinds.count(family.kind) * _FEW_SHAPES)
        for shape in _spaced(family, _FEW_SHAPES):
            column = family.columns(x, float(shape)).reshape(len(x), -1)
            curves.append(nearest @ np.hstack([column, np.zeros((len(x), 2 - column.shape[1]))]))
            weights.append(share)
    return np.array(curves), np.array(weights)


def _spaced(family: _Family, count: int) -> FloatArray:
    """Return so many shapes of a family."""
    return np.asarray(
        (np.linspace if family.kind in ("threshold", "step") else np.geomspace)(family.low, family.high, count)
    )


def _families(x: FloatArray) -> list[_Family]:
    span = float(x[-1] - x[0])
    origin = 0.0 if x[0] <= 0.0 <= x[-1] else float(x[0] if x[0] > 0 else x[-1])
    largest = float(np.max(np.abs(x - origin)))

    def even_power(x: FloatArray, exponent: float) -> FloatArray:
        return np.asarray(np.abs((x - origin) / largest) ** exponent)

    def sines(x: FloatArray, wave: float) -> FloatArray:
        return np.column_stack([np.sin(2 * np.pi * x / wave), np.cos(2 * np.pi * x / wave)])

    inner = x[0] + 0.04 * span, x[-1] - 0.04 * span
    return [
        _Family("power", lambda x, exponent: np.sign(x - origin) * even_power(x, exponent), 0.2, 5.0),
        _Family("power", even_power, 0.2, 5.0),
        _Family("exponential", lambda x, length: np.exp((x - x[-1]) / length), span / 20, 3 * span),
        _Family("exponential", lambda x, length: np.exp((x[0] - x) / length), span / 20, 3 * span, rising=False),
        _Family("threshold", lambda x, place: np.maximum(0.0, x - place), *inner),
        _Family("threshold", lambda x, place: np.maximum(0.0, place - x), *inner, rising=False),
        _Family("sine", sines, span / 10, 2 * span),
        _Family("step", lambda x, place: (x > place).astype(float), *inner),
    ]


def _fitted(family: _Family, x: FloatArray, y: FloatArray, weights: FloatArray, whole: float) -> SimpleFormula:
    def table(shape: float) -> FloatArray:
        return np.column_stack([np.ones_like(x), family.columns(x, shape)])

    def cost(shape: float) -> float:
        return _left(table(shape), y, weights)

    shapes = _spaced(family, _SHAPES)
    best = int(np.argmin([cost(shape) for shape in shapes]))
    near = float(shapes[max(0, best - 1)]), float(shapes[min(len(shapes) - 1, best + 1)])
    found = scipy.optimize.minimize_scalar(
        cost, bounds=near, method="bounded", options={"xatol": 1e-3 * (near[1] - near[0])}
    )
    shape = float(found.x) if found.fun < cost(float(shapes[best])) else float(shapes[best])
    columns = table(shape)
    values = np.linalg.lstsq(weights[:, None] * columns, weights * y, rcond=None)[0]
    curve = columns @ values
    return SimpleFormula(family.kind, shape, family.rising, float(np.ptp(curve)), 1.0 - cost(shape) / whole)


def _left(columns: FloatArray, y: FloatArray, weights: FloatArray) -> float:
    """Compute the weighted sum of squares that a least-squares fit leaves."""
    table, target = weights[:, None] * columns, weights * y
    values = np.linalg.lstsq(table, target, rcond=None)[0]
    return float(np.sum((target - table @ values) ** 2))
