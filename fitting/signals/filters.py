"""Zero-phase filters and derivatives.

Everything that enters a regression goes through two symmetric FIR filters, so nothing is delayed:

1. the *trajectory filter* smooths positions and, convolved with central differences of high order, gives their
   derivatives. It is flat over the identification band, so the smoothed motion is the motion there;
2. the *identification filter* is applied alike to the measured effort and to every regressor column ("parallel
   filtering": a linear relation between unfiltered signals remains the same relation between filtered ones), and
   its output is decimated to a rate just above twice its stop band.

Only the part of a convolution where the kernel fits wholly inside the data is kept: no made-up samples at the ends.

Last are filters of what is held between samples, as commands are: later, through a spring, a mass and a damper, and as
rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from daq.errors import InputError
from fitting.arrays import FloatArray

_BLOCK_ROWS = 16
_KAISER_BETA = 8.0  # side lobes 80 dB down
# Central differences of eighth order (Fornberg 1988): relative error (omega T)^8 / 630, below 1e-4 up to a tenth of
# the rate.
_FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


def advanced(values: FloatArray, samples: float) -> FloatArray:
    """Advance a signal (``out[k] = values[k + samples]``) by windowed-sinc interpolation; ends held."""
    if samples == 0.0:
        return values
    whole = int(np.floor(samples))
    fraction = samples - whole
    taps = np.arange(-12, 13)
    kernel = np.sinc(taps - fraction) * np.kaiser(2 * 12 + 1, 6.0)
    kernel /= kernel.sum()
    index = np.clip(np.arange(len(values))[:, None] + whole + taps[None, :], 0, len(values) - 1)
    return np.asarray(values[index] @ kernel)


@dataclass(frozen=True)
class FilterBank:
    """The filters of one identification.

    Attributes
    ----------
    rate_hz : sampling rate of the recordings
    bandwidth_hz : cut-off (-6 dB) of the identification filter
    decimation : every so many-th filtered sample is kept
    value, first, second : kernels of the trajectory filter and its derivatives, all of length ``2 margin + 1``
    identification : kernel of the identification filter, length ``2 half + 1``
    """

    rate_hz: float
    bandwidth_hz: float
    decimation: int
    value: FloatArray
    first: FloatArray
    second: FloatArray
    identification: FloatArray

    @property
    def margin(self) -> int:
        """Samples lost at each end by the trajectory filter."""
        return len(self.value) // 2

    @property
    def half(self) -> int:
        """Samples lost at each end by the identification filter."""
        return len(self.identification) // 2

    @property
    def reduced_rate_hz(self) -> float:
        """Rate after decimation."""
        return self.rate_hz / self.decimation

    def smooth(self, values: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Smooth values and their first two time derivatives; ``2 margin`` samples shorter."""
        values = np.asarray(values, dtype=float)
        # Derivatives of (values - start) are the same and keep more digits.
        centred = values - values[0]
        zeroth, first, second = (np.convolve(centred, k, "valid") for k in (self.value, self.first, self.second))
        return zeroth + values[0], first, second

    def smoothed(self, values: npt.ArrayLike) -> FloatArray:
        """Return the smoothed values of :meth:`smooth` alone."""
        values = np.asarray(values, dtype=float)
        return np.asarray(np.convolve(values - values[0], self.value, "valid") + values[0])

    def trimmed(self, values: npt.ArrayLike) -> FloatArray:
        """Return the unfiltered samples beside the output of :meth:`smooth`."""
        values = np.asarray(values, dtype=float)
        return values[self.margin : len(values) - self.margin]

    def rate(self, values: npt.ArrayLike) -> FloatArray:
        """Differentiate an already smooth signal by central differences (same length; ends one-sided)."""
        values = np.asarray(values, dtype=float)
        out = np.gradient(values, 1.0 / self.rate_hz, axis=0)
        if len(values) >= len(_FIRST):
            out[4 : len(values) - 4] = np.convolve(values, _FIRST[::-1] * self.rate_hz, "valid")
        return np.asarray(out)

    def reduce(self, columns: npt.ArrayLike) -> FloatArray:
        """Filter columns (N,) or (N, k) with the identification filter and decimate; shape (M,) or (M, k)."""
        columns = np.asarray(columns, dtype=float)
        length = len(columns) - 2 * self.half
        if length <= 0:
            return np.zeros((0, *columns.shape[1:]))
        rows = -(-length // self.decimation)
        flat = columns.reshape(len(columns), -1)
        # Blocks of outputs share one banded matrix, so the whole filter is a few matrix products.
        out = np.empty((rows, flat.shape[1]))
        band = self._band
        for start in range(0, rows, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, rows - start)
            first = start * self.decimation
            width = (count - 1) * self.decimation + len(self.identification)
            np.matmul(band[:count, :width], flat[first : first + width], out=out[start : start + count])
        return out.reshape(rows, *columns.shape[1:])

    @cached_property
    def _band(self) -> FloatArray:
        """Rows of the decimating filter for one block of outputs, (block, inputs)."""
        taps = len(self.identification)
        band = np.zeros((_BLOCK_ROWS, (_BLOCK_ROWS - 1) * self.decimation + taps))
        for row in range(_BLOCK_ROWS):
            band[row, row * self.decimation : row * self.decimation + taps] = self.identification[::-1]
        return band

    def rows(self, samples: int) -> int:
        """Count the reduced rows of a segment of ``samples`` smoothed samples."""
        length = samples - 2 * self.half
        return max(0, -(-length // self.decimation))

    def speed_noise(self, position_std: float) -> float:
        """Compute a smoothed speed's standard deviation from white position noise ``position_std``."""
        return position_std * float(np.linalg.norm(self.first))

    def acceleration_noise(self, position_std: float) -> float:
        """Compute a smoothed acceleration's standard deviation from white position noise ``position_std``."""
        return position_std * float(np.linalg.norm(self.second))


def _low_pass(half: int, cutoff: float) -> FloatArray:
    """Return a windowed sinc (2 half + 1,) of gain 1 at rest; ``cutoff`` of the rate, at half the gain.

    It is :func:`scipy.signal.firwin`'s, without the half second that importing ``scipy.signal`` takes.
    """
    taps = np.arange(-half, half + 1)
    kernel = np.sinc(2.0 * cutoff * taps) * np.kaiser(len(taps), _KAISER_BETA)
    return np.asarray(kernel / kernel.sum())


def filter_bank(rate_hz: float, bandwidth_hz: float) -> FilterBank:
    """Design the filters for a bandwidth.

    The identification filter is down by 6 dB at ``bandwidth_hz``, by 60 dB at 1.4 times and by 80 dB at 1.5 times that;
    the trajectory filter is flat to 1e-3 up to ``bandwidth_hz``.

    Raises
    ------
    ValueError
        If the bandwidth is not below a fifth of the rate.
    """
    if not 0 < bandwidth_hz <= rate_hz / 5:
        raise ValueError(f"bandwidth {bandwidth_hz:g} Hz must be above 0 and at most a fifth of {rate_hz:g} Hz")
    half = max(4, round(3.0 * rate_hz / bandwidth_hz))
    margin = max(4, round(1.8 * rate_hz / bandwidth_hz))
    smooth_cutoff = min(bandwidth_hz * 5 / 3, 0.45 * rate_hz)
    value = _low_pass(margin, smooth_cutoff / rate_hz)
    # The kernel is extended by the four samples a central difference reaches on each side.
    wide = np.pad(value, 4)
    return FilterBank(
        rate_hz=rate_hz,
        bandwidth_hz=bandwidth_hz,
        decimation=max(1, int(rate_hz / (2.75 * bandwidth_hz))),
        value=wide,
        first=np.convolve(value, _FIRST[::-1]) * rate_hz,
        second=np.convolve(value, _SECOND) * rate_hz**2,
        identification=_low_pass(half, bandwidth_hz / rate_hz),
    )


def asked_filter_bank(rate_hz: float, bandwidth_hz: float, longest_s: float) -> FilterBank:
    """Design the filters for a requested bandwidth.

    Parameters
    ----------
    longest_s : duration of the longest recording; half of the identification filter is three periods of the bandwidth

    Raises
    ------
    InputError
        If the rate or the recordings do not allow it.
    """
    if not 6.0 / longest_s <= bandwidth_hz <= rate_hz / 5:
        raise InputError(
            "fitting.bandwidth_outside", bandwidth_hz=bandwidth_hz, longest_s=6.0 / longest_s, rate_hz=rate_hz / 5
        )
    return filter_bank(rate_hz, float(bandwidth_hz))


def recursive(b: Any, a: Any, values: Any, start: Sequence[Any] | None = None) -> Any:
    """Filter a signal (N,) rationally, ``b(z) / a(z)``: by scipy of numbers, and the same of anything additive.

    Parameters
    ----------
    b, a : coefficients of falling powers of ``z``, as many of one as of the other for what is no number
    start : state (direct form II transposed) before the first sample; zeros if None
    """
    if np.asarray(values).dtype != object:
        return scipy.signal.lfilter(b, a, values) if start is None else scipy.signal.lfilter(b, a, values, zi=start)[0]
    state, out = list(start or [0.0] * (len(a) - 1)), []
    for value in values:
        out.append(b[0] / a[0] * value + state[0])
        sums = zip([*state[1:], 0.0], b[1:], a[1:], strict=True)
        state = [kept + own / a[0] * value - back / a[0] * out[-1] for kept, own, back in sums]
    return np.array(out, dtype=object)


def white_noise_of(stretches: Sequence[npt.ArrayLike]) -> float:
    """Estimate the white part's standard deviation of a smooth signal between gaps, by fourth differences.

    Fourth differences of white noise have a variance of 70 times the noise's; of a motion below a fiftieth of the
    rate they keep less than 1e-4. Quantisation counts as noise of a third of a step or less.
    """
    differences = np.concatenate([np.zeros(0), *(np.diff(stretch, 4) for stretch in stretches)])
    return float(np.sqrt(np.mean(differences**2) / 70.0)) if len(differences) else 0.0


def white_noise_density(
    frequency: FloatArray, rate_hz: float, std: float, kernel: npt.ArrayLike = (1.0,)
) -> FloatArray:
    """Compute the power density at Hz of white noise of ``std`` behind a kernel: ``2 std^2 |K|^2 / rate``."""
    _, response = scipy.signal.freqz(np.asarray(kernel), worN=frequency, fs=rate_hz)
    return np.asarray(2.0 * std**2 * np.abs(response) ** 2 / rate_hz)


def edge_frequency(
    series: Sequence[FloatArray],
    rate_hz: float,
    share: float,
    white_std: float = 0.0,
    kernel: npt.ArrayLike = (1.0,),
) -> float:
    """Find the Hz below which ``share`` of the power of some stretches of a signal is; 0 of nothing.

    White noise of ``white_std`` that went through ``kernel`` is taken off: a noisy encoder would else pass for a fast
    motion. What only trembles has no such frequency (0).
    """
    found = [scipy.signal.periodogram(part, rate_hz, detrend="constant", window="hann") for part in series]
    frequency = np.concatenate([own for own, _ in found])
    # A density times the width of a line; a longer stretch counts for more.
    power = np.concatenate(
        [density * (len(part) / len(density)) for part, (_, density) in zip(series, found, strict=True)]
    )
    lengths = np.concatenate([np.full(len(d), len(p) / len(d)) for p, (_, d) in zip(series, found, strict=True)])
    noise = white_noise_density(frequency, rate_hz, white_std, kernel) * lengths
    order = np.argsort(frequency, kind="stable")
    total = np.cumsum((power - noise)[order])
    largest = float(total.max(initial=0.0))
    return float(frequency[order][np.argmax(total >= share * largest)]) if largest > noise.sum() else 0.0


def lag_between(first: npt.ArrayLike, second: npt.ArrayLike, most: int) -> int:
    """Find the samples to move ``second`` back onto ``first`` (both (N, k)), at most ``most`` either way.

    The lag with the smallest mean squared difference over the overlap.
    """
    a, b = np.atleast_2d(np.asarray(first, dtype=float).T), np.atleast_2d(np.asarray(second, dtype=float).T)
    scale = np.maximum(a.std(axis=1, keepdims=True), 1e-12)
    a, b = a / scale, b / scale
    best, best_cost = 0, np.inf
    for lag in range(-most, most + 1):
        left, right = a[:, max(0, -lag) :], b[:, max(0, lag) :]
        length = min(left.shape[1], right.shape[1])
        if length < 0.5 * min(a.shape[1], b.shape[1]):
            continue
        cost = float(np.mean((left[:, :length] - right[:, :length]) ** 2))
        if cost < best_cost:
            best, best_cost = lag, cost
    return best


#: Of a cycle, in each of which what follows is at its mean: what crosses an edge within a cycle is beyond it for a
#: part of it, which its mean over the cycle does not know.
PARTS = 4


def followed(parts: Sequence[slice], u: FloatArray, samples: float, damping: float) -> FloatArray:
    """Follow a command held between samples (N,) with a spool: means over parts of each cycle (PARTS, N).

    A spring, a mass and a damper, ``samples`` late on the average; before a stretch it was at rest.
    """
    late = max(samples, 1e-3)
    split = np.sqrt(complex(damping**2 - 1.0, 1e-9))  # two poles, nearly one where it is critically damped
    one, other = (-2.0 * damping / late * (damping + own) for own in (split, -split))
    time = np.arange(3 * PARTS + 1) / PARTS
    gone = other / one * np.exp(one * time) - one / other * np.exp(other * time)
    ramp = time - late + (gone / (one - other)).real
    steps = PARTS * np.diff(ramp).reshape(3, PARTS)  # the answer to a step; it goes on with the two poles
    poles = np.poly(np.exp([one, other])).real
    zeros = np.array([np.convolve(taps, poles)[:3] for taps in np.diff(steps, axis=0, prepend=0.0).T])
    out = np.empty((PARTS, len(u)))
    for part in parts:
        first = u[part][0]
        slow = np.append(np.zeros(2), recursive(np.eye(3)[0], poles, u[part] - first))
        out[:, part] = first + zeros @ np.stack([slow[2:], slow[1:-1], slow[:-2]])
    return out


def delayed(parts: Sequence[slice], u: FloatArray, samples: float) -> FloatArray:
    """Delay what is held between samples (N,) by ``samples``; values are means of a cycle around.

    Before the first of a stretch it was the first.
    """
    whole = int(np.floor(samples + 0.5))
    fraction = samples + 0.5 - whole
    out = np.empty(len(u))
    for part in parts:
        own, late = u[part], out[part]
        known = max(len(own) - whole - 1, 0)
        late[: len(own) - known] = own[0]
        late[len(own) - known :] = (1.0 - fraction) * own[1 : known + 1] + fraction * own[:known]
    return out


def lagged(u: FloatArray, y: FloatArray, poles: int, zeros: int) -> FloatArray:
    """Return columns ``y_(k-1..poles)``, ``u_(k..k-zeros+1)`` of rows from ``max(poles, zeros - 1)`` on."""
    first = max(poles, zeros - 1)
    past = [y[first - lag : len(y) - lag] for lag in range(1, poles + 1)]
    return np.column_stack([*past, *(u[first - lag : len(u) - lag] for lag in range(zeros))])
