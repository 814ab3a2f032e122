"""Recordings of another rate, or of an uneven clock, brought to the machine's rate by a zero-phase low pass.

Every value is ``y(t) = sum_n x(t_n) h(t - t_n) / f`` with a symmetric Kaiser-windowed sinc ``h``: no phase, flat to
0.8 of the lower of both Nyquist frequencies, :data:`ATTENUATION_DB` down from that Nyquist frequency on, whatever the
ratio of the rates (Oppenheim and Schafer, Discrete-Time Signal Processing, section 7.5: the window's parameter and
length from attenuation and transition band). A logger's uneven samples are first put on an even grid of the same rate
by a spline of the seventh degree: at a fifth of the rate it is wrong by (0.2 / 0.8)^8 = 2e-5, a cubic one by 4e-3.
Gaps stay gaps: no value is made of samples from both sides of one, and where the low pass would need samples that are
not there (half its length beside a gap, and at both ends) nothing is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from daq.arrays import FloatArray
from daq.recordings.recording_checks import runs, same_rate

#: Ripple and leakage of the low pass: 3e-4 of an amplitude, a third of what 1e-3 allows.
ATTENUATION_DB = 70.0
#: Of the lower Nyquist frequency: up to here nothing is lost.
PASSBAND = 0.8
#: Of the median step: a longer one has lost more than a single sample, which is interpolated as uneven ones are. Half a
#: step more than two is where a third sample would be due.
GAP_STEPS = 2.5
#: Of the median step: samples as far as this from an even grid are on it. A signal of a tenth of the rate is then wrong
#: by at most 2 pi 0.1 0.001 = 6e-4 of its amplitude.
EVEN = 0.001
_DEGREE = 7
_MOST_VALUES = 1 << 22  # of kernel weights that are made at once: 32 MB


@dataclass(frozen=True)
class Resampled:
    """Columns at the machine's rate.

    Attributes
    ----------
    time : (N,) s, even
    values : per column (N,), NaN where nothing is known
    rate_hz : what the file had
    uneven : whether its samples were not on an even grid
    """

    time: FloatArray
    values: Mapping[str, FloatArray]
    rate_hz: float
    uneven: bool

    @property
    def gap_seconds(self) -> float:
        """Time in which at least one column has no values."""
        known = np.all([np.isfinite(v) for v in self.values.values()], axis=0)
        return float(np.count_nonzero(~known)) * float(self.time[1] - self.time[0]) if len(self.time) > 1 else 0.0


def native_rate(time: FloatArray) -> float:
    """Compute samples per second of a clock, by median step; lost samples do not count."""
    return 1.0 / float(np.median(np.diff(time)))


def grid(times: Sequence[FloatArray], rate_hz: float) -> FloatArray:
    """Make the even clock on which all of several clocks run."""
    begin, end = max(float(t[0]) for t in times), min(float(t[-1]) for t in times)
    count = int(np.floor((end - begin) * rate_hz * (1.0 + 1e-12) + 1e-9)) + 1
    return begin + np.arange(max(count, 0)) / rate_hz


def resample(time: FloatArray, columns: Mapping[str, FloatArray], rate_hz: float, at: FloatArray) -> Resampled:
    """Resample columns at other times.

    Parameters
    ----------
    time : (M,) s, strictly increasing
    columns : (M,) each; NaN where nothing was measured
    rate_hz : rate of ``at``
    at : (N,) s, even
    """
    rate = native_rate(time)
    values: dict[str, FloatArray] = {name: np.full(len(at), np.nan) for name in columns}
    uneven = False
    by_mask: dict[bytes, list[str]] = {}
    for name, column in columns.items():
        by_mask.setdefault(np.packbits(np.isfinite(column)).tobytes(), []).append(name)
    for names in by_mask.values():
        known = np.isfinite(columns[names[0]])
        at_known = time[known]
        # Stretches that lack no more than single samples.
        for rows in runs(np.ones(len(at_known), dtype=bool), np.diff(at_known) * rate <= GAP_STEPS):
            run = np.flatnonzero(known)[rows]
            here = np.flatnonzero((at >= time[run[0]] - 1e-9) & (at <= time[run[-1]] + 1e-9))
            if len(run) < 4 or len(here) == 0:
                continue
            stacked = np.stack([np.asarray(columns[name], dtype=np.float64)[run] for name in names], axis=1)
            even, start, step, stretched = _even(time[run], stacked, rate)
            uneven |= stretched
            if same_rate(rate_hz, rate):  # nothing is above the new band
                out = _through(time[run], stacked, at[here])
            else:
                out = _low_passed(even, start, step, at[here], rate_hz)
            for number, name in enumerate(names):
                values[name][here] = out[:, number]
    return Resampled(at, values, rate, uneven)


def _even(time: FloatArray, values: FloatArray, rate: float) -> tuple[FloatArray, float, float, bool]:
    """Return values (M, k) on an even grid: unchanged where already on one, else by a spline.

    Returns values, first time and step of the grid, and whether they had to be interpolated.
    """
    number = np.arange(len(time))
    step, start = np.polyfit(number, time, 1)
    if float(np.max(np.abs(time - (start + step * number)))) * rate <= EVEN:
        return values, float(start), float(step), False
    count = max(4, round((time[-1] - time[0]) * rate) + 1)
    places = np.linspace(time[0], time[-1], count)
    return _through(time, values, places), float(time[0]), float(places[1] - places[0]), True


def _through(time: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Evaluate at ``at`` (N, k) a spline through values (M, k)."""
    degree = min(_DEGREE, (len(time) - 2) | 1)  # odd, and below the number of samples
    inside = np.clip(at, time[0], time[-1])
    # Takes longer to load than most recordings to read, and few clocks are uneven.
    from scipy.interpolate import make_interp_spline

    return np.asarray(make_interp_spline(time, values, k=degree)(inside), dtype=np.float64)


def _low_passed(values: FloatArray, start: float, step: float, at: FloatArray, rate_hz: float) -> FloatArray:
    """Low-pass an even series (M, k) at ``at`` (N, k); NaN where the filter reaches beyond the series."""
    rate = 1.0 / step
    nyquist = 0.5 * min(rate, rate_hz)
    transition = (1.0 - PASSBAND) * nyquist
    cut = nyquist - 0.5 * transition
    half = (ATTENUATION_DB - 7.95) / (2.0 * 2.285 * 2.0 * np.pi * transition)  # s, half of the kernel's length
    beta = 0.1102 * (ATTENUATION_DB - 8.7)
    reach = int(np.ceil(half * rate)) + 1
    offsets = np.arange(-reach, reach + 1)
    out = np.full((len(at), values.shape[1]), np.nan)
    centre = np.rint((at - start) * rate).astype(np.int64)
    inside = np.flatnonzero((centre - reach >= 0) & (centre + reach < len(values)))
    chunk = max(1, _MOST_VALUES // (len(offsets) * max(1, values.shape[1])))
    for first in range(0, len(inside), chunk):
        rows = inside[first : first + chunk]
        index = centre[rows, None] + offsets
        lag = at[rows, None] - (start + step * index)
        window = np.i0(beta * np.sqrt(np.clip(1.0 - (lag / half) ** 2, 0.0, None))) / np.i0(beta)
        weights = np.where(np.abs(lag) < half, np.sinc(2.0 * cut * lag) * window, 0.0)
        weights /= weights.sum(axis=1, keepdims=True)  # a constant stays what it is
        out[rows] = np.einsum("ij,ijk->ik", weights, values[index])
    return out
