"""Instruments for stage 2: the regressor along a motion that does not have the sensors' noise in it.

Closed-loop simulation, the usual source of instruments (Janot, Vandanjon and Gautier 2014), needs the arm's controller
and its reference; neither is in a recording. But a controller that tracks well makes the simulated motion the
reference, and the reference is a slow motion: so the instruments are columns along the recorded motion smoothed down to
the motion's own bandwidth. The noise of an acceleration grows with the square of the frequency, so of its variance in
the identification band (five times as wide) less than a thousandth is left, while the motion itself stays. Columns
depend on motion alone (stage 2 has friction frozen), so nothing of the fitted model is needed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import signal

from fitting.arm.base_parameters import base_regressor
from fitting.regression.design import Design
from fitting.signals.filters import FilterBank, filter_bank

FloatArray = npt.NDArray[np.float64]

#: Share of the speed's power below the motion's bandwidth.
_POWER = 0.99


def motion_bandwidth(design: Design, indices: Sequence[int]) -> float:
    """Frequency in Hz below which 99 % of the fastest drive's speed is, the sensors' noise taken off.

    White noise ``sigma`` of a position has the speed density ``2 sigma^2 (2 pi f)^2 |H|^2 / rate``, ``H`` the
    trajectory filter; it is subtracted before the power is summed, else a noisy encoder passes for a fast motion.
    """
    rate = design.bank.rate_hz
    highest = 0.0
    for index in indices:
        segment = design.segments[index]
        for joint, noise in enumerate(design.noise):
            frequency, power = signal.periodogram(segment.v[:, joint], rate, detrend="constant", window="hann")
            _, response = signal.freqz(design.bank.value, worN=frequency, fs=rate)
            density = 2.0 * (noise.position * 2.0 * np.pi * frequency * np.abs(response)) ** 2 / rate
            total = np.cumsum(power - density)
            if total.max() > 0:
                highest = max(highest, float(frequency[np.argmax(total >= _POWER * total.max())]))
    return highest


def slow_motion(position: FloatArray, bank: FilterBank) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position (N, n) and its two derivatives through a bank's trajectory filter, all (N, n).

    Ends are continued by reflection at the end point (odd), so that speed goes on.

    Raises
    ------
    ValueError
        If there are not more samples than the filter's margin.
    """
    if len(position) <= bank.margin:
        raise ValueError(f"{len(position)} samples are too few to smooth over {bank.margin}")
    before, after = position[1 : bank.margin + 1][::-1], position[-bank.margin - 1 : -1][::-1]
    wide = np.concatenate([2 * position[0] - before, position, 2 * position[-1] - after])
    moved = [bank.smooth(column) for column in wide.T]
    q, qd, qdd = (np.stack([m[k] for m in moved], axis=1) for k in range(3))
    return q, qd, qdd


def instrument_columns(design: Design, indices: Sequence[int]) -> dict[int, FloatArray]:
    """Per segment the base columns in joint effort along its smoothed motion, (N, n, nb) at full rate.

    Segments too short to smooth that hard keep their own columns.
    """
    rate, base = design.bank.rate_hz, design.parameters.base
    bandwidth = motion_bandwidth(design, indices)
    bank = filter_bank(rate, min(max(bandwidth, 0.02), design.bank.bandwidth_hz))
    columns = {}
    for index in indices:
        segment = design.segments[index]
        motion = (segment.q, segment.qd, segment.qdd)
        if len(segment) > bank.margin:
            motion = slow_motion(segment.q, bank)
        columns[index] = base_regressor(design.machine, base, *motion)
    return columns
