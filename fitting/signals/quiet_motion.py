"""Motion without most of its sensors' noise, for what needs more derivatives than a regression on acceleration does.

A compliance answers to the acceleration of a torque that holds accelerations itself: the fourth derivative of a
measured position, in which the sensor's noise is as large as the motion although it is nowhere to be seen in the
position. The regressor then holds the noise of the residual that it is to explain, its coefficient is drawn towards
zero or below it, and a compliance that is there is not found.

So such a regressor is built from what can be told of the motion: each joint's acceleration is kept up to the frequency
where its spectrum falls to ten times the known spectrum of its noise, and cut above that. What is cut is lost to the
regressor but not false in it: the coefficient stays what it is (regression calibration).

Source: R. J. Carroll and others, Measurement Error in Nonlinear Models, 2006, chapter 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy import signal

from fitting.arrays import FloatArray
from fitting.signals.filters import FilterBank, white_noise_density
from fitting.signals.preparation import PositionNoise, Segment

#: Signal and noise over noise from which a line of the spectrum counts for the motion.
_PROMINENT = 10.0
#: Order of the cut, and the edge's share at which it is half way down: a line at the edge keeps 82 % of itself.
_ORDER, _ROOM = 8, 1.1


def quiet_motion(
    segment: Segment, noise: Sequence[PositionNoise], bank: FilterBank
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Estimate positions, speeds and accelerations (N, n) of a segment's joints, as far as above noise."""
    q, qd, qdd = segment.q.copy(), segment.qd.copy(), segment.qdd.copy()
    for joint, known in enumerate(noise):
        std = known.position / max(float(np.median(np.abs(segment.r[:, joint]))), 1e-12)
        edge = motion_edge(qdd[:, joint], std, bank)
        if edge >= bank.bandwidth_hz:
            continue
        if edge * len(q) < bank.rate_hz:  # less than one period of it: no motion
            q[:, joint], qd[:, joint], qdd[:, joint] = q[:, joint].mean(), 0.0, 0.0
            continue
        motion = np.stack([values[:, joint] for values in (q, qd, qdd)])
        q[:, joint], qd[:, joint], qdd[:, joint] = signal.sosfiltfilt(_low_pass(edge, bank.rate_hz), motion)
    return q, qd, qdd


@lru_cache(maxsize=256)
def _low_pass(edge: float, rate_hz: float) -> FloatArray:
    """Design the cut at an edge, a line of a spectrum: the same one for all that hold the same motion."""
    return np.asarray(signal.butter(_ORDER, _ROOM * edge, fs=rate_hz, output="sos"))


def motion_edge(acceleration: FloatArray, position_std: float, bank: FilterBank) -> float:
    """Find the Hz above which an acceleration (N,) holds more noise than motion; 0 if none at all.

    The noise is that of white positions of ``position_std`` behind the second derivative's kernel. The edge is where
    the sum of (spectrum over noise - 10) is largest: single lines that stand out by chance do not make up for the noise
    below them, and gaps between lines of the motion do not end it.
    """
    frequency, power = signal.periodogram(signal.detrend(acceleration), bank.rate_hz, window="hann")
    inside = (frequency > 0.0) & (frequency <= bank.bandwidth_hz)
    if position_std <= 0.0 or not inside.any():
        return bank.bandwidth_hz
    frequency, power = frequency[inside], power[inside]
    noise = white_noise_density(frequency, bank.rate_hz, position_std, bank.second)
    excess = np.cumsum(power / noise - _PROMINENT)
    return float(frequency[np.argmax(excess)]) if excess.max() > 0.0 else 0.0
