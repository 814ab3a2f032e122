"""Channels while the machine stands still: noise, smallest step, value at rest, drift, jitter of their age."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from daq.arrays import FlagArray, FloatArray
from daq.quality import MEASURED, Quality

MOVING = 3.0  # deviations of the noise, by which values of a machine at rest do not scatter
BLOCKS = 10
LEAST = 20  # values


@dataclass(frozen=True)
class AtRest:
    """One channel, in its declared unit.

    Attributes
    ----------
    values : how many were measured
    share : of the cycles that brought a measurement that was due
    others : cycles by quality that brought none
    mean, noise : value, and standard deviation of white noise, from second differences, which a slow motion passes by
    step : smallest change that was seen; 0: none was
    drift, drift_std : change per minute; NaN where it moved
    moved : whether it scatters by more than its noise
    age_ms, jitter_ms : median and standard deviation of the age at SYNC
    """

    values: int
    share: float
    others: dict[str, int]
    mean: float
    noise: float
    step: float
    drift: float
    drift_std: float
    moved: bool
    age_ms: float
    jitter_ms: float


def at_rest(time: FloatArray, values: FloatArray, ages: FloatArray, quality: FlagArray) -> AtRest:
    """Look at one channel.

    Parameters
    ----------
    time : (N,) s
    values : (N,) in the channel's unit
    ages : (N,) s
    quality : (N,)
    """
    good = np.isin(quality, [int(q) for q in MEASURED]) & np.isfinite(values)
    late = (quality == Quality.LATE) & np.isfinite(values)
    if good.sum() < LEAST <= late.sum():
        good = late  # a slow unit: all its values are late, and tell the same
    names = {q.name.lower(): int((quality == q).sum()) for q in Quality}
    others = {name: n for name, n in names.items() if n and name not in ("fresh", "out_of_range", "held")}
    due = int((quality != Quality.HELD).sum())
    count = int(good.sum())
    share = count / due if due else 0.0
    if count < LEAST:
        nan = math.nan
        return AtRest(count, share, others, nan, nan, nan, nan, nan, moved=False, age_ms=nan, jitter_ms=nan)
    t, y = time[good], values[good]
    steps = np.abs(np.diff(y))
    noise = float(np.diff(y, n=2).std() / math.sqrt(6.0))
    drift, drift_std, scatter = _drift(t, y)
    step = float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
    moved = scatter > MOVING * max(noise, step)
    age = ages[good][np.isfinite(ages[good])]
    return AtRest(
        count, share, others, float(y.mean()), noise, step,
        math.nan if moved else drift, math.nan if moved else drift_std, moved,
        1e3 * float(np.median(age)) if len(age) else math.nan, 1e3 * float(age.std()) if len(age) else math.nan,
    )  # fmt: skip


def _drift(t: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Fit the slope per minute, its deviation by means of blocks, and the scatter about the line."""
    blocks = np.array_split(np.arange(len(t)), BLOCKS)
    x = np.array([t[block].mean() for block in blocks]) / 60.0
    m = np.array([y[block].mean() for block in blocks])
    x = x - x.mean()
    slope = float((x * m).sum() / (x * x).sum())
    left = m - m.mean() - slope * x
    std = math.sqrt(float((left**2).sum()) / (BLOCKS - 2) / float((x * x).sum()))
    line = y - y.mean() - slope * (t / 60.0 - (t / 60.0).mean())
    return slope, std, float(line.std())
