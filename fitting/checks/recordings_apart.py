"""Recordings in which a joint's two sensors contradict each other while they agree in others.

Rods that are off where the role says they are on, rods that are on in an `unloaded` recording, a recording of another
machine: then nothing is wrong with the machine file, and that recording alone is left out. So are single seconds of
one, in which the rods are not where the role says.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from daq.errors import RecordingError
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.recordings.recording import Recording
from fitting.checks.findings import Finding, finding_of
from fitting.checks.mistakes.two_sensors import AGREE, NEAR, gap
from fitting.signals.rods import with_declared_rods


def recordings_apart(machine: Machine, recordings: Sequence[Recording]) -> tuple[list[Finding], list[Recording]]:
    """Find and leave out recordings in which the two sensors contradict each other while they agree in others."""
    both = [
        (k, angle.name, piston.name)
        for k, joint in enumerate(machine.joints)
        if joint.cylinder is not None
        and (angle := machine.channel("joint_position", joint.name)) is not None
        and (piston := machine.channel("piston_position", joint.name)) is not None
    ]
    found: list[Finding] = []
    kept: list[Recording] = []
    verdicts: list[tuple[Recording, int, int, int]] = []
    gaps: dict[str, list[tuple[int, float]]] = {}
    for recording in recordings:
        off = alone = seen = 0
        gaps[recording.file] = []
        for number, first, second in both:
            if first not in recording.values or second not in recording.values:
                continue
            q, x = recording.values[first], recording.values[second]
            known = np.isfinite(q) & np.isfinite(x)
            cylinder = machine.joints[number].cylinder
            assert cylinder is not None
            if np.count_nonzero(known) < 50 or np.ptp(x[known]) < 0.02 * cylinder.stroke:
                continue
            seen += 1
            misfit, away = gap(machine, number, q[known], x[known])
            gaps[recording.file].append((number, misfit))
            off += misfit > AGREE or abs(away) > NEAR
            follows = float(np.std(cylinder.linkage.piston_position(q[known])))
            alone += follows < 0.1 * float(np.std(x[known]))
        verdicts.append((recording, seen, off, alone))
    for recording, seen, off, alone in verdicts:
        other, wrong = 0, ""
        if recording.role == "unloaded":
            wrong = "wrong_role/rods_on" if seen and off == 0 and alone == 0 else ""
        elif seen and alone == seen and off:
            wrong = "wrong_role/rods_off"
        elif other := _alone_off(recording, recordings, gaps):
            wrong = "other_machine"
        if wrong:
            details: dict[str, Any] = {"other": other, "seen": seen, "before": off / max(seen, 1)}
            found.append(finding_of(wrong, recording=recording.file, strength=8.0, **details))
        else:
            kept.append(recording)
    return found, kept


def rods_for_a_time(machine: Machine, recordings: Sequence[Recording]) -> tuple[list[Finding], list[Recording]]:
    """Find recordings whose rods are not where the role says for a time, and leave out those rows.

    An identification leaves the same rows out. Recordings in which that is so all the time are
    :func:`recordings_apart`, and are returned as they are.
    """
    found: list[Finding] = []
    kept: list[Recording] = []
    for recording in recordings:
        try:
            (without,), lines = with_declared_rods(machine, [recording])
        except RecordingError:
            without, lines = recording, ()
        kept.append(without)
        cure = Sentence("fitting.identification_leaves_them_out")
        found += [Finding("rods", line, cure, recording=recording.file, severity="note") for line in lines]
    return found, kept


#: A joint's two sensors disagree in one recording only: by this share of the motion, and so many times the usual.
_ALONE_OFF, _TIMES = 0.03, 6.0


def _alone_off(recording: Recording, recordings: Sequence[Recording], gaps: dict[str, list[tuple[int, float]]]) -> int:
    """Count the joints in which a recording's two sensors disagree that agree in the others."""
    count = 0
    for number, misfit in gaps[recording.file]:
        others = [own for r in recordings if r is not recording and r.role != "unloaded"
                  for joint, own in gaps[r.file] if joint == number]  # fmt: skip
        if len(others) >= 2 and misfit > max(_ALONE_OFF, _TIMES * float(np.median(others))):
            count += 1
    return count
