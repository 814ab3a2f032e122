"""Narrow spectral lines in a residual: a pump's ripple that no motion explains.

Lines are looked for in the raw residual at full rate, not in the filtered one: a ripple above the identification band
(or folded into it from above half the rate) does the fit no harm, but is worth naming. The steps, per joint:

1. *Background.* Each part is levelled to a flat spectrum by medians of neighbouring bins, and knocks are clipped
   (:mod:`fitting.residual.levelling`).
2. *Evidence.* At a frequency ``f`` the levelled powers of all parts are added, phases left free: ``z(f)``, a sum of
   ``R`` unit exponentials where there is no line. The chance that noise reaches it anywhere up to half the rate is
   the up-crossing rate of that process (Davies 1987, for ``R = 1`` Baluev's 2008 formula for periodograms),
   with the tail of an F distribution because the background itself is estimated.
3. *Refutation.* A line has to be there in every recording that would show it and with one frequency; narrow (power
   beside it means a resonance, or something of the motion); and no harmonic of the motion: where the motion's own
   signals have a line at that frequency, only the difference of two runs of one motion can vouch for it.

Sources: R. B. Davies, "Hypothesis testing when a nuisance parameter is present only under the alternative",
Biometrika 74, 1987; R. V. Baluev, "Assessing the statistical significance of periodogram peaks", MNRAS 385, 2008;
R. A. Fisher, "Tests of significance in harmonic analysis", Proc. R. Soc. A 125, 1929.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects import line_effect
from fitting.regression.design import Design
from fitting.regression.noise import Pairing
from fitting.residual.levelling import LEAST_SAMPLES, Level, Part, background_worth, levelled, residual_parts, sine_fit

#: Chance that a machine without lines is given one.
ALARM = 1e-3
#: Below this there are too few bins to know a background by.
LOWEST_HZ = 0.2
_LEAST_PERIODS = 6.0  # of a line in a part: fewer and it is a trend
_OVERSAMPLING = 4
_SIDE_BINS = (1, 2, 3)
_SIDE_P = 1e-4
_NEAR_BINS = (1.5, 12.0)  # either side of a line: where a resonance would raise the background as well
_SIDE_SHARE = 0.15  # of a line's own evidence that may be beside it: a real pump is not perfectly steady
_ABSENT_SHARE = 0.3  # of the median amplitude; a line this weak in one recording is not there
_ABSENT_Z = 4.0
_SUPPORT_P = 1e-3
#: Chance that recordings do not show a line that is as large in them as in the one that shows it best, below which it
#: is not there: a loaded arm is louder than a free cylinder.
_MISSES = 0.01
_MOTION_RATIO = 8.0  # motion power over its neighbours' median that makes a frequency one of the motion's
_MOTION_HALF = 12


@dataclass(frozen=True)
class Line:
    """A spectral line in the residual of one joint.

    Attributes
    ----------
    joint : number of the joint
    frequency_hz, frequency_std : its frequency between 0 and half the rate (where an aliased line shows), Hz
    amplitude, amplitude_std : of the sinusoid, root mean square over recordings, in the residual's unit
    z : sum over the parts of the power over the background; the mean without a line is the number of parts
    p : chance of such a line anywhere in this joint's noise
    phases : per recording the phase in ``sin(2 pi f t + phase)``, rad, t since the recording's start
    amplitudes : per recording the amplitude
    """

    joint: int
    frequency_hz: float
    frequency_std: float
    amplitude: float
    amplitude_std: float
    z: float
    p: float
    phases: Mapping[int, float]
    amplitudes: Mapping[int, float]

    @property
    def shape(self) -> dict[str, float]:
        """Shape of the effect `supply_ripple`: the frequency, and the phase in each recording."""
        return {"frequency": self.frequency_hz} | {f"phase_{r}": phase for r, phase in sorted(self.phases.items())}

    def on(self, parts: Sequence[Part]) -> Line:
        """Fit the line's phases and amplitudes on more recordings (`validate`), by least squares on their residual.

        A pump's phase is no property of the machine: what is compared with a new recording needs that recording's own.
        """
        more = line_phases(self.frequency_hz, parts)
        return replace(
            self,
            phases={**self.phases, **{r: phase for r, (_, phase) in more.items()}},
            amplitudes={**self.amplitudes, **{r: amplitude for r, (amplitude, _) in more.items()}},
        )


def is_ripple(machine: Machine, line: Line) -> bool:
    """Return whether a pump can make this line: only where oil acts on the joint."""
    return line_effect().applies(machine, line.joint)


def ripples(machine: Machine, lines: Sequence[Line], bandwidth_hz: float) -> list[Line]:
    """Return the lines that are named although nothing is added: a pump's, above the band."""
    return [line for line in lines if line.frequency_hz > bandwidth_hz and is_ripple(machine, line)]


