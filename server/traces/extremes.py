"""From many rows to few moments, without losing a peak: the smallest and the largest value within each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Extremes:
    """``M`` moments of ``n`` channels, in order of time.

    Attributes
    ----------
    time : (M,) s, middle of the moment
    low, high : (M, n) smallest and largest finite value within it; NaN where there is none
    flagged : (M, n) whether some value within it was not measured when it stands there
    width : s, length of a moment; 0 for rows as they are
    """

    time: npt.NDArray[np.float64]
    low: FloatArray
    high: FloatArray
    flagged: BoolArray
    width: float


def extremes(
    time: npt.NDArray[np.float64], low: FloatArray, high: FloatArray, bad: BoolArray, width: float
) -> Extremes:
    """Gather rows into moments of ``width`` s whose ends are multiples of it; those without a row are left out.

    Parameters
    ----------
    time : (N,) s, increasing
    low, high, bad : (N, n); ``low`` and ``high`` are the same array for rows that are single values
    """
    if len(time) == 0:
        return Extremes(time, low, high, bad, width)
    keys = np.floor(time / width).astype(np.int64)
    starts = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1))
    return Extremes(
        np.asarray((keys[starts] + 0.5) * width, dtype=np.float64),
        np.fmin.reduceat(low, starts, axis=0),
        np.fmax.reduceat(high, starts, axis=0),
        np.logical_or.reduceat(bad, starts, axis=0),
        width,
    )


def at_most(found: Extremes, start: float, end: float, moments: int) -> Extremes:
    """Reduce ``found`` to at most ``moments`` + 1 moments from ``start`` to ``end``; itself if so few."""
    if len(found.time) <= moments:
        return found
    width = (end - start) / moments
    if found.width > 0:  # of whole moments: others would look as if every second one were missing
        width = math.ceil(width / found.width - 1e-9) * found.width
    return extremes(found.time, found.low, found.high, found.flagged, width)


def runs(time: npt.NDArray[np.float64], marked: BoolArray, width: float) -> list[tuple[float, float]]:
    """Find from when to when ``marked`` (M,) holds without a break, s.

    Parameters
    ----------
    width : s that one moment lasts; 0: until the next
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8)))
    first, behind = edges[::2], edges[1::2]
    last = behind - 1 if width > 0 else np.minimum(behind, len(time) - 1)
    half = 0.5 * width
    return [(float(a), float(b)) for a, b in zip(time[first] - half, time[last] + half, strict=True)]
