"""Highest frequency of a motion, which the identification bandwidth is chosen by, and the motion without mere noise.

A compliance answers to the acceleration of a torque that holds accelerations itself: the fourth derivative of a
measured position, in which the sensor's noise is as large as the motion although it is nowhere to be seen in the
position. The regressor then holds the noise of the residual that it is to explain, its coefficient is drawn towards
zero or below it, and a compliance that is there is not found.

So such a regressor is built from what is known of the motion: each joint's acceleration is kept up to the frequency
where its spectrum falls to ten times the known spectrum of its noise, and cut above that. What is cut is lost to the
regressor but not false in it: the coefficient is unchanged (regression calibration).

Source: R. J. Carroll and others, Measurement Error in Nonlinear Models, 2006, chapter 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import scipy

from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import runs
from fitting.arrays import FloatArray
from fitting.signals.filters import FilterBank, edge_frequency, filter_bank, white_noise_density
from fitting.signals.lost_rows import filled, short_gaps
from fitting.signals.position_sensors import channel_noise, position_channel
from fitting.signals.preparation import PIECE_SAMPLES, PositionNoise, Segment, pieces, reach

#: Share of a motion's power that counts; what is beyond it is no motion.
SHARE = 0.99
#: Speed, of a joint's range and of that of the joint that moves most of its range, below which one only trembles.
TREMBLES = 0.01
#: s; shorter gaps are bridged: what is looked for is how fast a whole motion is, not each stretch of it.
_BRIDGED_S = 1.0


def motion_frequency(machine: Machine, recordings: Sequence[Recording], in_pieces: bool) -> float:
    """Find the Hz below which :data:`SHARE` of the fastest joint's speed is; 0 of nothing.

    All stretches of a recording count together: one of seconds holds less than a period, and passes for a fast one.

    The sensors' noise is taken off. A joint that is held while others move trembles with them, at their structure's
    frequencies: it counts where it has a hundredth of the power that it has in its liveliest recording.

    Parameters
    ----------
    recordings : those in the role ``unloaded`` do not count
    in_pieces : smooth one piece after another, in little memory
    """
    smooth = filter_bank(machine.rate_hz, min(8.0, machine.rate_hz / 8))

    def parts_of(name: str) -> Iterator[tuple[list[FloatArray], float]]:
        for recording in recordings:
            if recording.role == "unloaded":
                continue
            values = recording.values[name]
            noise = channel_noise(recording, name)
            short = short_gaps(~np.isfinite(values), recording.joined, round(_BRIDGED_S * machine.rate_hz))
            values = filled(values, short, closely=True)
            stretches = runs(np.isfinite(values), recording.joined)
            parts = [values[part] for part in stretches if part.stop - part.start >= 4 * smooth.margin]
            if parts:
                yield parts, noise

    found: list[tuple[FloatArray, FloatArray]] = []
    for joint in machine.joints:
        channel = position_channel(machine, joint)
        assert channel is not None
        edges, powers = [], []
        for parts, noise in parts_of(channel.name):
            speeds = []
            for part in parts:
                cut = pieces(slice(0, len(part)), smooth, PIECE_SAMPLES) if in_pieces else [slice(0, len(part))]
                speeds += [smooth.smooth(part[piece])[1] for piece in cut]
            edges.append(edge_frequency(speeds, machine.rate_hz, SHARE, noise, smooth.first))
            powers.append(
                float(np.mean(np.concatenate(speeds) ** 2)) / reach(joint, channel.quantity == "piston_position") ** 2
            )
        found.append((np.array(edges), np.array(powers)))
    liveliest = max((float(powers.max(initial=0.0)) for _, powers in found), default=0.0)
    counted = [
        edges[(powers >= (1 - SHARE) * powers.max(initial=0.0)) & (powers >= TREMBLES**2 * liveliest)]
        for edges, powers in found
    ]
    return float(max((own.max(initial=0.0) for own in counted), default=0.0))


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
        q[:, joint], qd[:, joint], qdd[:, joint] = scipy.signal.sosfiltfilt(_low_pass(edge, bank.rate_hz), motion)
    return q, qd, qdd


@lru_cache(maxsize=256)
def _low_pass(edge: float, rate_hz: float) -> FloatArray:
    """Design the cut at an edge, a line of a spectrum: the same one for all that hold the same motion."""
    return np.asarray(scipy.signal.butter(_ORDER, _ROOM * edge, fs=rate_hz, output="sos"))


def motion_edge(acceleration: FloatArray, position_std: float, bank: FilterBank) -> float:
    """Find the Hz above which an acceleration (N,) holds more noise than motion; 0 if none at all.

    The noise is that of white positions of ``position_std`` behind the second derivative's kernel. The edge is where
    the sum of (spectrum over noise - 10) is largest: single lines that exceed it by chance do not make up for the noise
    below them, and gaps between lines of the motion do not end it.
    """
    frequency, power = scipy.signal.periodogram(scipy.signal.detrend(acceleration), bank.rate_hz, window="hann")
    inside = (frequency > 0.0) & (frequency <= bank.bandwidth_hz)
    if position_std <= 0.0 or not inside.any():
        return bank.bandwidth_hz
    frequency, power = frequency[inside], power[inside]
    noise = white_noise_density(frequency, bank.rate_hz, position_std, bank.second)
    excess = np.cumsum(power / noise - _PROMINENT)
    return float(frequency[np.argmax(excess)]) if excess.max() > 0.0 else 0.0