@dataclass(frozen=True)
class RefutedLine:
    """A significant peak that is no line of its own, and why."""

    joint: int
    frequency_hz: float
    p: float
    reason: str


def machine_lines(
    design: Design,
    theta: FloatArray,
    indices: Sequence[int],
    pairs: Sequence[Pairing] = (),
) -> tuple[Line, ...]:
    """Find lines of all joints measured with a fit's residuals, most certain first; ``pairs`` repeat a motion."""
    joints, lines = len(design.machine.joints), list[Line]()
    for joint in range(joints):
        parts = residual_parts(design, theta, joint, indices, pairs)
        lines += find_lines(joint, parts, design.bank.rate_hz, joints=joints)[0]
    return tuple(sorted(lines, key=lambda line: (line.p, -line.z)))


def find_lines(
    joint: int,
    parts: Sequence[Part],
    rate_hz: float,
    *,
    joints: int = 1,
    alarm: float = ALARM,
    most: int = 4,
) -> tuple[tuple[Line, ...], tuple[RefutedLine, ...]]:
    """Find lines in one joint's residual, strongest first, and the peaks that were refuted.

    Parameters
    ----------
    joint : its number, for the result
    parts : stretches of its residual
    rate_hz : sampling rate
    joints : how many joints are looked at; the alarm rate is shared among them
    alarm : chance that all joints of a machine without lines get one
    most : at most so many lines
    """
    levels = [level for part in parts if (level := levelled(part, rate_hz)) is not None]
    if not levels:
        return (), ()
    longest = max(len(level.values) for level in levels)
    lowest = max(LOWEST_HZ, _LEAST_PERIODS * rate_hz / longest)
    nfft = scipy.fft.next_fast_len(_OVERSAMPLING * longest, real=True)
    grid = np.arange(nfft // 2 + 1) * rate_hz / nfft
    # At the ends sine and cosine are no longer independent of each other's mirror image.
    allowed = (grid >= lowest) & (grid <= 0.5 * rate_hz - 1.5 * rate_hz / longest)
    found: list[Line] = []
    refuted: list[RefutedLine] = []
    threshold = alarm / joints
    for _ in range(most + 6):
        power = sum((level.power(nfft) for level in levels), np.zeros(len(grid)))
        power[~allowed] = 0.0
        peak = int(np.argmax(power))
        if _chance(float(power[peak]), len(levels), grid[peak], rate_hz, longest) > threshold or len(found) >= most:
            break
        frequency, z = _refined(levels, float(grid[peak]), rate_hz / longest)
        p = _chance(z, len(levels), frequency, rate_hz, longest)
        cleaned = [level.without(frequency) for level in levels]
        near = _near(cleaned, frequency, rate_hz, nfft)
        # On a hump of the spectrum (a resonance) the line has to exceed the hump.
        p = max(p, _chance(z / max(1.0, near), len(levels), frequency, rate_hz, longest))
        reason = "it stands on a hump of the spectrum: a resonance" if p > threshold else ""
        reason = reason or _refutation(levels, cleaned, frequency, z, rate_hz)
        if reason:
            refuted.append(RefutedLine(joint, frequency, p, reason))
            # The hump below a refuted peak is not searched again.
            allowed &= np.abs(grid - frequency) > (_NEAR_BINS[1] if near > 2.0 else 4.0) * rate_hz / longest
        else:
            found.append(_line(joint, levels, frequency, z, p, rate_hz))
            levels = cleaned
            allowed &= np.abs(grid - frequency) > 1.0 * rate_hz / longest
    return tuple(found), tuple(refuted)


def line_phases(frequency_hz: float, parts: Sequence[Part]) -> dict[int, tuple[float, float]]:
    """Fit amplitude and phase of a known frequency per recording by least squares on the raw residual.

    A pump's phase is not a property of the machine: it starts anywhere in every recording. What is compared with a new
    recording therefore needs that recording's own phase.
    """
    result = {}
    for recording in sorted({part.recording for part in parts}):
        own = [part for part in parts if part.recording == recording]
        time = np.concatenate([part.time for part in own])
        residual = np.concatenate([part.residual - part.residual.mean() for part in own])
        a, b = sine_fit(time, residual, frequency_hz)
        result[recording] = (float(np.hypot(a, b)), float(np.arctan2(b, a)))
    return result


def _chance(z: float, parts: int, frequency: float, rate_hz: float, samples: int) -> float:
    """Compute the chance of noise reaching ``z`` up to half the rate: expected up-crossings with an estimated level."""
    if z <= parts:
        return 1.0
    m = parts * background_worth(frequency, rate_hz, samples)
    # sf of F(2 R, 2 m) at z / R
    tail = float(scipy.special.betainc(m, parts, m / (m + z)))
    # Bandwidth of the process: half the rate times the rms length of a part.
    bandwidth = 0.5 * samples * np.sqrt(4 * np.pi / 12)
    return float(min(1.0, tail * (1.0 + bandwidth * np.sqrt(z))))


def _near(cleaned: Sequence[Level], frequency: float, rate_hz: float, nfft: int) -> float:
    """Estimate the mean level beside a removed line by the median over ten bins on both sides; 1 if it is flat."""
    total = []
    for level in cleaned:
        power, bins = level.power(nfft), len(level.values) / nfft
        away = np.abs(np.arange(len(power)) * bins - frequency * len(level.values) / rate_hz)
        beside = power[(away >= _NEAR_BINS[0]) & (away <= _NEAR_BINS[1])]
        total.append(float(np.median(beside)) / np.log(2.0))
    return float(np.mean(total))


def _refined(levels: Sequence[Level], frequency: float, resolution: float) -> tuple[float, float]:
    """Find the frequency of greatest evidence near ``frequency`` by golden section in half a bin."""
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    low, high = frequency - 0.3 * resolution, frequency + 0.3 * resolution

    def total(f: float) -> float:
        return sum(level.evidence(f) for level in levels)

    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = total(a), total(b)
    while high - low > 1e-4 * resolution:
        if at_a > at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = total(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = total(b)
    best = 0.5 * (low + high)
    return best, total(best)


def _refutation(levels: Sequence[Level], cleaned: Sequence[Level], frequency: float, z: float, rate_hz: float) -> str:
    """Return why a significant peak is no line of its own; empty without objection."""
    own = np.array([level.evidence(frequency) for level in levels])
    amplitudes, stds = _amplitudes(levels, frequency)
    beside = 0.0
    for level in cleaned:
        step = rate_hz / len(level.values)
        beside += sum(level.evidence(frequency + sign * k * step) for k in _SIDE_BINS for sign in (-1.0, 1.0))
    count = 2 * len(_SIDE_BINS) * len(levels)
    if scipy.special.gammaincc(count, beside) < _SIDE_P and beside - count > _SIDE_SHARE * z:
        return "it is not narrow: there is power on both sides of it"
    if len(levels) > 1:
        # Without its strongest part it has to be seen in the others, if they could show it.
        strongest = int(np.argmax(own))
        others, expected = z - float(own[strongest]), 0.0
        for level in (*levels[:strongest], *levels[strongest + 1 :]):
            expected += 0.25 * len(level.values) * (amplitudes[strongest] / level.density(frequency)) ** 2
        unseen = scipy.special.gammaincc(len(levels) - 1, others) > _SUPPORT_P
        if unseen and scipy.stats.ncx2.cdf(2.0 * others, 2 * (len(levels) - 1), 2.0 * expected) < _MISSES:
            return "it is there in one recording only"
        for number, (level, amplitude, std) in enumerate(zip(levels, amplitudes, stds, strict=True)):
            usual, spread = _together(np.delete(amplitudes, number), np.delete(stds, number))
            if amplitude < _ABSENT_SHARE * usual and (1 - _ABSENT_SHARE) * usual > _ABSENT_Z * np.hypot(std, spread):
                return f"recording {level.part.recording} would have shown it and does not"
    moved = np.array([_of_the_motion(level.part, frequency, rate_hz) for level in levels])
    if np.mean(moved) >= 0.5 and not _vouched(levels, frequency):
        # Motions that do not have the frequency may show the line all the same.
        still = own[~moved]
        if not len(still) or scipy.special.gammaincc(len(still), float(still.sum())) > _SUPPORT_P:
            return "it is a frequency of the motion"
    return ""


def _of_the_motion(part: Part, frequency: float, rate_hz: float) -> bool:
    """Return whether a signal of the motion has a line of its own at this frequency."""
    n = len(part.time)
    centre = frequency * n / rate_hz
    near = np.arange(round(centre) - _MOTION_HALF, round(centre) + _MOTION_HALF + 1)
    near = near[(near > 0) & (near < n // 2)]
    if not part.signals.size or not len(near):
        return False
    # Hann's window, or what leaks from the strong low frequencies would hide every other line.
    window = np.hanning(n)[:, None]
    steps = np.arange(n)[:, None]
    signals = (part.signals - part.signals.mean(axis=0)) * window

    def power(bins: FloatArray) -> FloatArray:
        carrier = np.exp(-2j * np.pi * steps * bins[None, :] / n)
        return np.asarray(np.abs(signals.T @ carrier) ** 2)

    here = power(np.array([centre]))[:, 0]
    around = np.median(power(near.astype(float)), axis=1)
    return bool(np.any(here > _MOTION_RATIO * np.maximum(around, 1e-300)))


def _vouched(levels: Sequence[Level], frequency: float) -> bool:
    """Return whether the difference of two runs of one motion, free of the motion, has the line."""
    for number, first in enumerate(levels):
        for second in levels[number + 1 :]:
            if first.part.motion != second.part.motion or first.part.recording == second.part.recording:
                continue
            begin = max(first.part.start, second.part.start)
            end = min(first.part.start + len(first.values), second.part.start + len(second.values))
            if end - begin < LEAST_SAMPLES:
                continue
            a, b = (slice(begin - level.part.start, end - level.part.start) for level in (first, second))
            difference = (first.values[a] - second.values[b]) / np.sqrt(2.0)
            if replace(first, time=first.time[a], values=difference).evidence(frequency) > -np.log(_SUPPORT_P):
                return True
    return False


def _amplitudes(levels: Sequence[Level], frequency: float) -> tuple[FloatArray, FloatArray]:
    """Return a line's amplitude in each part, (P,), in raw units and with noise, and standard deviations."""
    sizes = [np.hypot(*sine_fit(level.time, level.values, frequency)) * level.density(frequency) for level in levels]
    return np.array(sizes), np.array([np.sqrt(2.0 / len(v.values)) * v.density(frequency) for v in levels])


def _together(amplitudes: FloatArray, stds: FloatArray) -> tuple[float, float]:
    """Return the root mean square of amplitudes (P,) without noise, and its standard deviation."""
    weights = 2.0 / stds**2
    # Noise adds 4 / weight to each squared amplitude (2 / weight to each of sine and cosine).
    mean = (weights @ np.square(amplitudes) - 4.0 * len(amplitudes)) / weights.sum()
    return float(np.sqrt(max(mean, 0.0))), float(np.sqrt(2.0 / weights.sum()))


def _line(joint: int, levels: Sequence[Level], frequency: float, z: float, p: float, rate_hz: float) -> Line:
    """Return the line's numbers in raw units; parts of one recording share a phase."""
    phases, amplitudes = {}, {}
    for recording in sorted({level.part.recording for level in levels}):
        own = [level for level in levels if level.part.recording == recording]
        time = np.concatenate([level.time for level in own])
        values = np.concatenate([level.values for level in own])
        gain = float(np.mean([level.density(frequency) for level in own]))
        a, b = sine_fit(time, values, frequency)
        phases[recording], amplitudes[recording] = float(np.arctan2(b, a)), float(np.hypot(a, b) * gain)
    seconds = np.array([len(level.values) / rate_hz for level in levels])
    information = 4 * np.pi**2 / 6.0 * float(seconds**2 @ [level.evidence(frequency) for level in levels])
    amplitude, amplitude_std = _together(*_amplitudes(levels, frequency))
    return Line(
        joint=joint,
        frequency_hz=frequency,
        frequency_std=float(1.0 / np.sqrt(max(information, 1e-300))),
        amplitude=amplitude,
        amplitude_std=amplitude_std,
        z=z,
        p=p,
        phases=phases,
        amplitudes=amplitudes,
    )
