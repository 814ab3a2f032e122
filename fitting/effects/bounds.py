"""Values of an effect inside what is physically possible, and what they gain: the one place for signs.

A friction cannot drive, a cushion cannot pull, a compliance cannot be negative. An effect's parameters have bounds
(:class:`~fitting.effects.base.Parameter`), and its gain is the most that is left inside them::

    max  2 g' theta - theta' S theta   for  low <= theta <= high.

With the few parameters that have bounds every set of them is tried at its bounds (C. Lawson and R. Hanson, *Solving
Least Squares Problems*, 1974, ch. 23): the best that keeps the others inside is the solution. What an effect would gain
outside is a law, not this name.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from fitting.arrays import FloatArray, unit_gram
from fitting.effects.base import Effect

#: Lower and upper bounds, (k,) each.
Bounds = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class Inside:
    """The solution inside the bounds.

    Attributes
    ----------
    values : (k,)
    gain : chi-square that they take
    held : parameters that are at a bound, which they would be beyond
    """

    values: FloatArray
    gain: float
    held: tuple[int, ...]


def inside(bounds: Bounds, gram: FloatArray, products: FloatArray, free: FloatArray) -> Inside | None:
    """Find the best values inside an effect's bounds; None where the ``free`` ones (k,) are.

    Parameters
    ----------
    bounds : lower and upper ones (k,) of an effect's parameters, or of the first of them (:func:`limits`)
    gram, products : (k, k) and (k,), what the base explains taken off
    free : (k,) least-squares values without bounds
    """
    low, high = bounds
    if np.all((free >= low) & (free <= high)):
        return None
    S, size = unit_gram(gram)
    g = products / size
    low, high = (bound * np.where(np.isfinite(size), size, 1.0) for bound in bounds)
    # Of each parameter: free (NaN), or at one of its bounds.
    choices = [[np.nan, *(b for b in pair if np.isfinite(b))] for pair in zip(low, high, strict=True)]
    best = Inside(np.zeros(len(free)), 0.0, tuple(k for k, own in enumerate(choices) if len(own) > 1))
    for values in map(np.array, list(product(*choices))[1:]):
        others = np.isnan(values)
        rest = g[others] - S[np.ix_(others, ~others)] @ values[~others]
        values[others] = np.linalg.pinv(S[np.ix_(others, others)], rcond=1e-8, hermitian=True) @ rest
        gain = float(2.0 * g @ values - values @ S @ values)
        if gain > best.gain and np.all((values >= low) & (values <= high)):
            best = Inside(values / size, gain, tuple(np.flatnonzero(~others).tolist()))
    return best


@cache
def limits(effect: Effect) -> Bounds:
    """Return lower and upper bounds (k,) of an effect's parameters."""
    return np.array([p.low for p in effect.parameters]), np.array([p.high for p in effect.parameters])
