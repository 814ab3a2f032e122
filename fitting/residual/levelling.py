"""A residual prepared for spectral lines: its parts, and each part with a flat background and no knocks.

A part's periodogram is levelled by medians over blocks of neighbouring bins, joined by straight lines in log-log: a
coloured noise becomes white, while a line in a block hardly moves its median. The levelled series is then clipped at
a few robust standard deviations, so that knocks do not count, and levelled once more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.regression.design import Design, Extra, full_residual
from fitting.regression.noise import Pairing
from fitting.residual.views import recording_starts

#: A part shorter than this has too few bins to know a background by.
LEAST_SAMPLES = 256
#: Longer stretches are cut: no pump keeps its phase for ever, and memory is bounded.
MOST_SAMPLES = 20_000
_BLOCK_SHARE = 0.25  # of a frequency: half-width of the block that its background is taken from
_LEAST_BLOCK, _MOST_BLOCK = 10, 60  # bins either side of the centre
_CLIP = 4.0
# Relative variance of a median of m exponentials is 1 / (m ln2^2); the same as that of a mean of this share of them.
_MEDIAN_EFFICIENCY = np.log(2.0) ** 2


@dataclass(frozen=True)
class Part:
    """One gap-free stretch of one joint's residual.

    Attributes
    ----------
    recording : which recording it is from
    time : (N,) s since the recording's first sample, evenly spaced
    residual : (N,) measured minus predicted effort at full rate, before any filter
    motion, start : parts with the same number repeat one motion; sample 0 is sample ``start`` of it
    signals : (N, k) signals that the motion is made of (positions, signs of speeds, their products); k may be 0
    """

    recording: int
    time: FloatArray
    residual: FloatArray
    motion: int
    start: int
    signals: FloatArray


@dataclass(frozen=True)
class Level:
    """A levelled part: background of unit density, knocks clipped.

    Attributes
    ----------
    part : where it comes from
    time, values : (N,) s since the recording's first sample, and levelled residual
    frequencies, gain : (N / 2,) Hz, and the raw amplitude there per levelled amplitude
    """

    part: Part
    time: FloatArray
    values: FloatArray
    gain: FloatArray
    frequencies: FloatArray

    def density(self, frequency: float) -> float:
        """Return the factor from levelled to raw amplitudes at a frequency."""
        return float(np.interp(frequency, self.frequencies, self.gain))

    def power(self, nfft: int) -> FloatArray:
        """Compute its periodogram (nfft / 2 + 1,), zero-padded: of noise, a unit exponential per bin."""
        return np.asarray(np.abs(scipy.fft.rfft(self.values, nfft)) ** 2 / len(self.values))

    def evidence(self, frequency: float) -> float:
        """Compute half the chi-square that a sinusoid takes off it."""
        S = _sinusoid(self.time, frequency)
        projected = S.T @ self.values
        return float(0.5 * projected @ np.linalg.solve(S.T @ S, projected))

    def without(self, frequency: float) -> Level:
        """Remove the sinusoid of this frequency."""
        fitted = sine_fit(self.time, self.values, frequency)
        return replace(self, values=self.values - _sinusoid(self.time, frequency) @ fitted)


def residual_parts(
    design: Design,
    theta: FloatArray,
    joint: int,
    indices: Sequence[int],
    pairs: Sequence[Pairing] = (),
    extra: Extra | None = None,
) -> tuple[Part, ...]:
    """Return a joint's residual in the given segments with their motions; ``pairs`` of them repeat a motion.

    ``theta`` are the parameters of the fit, those of its ``extra`` columns at the end.
    """
    repeats, begins = {pair.repeat: pair for pair in pairs}, recording_starts(design)
    parts = []
    for index in indices:
        segment = design.segments[index]
        pair = repeats.get(index)
        start = 0 if pair is None else pair.train_start - pair.repeat_start
        sign = np.sign(segment.v) * ~segment.rest
        signals = np.hstack([segment.x, sign, segment.x * sign, segment.v * sign])
        residual = full_residual(design, theta, joint, index, extra)
        pieces = max(1, -(-len(segment) // MOST_SAMPLES))
        for rows in np.array_split(np.arange(len(segment)), pieces):
            piece = slice(int(rows[0]), int(rows[-1]) + 1)
            parts.append(
                Part(
                    recording=segment.recording,
                    time=segment.t[piece] - begins[segment.recording],
                    residual=residual[piece],
                    motion=index if pair is None else pair.train,
                    start=start + piece.start,
                    signals=signals[piece],
                )
            )
    return tuple(parts)


def _background(power: FloatArray, bins: FloatArray) -> FloatArray:
    """Estimate the mean level of exponentially distributed powers by bin: medians of blocks joined in log-log."""
    last = len(bins) - 1
    centres, levels = [], []
    position = 0.0
    while position <= last:
        centre = round(position)
        half = int(np.clip(_BLOCK_SHARE * bins[centre], _LEAST_BLOCK, _MOST_BLOCK))
        low, high = max(0, centre - half), min(last + 1, centre + half + 1)
        block = power[low:high]
        centres.append(float(np.mean(np.log(bins[low:high]))))
        levels.append(float(np.log(max(np.median(block), 1e-300) / np.log(2.0))))
        position += half
    return np.exp(np.interp(np.log(bins), centres, levels))


def levelled(part: Part, rate_hz: float) -> Level | None:
    """Level the part to a flat spectrum of density 1 per bin, knocks clipped; None if too short or constant."""
    n = len(part.residual)
    if n < LEAST_SAMPLES:
        return None
    steps = np.arange(n) - 0.5 * (n - 1)
    values = part.residual - part.residual.mean()
    values = values - steps * (steps @ values) / (steps @ steps)
    bins = np.arange(1, n // 2 + 1, dtype=float)
    gain = np.ones(len(bins))
    for _ in range(2):
        spectrum = scipy.fft.rfft(values)
        power = np.abs(spectrum[1:]) ** 2 / n
        if not np.median(power) > 0:
            return None
        level = np.sqrt(_background(power, bins))
        spectrum[0] = 0.0
        spectrum[1:] /= level
        gain = gain * level
        values = scipy.fft.irfft(spectrum, n)
        spread = 1.4826 * float(np.median(np.abs(values)))
        values = np.clip(values, -_CLIP * spread, _CLIP * spread)
    return Level(part, part.time, values, gain, bins * rate_hz / n)


def background_worth(frequency: float, rate_hz: float, samples: int) -> float:
    """Return how many exponentials' mean the background at a frequency is worth."""
    half = np.clip(_BLOCK_SHARE * frequency * samples / rate_hz, _LEAST_BLOCK, _MOST_BLOCK)
    return float(_MEDIAN_EFFICIENCY * (2 * half + 1))


def _sinusoid(time: FloatArray, frequency: float) -> FloatArray:
    """Return sine and cosine, (N, 2)."""
    angle = 2 * np.pi * frequency * time
    return np.column_stack([np.sin(angle), np.cos(angle)])


def sine_fit(time: FloatArray, values: FloatArray, frequency: float) -> tuple[float, float]:
    """Fit ``a, b`` of ``a sin(2 pi f t) + b cos(2 pi f t)`` by least squares."""
    S = _sinusoid(time, frequency)
    a, b = np.linalg.solve(S.T @ S, S.T @ values)
    return float(a), float(b)
