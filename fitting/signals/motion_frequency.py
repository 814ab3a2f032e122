"""How fast a machine moves: what its identification bandwidth is chosen by."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import runs
from fitting.arrays import FloatArray
from fitting.signals.filters import edge_frequency, filter_bank
from fitting.signals.lost_rows import filled, short_gaps
from fitting.signals.position_sensors import channel_noise, position_channel
from fitting.signals.preparation import PIECE_SAMPLES, pieces, reach

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
