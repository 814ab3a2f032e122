"""A quantity on a grid that is as fine as linear interpolation needs, over the variables that it depends on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from fitting.arrays import FloatArray

#: Error of linear interpolation that grids are refined to, as a share of the table's largest value.
TOLERANCE = 1e-3
#: Most points along a variable of a table of one, and of two.
_MOST = {1: 513, 2: 65}
_TRIALS, _BETWEEN = 40, 2000
#: Share of the largest value below which a change is rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Quantity:
    """Something to be tabled.

    Attributes
    ----------
    name : of the file
    description : what it is, and how it is used
    unit : of the value
    variables : name, unit, lowest, highest of everything that it may depend on
    value : (N, variables) to (N,)
    """

    name: str
    description: str
    unit: str
    variables: tuple[tuple[str, str, float, float], ...]
    value: Callable[[FloatArray], FloatArray]

    @property
    def low(self) -> FloatArray:
        """Lowest values of the variables."""
        return np.array([own[2] for own in self.variables])

    @property
    def high(self) -> FloatArray:
        """Highest values of the variables."""
        return np.array([own[3] for own in self.variables])


@dataclass(frozen=True)
class Table:
    """A quantity on a grid.

    Attributes
    ----------
    quantity : what it is
    chosen : numbers of the variables that it depends on
    axes : their values, rising
    values : on the grid
    error : largest error of linear interpolation between, in the unit of the value
    """

    quantity: Quantity
    chosen: tuple[int, ...]
    axes: tuple[FloatArray, ...]
    values: FloatArray
    error: float


def tabled(quantity: Quantity, rng: np.random.Generator) -> Table | str | None:
    """Tabulate a quantity over its variables; return a line on why not, None of nothing."""
    low, high = quantity.low, quantity.high
    points = rng.uniform(low, high, (_TRIALS, len(low)))
    first = quantity.value(points)
    scale = float(np.max(np.abs(first)))
    if scale == 0.0:
        return None
    chosen = []
    for k in range(len(low)):
        moved = points.copy()
        moved[:, k] = rng.uniform(low[k], high[k], _TRIALS)
        if np.max(np.abs(quantity.value(moved) - first)) > ROUNDING * scale:
            chosen.append(k)
    if len(chosen) > max(_MOST):
        names = ", ".join(quantity.variables[k][0] for k in chosen)
        return f"{quantity.name}: it depends on {names}, which is more than a table of two variables has"
    chosen = chosen or [0]
    middle = 0.5 * (low + high)

    def at(rows: FloatArray) -> FloatArray:
        whole = np.tile(middle, (len(rows), 1))
        whole[:, chosen] = rows
        return quantity.value(whole)

    axes = _refined(at, low[chosen], high[chosen], TOLERANCE * scale)
    values = _ongrid_points(at, axes)
    between = rng.uniform(low[chosen], high[chosen], (_BETWEEN, len(chosen)))
    # Middles of the cells as well, where linear interpolation of something smooth is worst.
    middles = [0.5 * (axis[1:] + axis[:-1]) for axis in axes]
    between = np.vstack([between, grid_points(middles)])
    error = float(np.max(np.abs(RegularGridInterpolator(axes, values)(between) - at(between))))
    return Table(quantity, tuple(chosen), axes, values, error)


def grid_points(axes: Sequence[FloatArray]) -> FloatArray:
    return np.stack([own.ravel() for own in np.meshgrid(*axes, indexing="ij")], axis=1)


def _ongrid_points(value: Callable[[FloatArray], FloatArray], axes: Sequence[FloatArray]) -> FloatArray:
    return value(grid_points(axes)).reshape([len(axis) for axis in axes])


def _refined(
    value: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, tolerance: float
) -> tuple[FloatArray, ...]:
    """Refine axes until linear interpolation errs by at most ``tolerance``, as far as points suffice."""
    most = _MOST[len(low)]
    axes = [np.linspace(a, b, 17) for a, b in zip(low, high, strict=True)]
    busy = True
    while busy:
        busy, values = False, _ongrid_points(value, axes)
        for k, axis in enumerate(list(axes)):
            middles = 0.5 * (axis[1:] + axis[:-1])
            between = _ongrid_points(value, [*axes[:k], middles, *axes[k + 1 :]])
            ends = np.moveaxis(values, k, 0)
            wrong = np.abs(np.moveaxis(between, k, 0) - 0.5 * (ends[1:] + ends[:-1])).reshape(len(middles), -1)
            worst = wrong.max(axis=1)
            worse = np.argsort(-worst)[: max(most - len(axis), 0)]
            added = middles[worse[worst[worse] > tolerance]]
            if len(added):
                axes[k], busy = np.sort(np.concatenate([axis, added])), True
                break  # the values of the other axis are on the old grid
    return tuple(axes)
