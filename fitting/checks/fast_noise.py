"""Fast noise of position sensors against that of their kind, of their other stretches, and of their own resolution.

Noise of a position is no effect of the catalogue and bends nothing, but it drowns speeds and accelerations. What is
compared is the white part, by eighth differences: of a motion below a tenth of the rate they keep less than 2 %, so
that a fast joint does not pass for a noisy sensor. A sensor is accused by the median of its differences, and compared
with the root mean square of the others': single wrong values accuse nobody.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from daq.machine.machine_file import Channel, Machine
from daq.messages import Sentence
from daq.recordings.recording import Recording
from daq.recordings.recording_checks import runs
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, finding_of
from fitting.checks.motions import POSITIONS
from fitting.signals.position_sensors import held
from fitting.signals.preparation import reach

#: Noise over what it is compared with, and over the joint's reach, from which a sensor is accused.
_TIMES, _OF_REACH = 10.0, 2e-4
#: Order of the differences, and their spread over that of white noise (root of the sum of squared binomials).
_ORDER, _GAIN = 8, float(np.sqrt(12870.0))
_MEDIAN = 0.6745
#: Stretches of so many s, as many as this at least, and the share of them that has to be noisy, or quiet, together.
_STRETCH_S, _STRETCHES, _SHARE = 2.0, 5, 0.1


def noise_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Find position sensors ten times noisier than they have to be; ``recordings`` in SI."""
    found = []
    stretches = {c.name: _stretches(c, recordings) for c in machine.channels if c.quantity in POSITIONS}
    moving = {name: own for name, own in stretches.items() if len(own)}
    for channel in machine.channels:
        if channel.name not in moving:
            continue
        joint = machine.joint(str(channel.joint))
        least = _OF_REACH * reach(joint, channel.quantity == "piston_position")
        noise = float(np.median(moving[channel.name][:, 0]))
        sisters = [
            float(np.median(moving[c.name][:, 1]))
            for c in machine.channels
            if c.quantity == channel.quantity and c is not channel and c.name in moving
        ]
        conversion = machine.conversion(channel)
        own_step = abs(conversion.factor) * (channel.resolution or 0.0)
        excess: tuple[float, float, str] | None = None
        if noise > least and sisters and noise > _TIMES * (usual := float(np.median(sisters))) > 0:
            excess = (noise, usual, Sentence("fitting.other_sensors_kind"))
        elif noise > least and own_step and noise > _TIMES * own_step:
            excess = (noise, own_step, "its resolution")
        elif (apart := _apart(moving[channel.name], least)) is not None:
            excess = (*apart, Sentence("fitting.other_stretches"))
        if excess is not None:
            before, after, what = excess
            who: dict[str, Any] = {"joint": channel.joint, "channel": channel.name, "unit": machine.si_unit(channel)}
            times = before / after
            found.append(finding_of("noisy", times=times, what=what, before=before, after=after, strength=3.0, **who))
    return found


def _stretches(channel: Channel, recordings: Sequence[Recording]) -> FloatArray:
    """Compute a channel's noise (k, 2) where it moves, by stretch: by the median of its differences, and by all."""
    result = []
    for recording in recordings:
        values = recording.values.get(channel.name)
        if values is None:
            continue
        rows = round(_STRETCH_S * recording.rate_hz)
        there = np.isfinite(values) & ~held(values, recording.rate_hz)
        for run in runs(there, recording.joined):
            for start in range(run.start, run.stop - rows + 1, rows):
                differences = np.diff(values[start : start + rows], _ORDER)
                if len(differences):
                    size = np.abs(differences)
                    result.append((float(np.median(size)) / _MEDIAN, float(np.sqrt(np.mean(size**2)))))
    return np.array(result).reshape(-1, 2) / _GAIN


def _apart(noise: FloatArray, least: float) -> tuple[float, float] | None:
    """Return the noise of the noisy and of the quiet stretches, where there are enough of both."""
    count = max(2, round(_SHARE * len(noise)))
    if len(noise) < _STRETCHES:
        return None
    loud, quiet = float(np.sort(noise[:, 0])[-count]), float(np.sort(noise[:, 1])[count - 1])
    return (loud, quiet) if loud > least and loud > _TIMES * quiet > 0 else None
