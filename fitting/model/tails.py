"""How often a random signal exceeds a threshold, beyond what was seen: peaks over a threshold.

Peaks of independent excursions above a high level are distributed as Pareto's generalised law (Pickands 1975); its
shape and scale follow from probability-weighted moments (Hosking and Wallis, *Technometrics* 29, 1987). A shape below
zero would be an end that nothing exceeds, which a short record cannot determine: the shape is never taken below zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.errors import InputError
from fitting.arrays import FloatArray

#: Share of the samples below the level above which peaks count.
_LEVEL = 0.95
_FEWEST, _MOST_SHAPE = 20, 0.5


@dataclass(frozen=True)
class Tail:
    """Excursions of a score.

    Attributes
    ----------
    level : above which a peak counts
    rate : peaks per second
    scale, shape : of the generalised Pareto law of what is above the level; shape from 0 to 0.5
    """

    level: float
    rate: float
    scale: float
    shape: float

    def threshold(self, per_second: float) -> float:
        """Return the score that is exceeded so many times a second."""
        times = max(self.rate / per_second, 1.0)
        if self.shape < 1e-9:
            return self.level + self.scale * float(np.log(times))
        return self.level + self.scale / self.shape * float(times**self.shape - 1.0)


def excursions(above: npt.NDArray[np.bool_], quiet: int) -> list[slice]:
    """Find runs above a level; runs fewer than ``quiet`` samples apart are one."""
    places = np.flatnonzero(above)
    if not len(places):
        return []
    ends = np.flatnonzero(np.diff(places) > quiet)
    first, last = np.append(0, ends + 1), np.append(ends, len(places) - 1)
    return [slice(int(places[a]), int(places[b]) + 1) for a, b in zip(first, last, strict=True)]


def tail_of(stretches: Sequence[FloatArray], rate_hz: float, quiet: int) -> Tail:
    """Fit the tail of a score that was seen in some stretches.

    Parameters
    ----------
    stretches : scores (N,), none below zero
    quiet : samples between two excursions

    Raises
    ------
    InputError
        If there are too few peaks for a fit.
    """
    level = float(np.quantile(np.concatenate(stretches), _LEVEL))
    peaks = np.array([own[part].max() for own in stretches for part in excursions(own > level, quiet)]) - level
    if len(peaks) < _FEWEST:
        raise InputError("fitting.overload_peaks_too_few", peaks=len(peaks), seconds=sum(map(len, stretches)) / rate_hz)
    peaks = np.sort(peaks)
    n, mean = len(peaks), float(peaks.mean())
    second = float(np.sum((n - np.arange(1, n + 1)) / (n - 1) * peaks) / n)
    shape = float(np.clip(2.0 - mean / max(mean - 2.0 * second, 1e-12 * mean), 0.0, _MOST_SHAPE))
    seconds = sum(map(len, stretches)) / rate_hz
    return Tail(level, n / seconds, mean * (1.0 - shape), shape)
