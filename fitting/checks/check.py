"""All checks in their order, and of what they find the root.

First a channel or the clock alone, then numbers that cannot be, then recordings against one another, then the two
sensors of a joint, and last the efforts. What an earlier step finds is taken back (or its recording left out)
before the next one looks, so that a wrong unit is not reported a second time as a strange mass.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from daq.errors import HilfitError
from daq.machine.machine_file import Machine
from daq.messages import Sentence, named
from daq.recordings.column_map import ColumnMap
from daq.recordings.recording import Recording
from fitting.arm.joint_side import at_joints
from fitting.arm.linkage import cylinder_of
from fitting.checks.findings import Finding, Places, filled, finding_of, left_open, says_line
from fitting.checks.magnitudes import machine_findings, magnitude_findings
from fitting.checks.mistakes.channel_trials import late
from fitting.checks.mistakes.estimates import AreaRatio, Clock, area_ratios, clock_of, inertia_findings
from fitting.checks.mistakes.hypothesis import CLEAR, gains
from fitting.checks.mistakes.physical import Trial
from fitting.checks.mistakes.samples import positions_of, take_samples
from fitting.checks.mistakes.trials import Accused, Searched, search, with_couplings, with_payload
from fitting.checks.mistakes.two_sensors import Disagreement, disagreements, recordings_apart, rods_for_a_time
from fitting.checks.motions import beginning_findings, motion_findings
from fitting.checks.reading import read_leniently
from fitting.checks.signal_faults import noise_findings, signal_findings
from fitting.checks.time_axis import repeated_findings, speed_findings
from fitting.progress import Progress, quiet
from fitting.signals.lost_rows import bridged, with_lost_rows

_log = logging.getLogger(__name__)

#: Share of a joint's effort that is unexplained from which it is reported without a cause. Measured joints with little
#: effort of their own (wrists) have as much, so the joint has to carry this share of the arm's largest effort as well.
GROSS, _CARRIES, _MOST_JOINTS = 0.55, 0.1, 0.5
#: A misfit up to this many times another one explains as much.
_AS_WELL = 1.2
#: s; gaps up to this are bridged before recordings are compared with anything.
_BRIDGED_S = 0.1
#: Findings of a recording's own file that make its values useless for what follows.
_SPOILS = (
    "time_jump", "saturated", "outliers", "dropouts", "wrap", "jump", "frozen", "clipped", "held", "same_channel",
    "coarse",
)  # fmt: skip
#: What a refusal of the strict reader is a consequence of.
_CONSEQUENCES = {
    "saturated": ("clipped", "dropouts", "frozen", "unit", "held", "same_channel"),
    "constant": ("frozen", "dropouts", "wrong_role", "parked", "unit"),
    "positions_disagree": (
        "unit", "sign", "linkage", "exchanged_channels", "wrong_role", "other_machine", "wrap", "jump",
    ),
    "clipped": ("no_pressure",),
    "too_short": ("lost_rows", "time_jump", "time_unit", "wrong_rate"),
    "out_of_range": ("sign", "unit", "wrap", "exchanged_channels", "outliers", "jump"),
    "columns": ("other_machine",),
    "no_repeat": (
        "dropouts", "jump", "wrap", "outliers", "frozen", "wrong_rate", "time_unit", "time_jump", "other_machine",
        "wrong_role",
    ),
    "frozen": ("held",),
    "noisy": ("unit", "scale", "outliers", "dropouts", "jump", "wrap", "held", "coarse", "frozen"),
    "same_motion": ("same_recording",),
}  # fmt: skip


def check_files(
    machine: Machine,
    files: Sequence[tuple[str, Path]],
    machine_file: Path | None = None,
    *,
    columns: ColumnMap | None = None,
    resample: bool = False,
    progress: Progress = quiet,
) -> tuple[Finding, ...]:
    """Check recordings on disk, as far as they can be read.

    Parameters
    ----------
    files : (role, path)
    machine_file : where lines are looked up
    columns, resample : as in :func:`fitting.checks.reading.read_leniently`

    Raises
    ------
    InputError
        If a file is no table at all.
    """
    recordings: list[Recording] = []
    found: list[Finding] = []
    for number, (role, path) in enumerate(files):
        progress(0.5 * number / len(files), Sentence("fitting.reading_file", file=path.name))
        read = read_leniently(path, machine, role, columns, resample=resample)
        found += read.findings
        if read.recording is not None:
            recordings.append(read.recording)
    progress(0.5, "checking")
    return check_recordings(machine, recordings, places=Places.of(machine_file), found=found)


def check_recordings(
    machine: Machine,
    recordings: Sequence[Recording],
    *,
    places: Places | None = None,
    found: Sequence[Finding] = (),
) -> tuple[Finding, ...]:
    """Check recordings and machine file for mistakes, the root of each first.

    Mistakes are before notes; what is only a consequence of another one is left out.

    Parameters
    ----------
    recordings : in SI, of any roles, with all channels or only some
    found : what is known already (of reading the files)
    """
    places = places or Places()
    result = [*found, *machine_findings(machine, places)]
    for recording in recordings:
        result += repeated_findings(recording)
    recordings = [with_lost_rows(recording) for recording in recordings]
    for recording in recordings:
        result += signal_findings(machine, recording)
    result += noise_findings(machine, recordings)
    recordings = [bridged(recording, max(1, round(_BRIDGED_S * recording.rate_hz))) for recording in recordings]
    magnitudes = [f for f in magnitude_findings(machine, recordings) if not _spoilt(f, result)]
    result += magnitudes
    result += motion_findings(machine, recordings)
    result += beginning_findings(machine, recordings)
    result += speed_findings(machine, recordings)
    usable, known = _usable(machine, recordings, result)
    if known and not any(f.code in ("time_unit", "wrong_rate", "out_of_range") for f in result):
        try:
            result += _together(machine, usable, places)
        except (HilfitError, ValueError, ArithmeticError) as error:
            _log.warning("the efforts could not be checked: %s", error)
    return _ordered(machine, result, places)


def _spoilt(finding: Finding, earlier: Sequence[Finding]) -> bool:
    return any(f.channel == finding.channel and f.code in ("wrap", "jump", "outliers") for f in earlier if f.channel)


def _usable(
    machine: Machine, recordings: Sequence[Recording], found: Sequence[Finding]
) -> tuple[list[Recording], bool]:
    """Return the recordings with comparable values, units that were found taken back; False if nothing is left."""
    spoilt = {f.recording for f in found if f.code in _SPOILS and f.severity == "mistake"}
    left_out = {f.recording for f in found if f.code in ("wrong_role", "other_machine", "columns", "not_numbers")}
    left_out |= {f.recording for f in found if f.code == "unit" and f.recording is not None}
    kept = [r for r in recordings if r.file not in spoilt | left_out]
    for finding in found:
        if finding.code != "unit" or finding.recording is not None:
            continue
        for channel in machine.channels:
            if channel.name not in (finding.channels or (finding.channel,)):
                continue
            options = gains(machine, channel)
            gain = next((g for g, unit in options.items() if unit == finding.says), None)
            if gain is None:
                return [], False
            name = channel.name
            kept = [replace(r, values={n: gain * v if n == name else v for n, v in r.values.items()}) for r in kept]
    return kept, any(r.role != "unloaded" for r in kept)


def _of_positions(machine: Machine, own: Disagreement, places: Places) -> Finding:
    """Report two position sensors of a joint that contradict each other, and the cause where one is found."""
    option = own.hypothesis
    names = tuple(machine.joints[k].name for k in ((own.joint,) if option is None else option.joints))
    if option is None:
        return finding_of("positions_disagree", joint=names[0], before=own.before, unit="of the motion", strength=4.0)
    quantity = next(iter(option.channels), None)
    channel = machine.channel(quantity, names[0]) if quantity else None
    channels = [c.name for n in names if quantity and (c := machine.channel(quantity, n))]
    where = places.channels(machine, channels) if channels else places.key(option.key)
    text = filled(option.text, channel=channel.name if channel else "", joint=names[0])
    seen = Sentence("fitting.two_sensors_disagree_motion", text=text, before=own.before, after=own.after)
    return Finding(
        option.code,
        named(names[0], seen) if channel is None else seen,  # channels have their joint in their names
        option.cure + where,
        alternatives=tuple(_named(machine, names[0], quantity, text) for text in own.alternatives),
        joint=names[0],
        channel=channel.name if channel else None,
        before=own.before,
        after=own.after,
        unit="of the motion",
        factor=option.factor,
        strength=8.0 + float(np.log(max(own.before, 1e-3) / max(own.after, 1e-3))),
    )


def _together(machine: Machine, recordings: Sequence[Recording], places: Places) -> list[Finding]:
    """Return findings on two sensors and on the efforts."""
    machine, converted = at_joints(machine, [r for r in recordings if r.values])
    found, measured = recordings_apart(machine, converted)
    rods, measured = rods_for_a_time(machine, measured)
    found += rods
    samples = take_samples(machine, measured)
    if samples is None or not samples.loaded.any():
        return found
    disagree, trial = disagreements(Trial(samples, machine, positions_of(machine, samples)))
    found += [_of_positions(machine, own, places) for own in disagree]
    if any(f.code == "positions_disagree" for f in found):
        return found
    clock = clock_of(trial)
    if clock is not None:
        found.append(_of_clock(clock))
        trial = trial.with_samples(clock.samples)
    if inertias := inertia_findings(trial):
        return [*found, *inertias]
    searched = search(trial)
    ratios = {own.joint: own for own in area_ratios(searched.trial) if own.wrong}
    # A bore or rod of a list is worse than the ratio of the areas as it is estimated, where that explains as much or an
    # effect does.
    accused = [
        own
        for own in searched.accused
        if own.hypothesis.code not in ("bore", "rod")
        or own.joint not in ratios
        or not (ratios[own.joint].effect or ratios[own.joint].after <= _AS_WELL * own.after.misfits[own.joint])
    ]
    blamed = {k for own in accused for k in own.hypothesis.joints}
    found += [_of_areas(machine, own, places) for own in ratios.values() if own.joint not in blamed]
    found += [_finding(machine, own, measured, places) for own in accused]
    found += _unexplained(machine, searched, places)
    return found


def _named(machine: Machine, joint: str, quantity: str | None, text: str, otherwise: str = "") -> str:
    """Prefix a text with its channel (``otherwise``, or the joint, where it has none) or joint."""
    channel = machine.channel(quantity, joint) if quantity else None
    if left_open(text):
        return filled(text, channel=channel.name if channel else otherwise or joint, joint=joint)
    return named(joint, text)


def _of_clock(clock: Clock) -> Finding:
    if clock.rate:
        way = "slow" if clock.rate > 0 else "fast"
        what, code = Sentence("fitting.clock_of_efforts", percent=1e2 * abs(clock.rate), way=way), "clock_rate"
    else:
        what, code = (
            Sentence("fitting.all_efforts_come", offset=abs(clock.offset), late=late(clock.offset)),
            "clock_offset",
        )
    return Finding(
        code,
        Sentence("fitting.against_positions_unexplained_effort", what=what, before=clock.before, after=clock.after),
        Sentence("fitting.put_both_buses_clock"),
        before=clock.before,
        after=clock.after,
        unit="of the effort",
        factor=clock.rate or clock.offset,
        strength=4.0 + float(np.log(clock.before / clock.after)),
    )


def _of_areas(machine: Machine, own: AreaRatio, places: Places) -> Finding:
    joint = machine.joints[own.joint]
    cylinder = cylinder_of(joint)
    declared = cylinder.rod_area / cylinder.head_area
    ratio = own.rho * declared
    options = []
    if 0 < ratio < 1:
        options.append(Sentence("fitting.rod_with_this_bore", rod=1e3 * cylinder.bore * np.sqrt(1 - ratio)))
        if cylinder.rod > 0:
            options.append(Sentence("fitting.bore_with_this_rod", bore=1e3 * cylinder.rod / np.sqrt(1 - ratio)))
    other_sizes = Sentence("fitting.other_sizes", options=options) if options else ""
    return finding_of(
        "cylinder_areas",
        ratio=ratio,
        declared=declared,
        said=other_sizes,
        where=places.key(("joints", own.joint, "cylinder", "bore")),
        joint=joint.name,
        before=own.before,
        after=own.after,
        unit="of the effort",
        factor=own.rho,
        severity="mistake" if own.sure else "note",
        alternatives=(Sentence("fitting.back_pressure_valves_direction"),) if own.effect else (),
        strength=1.0 + float(np.log(own.before / own.after)),
    )


def _finding(machine: Machine, accused: Accused, recordings: Sequence[Recording], places: Places) -> Finding:
    own = accused.hypothesis
    names = [] if own.every else [machine.joints[k].name for k in own.joints]
    channels = [*own.names] or [c.name for n in names for q in own.channels if (c := machine.channel(q, n)) is not None]
    where = places.key(own.key) if own.key else places.channels(machine, channels)
    file = None if own.recording is None else recordings[own.recording].file
    channel = channels[0] if len(channels) == 1 or (len(names) == 1 and "channel" in left_open(own.text)) else None
    text = filled(own.text, joint=names[0] if names else "", channel=channel or "the effort")
    front = file or ("" if own.names else next(iter(names), ""))  # channels have their joint in their names
    before, after = accused.before.misfits[accused.joint], accused.after.misfits[accused.joint]
    at = (
        ""
        if names and machine.joints[accused.joint].name == names[0]
        else Sentence("fitting.of_joint", joint=machine.joints[accused.joint].name)
    )
    seen = Sentence("fitting.unexplained_effort_taken_back", text=text, at=at, before=before, after=after)
    return Finding(
        own.code,
        named(front, seen) if front else seen,
        own.cure + where,
        alternatives=tuple(
            _named(machine, machine.joints[other.joints[0]].name, None, other.text, "the effort")
            if other.joints
            else filled(other.text, joint="", channel="the effort")
            for other in accused.alternatives
        ),
        joint=names[0] if names else None,
        channel=channel,
        recording=file,
        before=float(before),
        after=float(after),
        unit="of the effort",
        factor=own.factor,
        strength=float(accused.gain),
    )


def _unexplained(machine: Machine, searched: Searched, places: Places) -> list[Finding]:
    """Report joints whose effort nothing explains, in general terms."""
    found = []
    current = searched.current
    misfits = current.misfits
    if np.nanmax(misfits, initial=0.0) >= GROSS:
        misfits = np.fmin(misfits, with_payload(searched.trial).misfits)
    judged = np.isfinite(misfits) & ~(current.shares < _CARRIES)
    bad = judged & (misfits >= GROSS)
    whole = bool(bad.any() and np.mean(bad[judged]) > _MOST_JOINTS)  # no joint is pushed where all of an arm is wrong
    for number in (int(k) for k in np.flatnonzero(bad)):
        joint, misfit = machine.joints[number], misfits[number]
        pushed = not whole and CLEAR * with_couplings(searched.trial, number) < misfit
        found.append(
            finding_of(
                "unexplained",
                where=places.key(("joints", number)),
                joint=joint.name,
                before=float(searched.nominal.misfits[number]),
                severity="note" if pushed else "mistake",
                alternatives=(Sentence("fitting.motion_other_joints_pushes"),) if pushed else (),
                after=float(misfit),
                unit="of the effort",
                strength=2.0,
            )
        )
    return found


def _ordered(machine: Machine, found: Sequence[Finding], places: Places) -> tuple[Finding, ...]:
    """Order mistakes first, strongest first; without what follows from another one, and each thing once."""
    codes = {f.code for f in found}
    kept: list[Finding] = []
    seen: set[tuple[str, str | None, str | None]] = set()
    for own in sorted(found, key=lambda f: (f.severity != "mistake", -f.strength)):
        if any(cause in codes for cause in _CONSEQUENCES.get(own.code, ())):
            continue
        key = (own.code, own.joint, own.channel or (own.recording if own.joint is None else None))
        if key in seen:
            continue
        seen.add(key)
        where = places.channels(machine, [own.channel]) if own.channel and not says_line(own.cure) else ""
        kept.append(replace(own, cure=own.cure + where) if where else own)
    return tuple(kept)
