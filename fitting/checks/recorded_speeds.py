"""A recorded speed against the change of the position beside it: neither knows anything of efforts.

Where both are recorded they agree to a few per cent, whatever the machine does. If they disagree by one factor at every
joint, the rows are not as far apart as the time column says; at one joint among others, that channel has another unit
or scale.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.arm.linkage import joint_position
from fitting.checks.findings import Finding, finding_of
from fitting.signals.filters import filter_bank
from fitting.signals.position_sensors import position_channel

#: Correlation from which a speed is that of the position; share that its size may be off; and that joints agree within.
_ALIKE, _OFF, _AGREE = 0.9, 0.1, 0.1
#: Of the rate, up to which both are compared.
_BAND = 0.125


def speed_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Findings on clocks and speed channels; ``recordings`` in SI at the machine's rate."""
    found: list[Finding] = []
    for recording in recordings:
        ratios = {
            joint.name: ratio
            for joint in machine.joints
            if (ratio := _ratio(machine, joint.name, recording)) is not None
        }
        off = {name: ratio for name, ratio in ratios.items() if abs(abs(ratio) - 1.0) > _OFF}
        if not off:
            continue
        middle = float(np.median(list(ratios.values())))
        if len(off) == len(ratios) and all(abs(ratio / middle - 1.0) < _AGREE for ratio in ratios.values()):
            found.append(_of_clock(recording, middle, len(ratios)))
            continue
        found += [_of_channel(machine, recording, name, ratio) for name, ratio in off.items()]
    return found


def _ratio(machine: Machine, name: str, recording: Recording) -> float | None:
    """Recorded speed of a joint over the change of its position, by least squares; None where they do not belong."""
    joint = machine.joint(name)
    speed = machine.channel("joint_velocity", name)
    place = position_channel(machine, joint)
    if speed is None or place is None or not {speed.name, place.name} <= set(recording.values):
        return None
    if recording.role == "unloaded" and joint.cylinder is not None:
        return None
    bank = filter_bank(recording.rate_hz, min(8.0, _BAND * recording.rate_hz))
    measured, derived = [], []
    for part in recording.segments([speed.name, place.name]):
        if part.stop - part.start > 4 * bank.margin:
            q = recording.values[place.name][part]
            q = joint_position(joint, q) if place.quantity == "piston_position" else q
            measured.append(bank.smoothed(recording.values[speed.name][part]))
            derived.append(bank.smooth(q)[1])
    if not measured:
        return None
    v, d = np.concatenate(measured), np.concatenate(derived)
    square = float(d @ d)
    if not square > 0 or abs(float(v @ d)) < _ALIKE * np.sqrt(square * float(v @ v)):
        return None
    return float(v @ d) / square


def _of_clock(recording: Recording, ratio: float, joints: int) -> Finding:
    alone = () if joints > 1 else ("the unit or scale of the speed channel",)
    return finding_of(
        "wrong_rate/speeds",
        times=abs(ratio),
        ms=1000.0 / (abs(ratio) * recording.rate_hz),
        expected_ms=1000.0 / recording.rate_hz,
        recording=recording.file,
        before=recording.rate_hz,
        after=abs(ratio) * recording.rate_hz,
        unit="Hz",
        factor=ratio,
        alternatives=alone,
        strength=9.0,
    )


def _of_channel(machine: Machine, recording: Recording, joint: str, ratio: float) -> Finding:
    channel = machine.channel("joint_velocity", joint)
    assert channel is not None
    return finding_of(
        "scale",
        ratio=ratio,
        joint=joint,
        channel=channel.name,
        recording=recording.file,
        factor=1.0 / ratio,
        strength=6.0,
    )
