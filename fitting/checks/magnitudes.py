"""Numbers that no machine has: degrees or millimetres in the machine file, joints at ten times their limits.

The bounds are those of physics and of the machine file, each with a wide margin: nothing here asks for more than an
order of magnitude except where the file itself states a limit. The warnings of ``hilfit machine check`` are mistakes
here where the number enters an identification, and notes where it does not (limits, ranges).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from daq.machine.machine_file import Channel, Machine, machine_content
from daq.machine.plausible import Unusual, unusual_values
from daq.messages import Sentence, named
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.checks.findings import Finding, Places, finding_of
from fitting.checks.mistakes.hypothesis import RARE, gains
from fitting.checks.mistakes.samples import POSITIONS, PRESSURES
from fitting.signals.filters import white_noise_of

#: Pa: the largest pressure of a cylinder that works lies between these (0.6 bar, which is 600 bar in kPa; 1000 bar);
#: a vacuum ends at minus one bar.
_WORKING = (6.0e4, 1.0e8)
_VACUUM = -1.5e5
#: Pa: usual largest pressures, to choose among units.
_USUAL, _USUAL_RANGE = 1.2e7, (3.0e5, 6.0e7)
#: Factors by which largest pressures of one arm's joints, and noises of its transducers, usually differ.
_SPREAD = (5.0, 2.0)
#: A pressure's top and noise have to agree with the others' in its new unit within this factor.
_ALIKE = 8.0
#: Above the strengths of misfits, some 15 at most: what efforts and sensors show with a unit taken back comes after it,
#: and nothing that they show is worth a word while the file itself cannot be right.
_STRENGTH = 20.0
#: A position beyond its limits by this share of their width is no overshoot.
_BEYOND = 0.5
#: Smallest share of the limits that a motion covers, in position and in speed, for its unit to be plausible.
_TINY = 0.025


def magnitude_findings(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Report channels whose values cannot be; on all channels of a kind at once where all have it."""
    impossible, tops = _impossible(machine, recordings)
    found = [*(impossible or _unlike(machine, recordings, tops)), *_positions(machine, recordings)]
    if any(own.code == "unit" for own in found) or len(recordings) < 2:
        return found
    return [*found, *_in_one_recording(machine, recordings)]


def _in_one_recording(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    """Find units that are wrong in single recordings: an export with other settings."""
    tops = {r.file: [top for own in _impossible(machine, [r])[1].values() for top in own.values()] for r in recordings}
    own = {}
    for r in recordings:
        others = [top for file, found in tops.items() if file != r.file for top in found]
        usual = float(np.median(others)) if others else _USUAL
        own[r.file] = [*_impossible(machine, [r], usual)[0], *_positions(machine, [r])]
    return [
        replace(finding, recording=file, text=named(file, finding.text), strength=finding.strength + 1)
        for file, findings in own.items()
        for finding in findings
        if finding.code == "unit"
    ]


def _measured(
    machine: Machine, recordings: Sequence[Recording], quantities: Sequence[str]
) -> Iterator[tuple[Channel, str, FloatArray]]:
    """Yield the joints' channels of these quantities, each with its joint and all that was measured, SI (k,)."""
    for channel in machine.channels:
        parts = [np.asarray(r.values[channel.name]) for r in recordings if channel.name in r.values]
        if channel.quantity in quantities and channel.joint is not None and parts:
            values = np.concatenate(parts)
            if np.isfinite(values).any():
                yield channel, channel.joint, values[np.isfinite(values)]


def _impossible(
    machine: Machine, recordings: Sequence[Recording], usual: float = _USUAL
) -> tuple[list[Finding], dict[str, dict[str, float]]]:
    """Find pressures that no cylinder has, and the largest of each channel by joint; ``usual`` gives the unit."""
    tops: dict[str, dict[str, float]] = {}
    found = []
    for channel, joint, values in _measured(machine, recordings, PRESSURES):
        low, top = np.percentile(values, [0.5, 99.5])
        tops.setdefault(joint, {})[channel.name] = float(top)
        if low < _VACUUM and top < _WORKING[1]:
            found.append(
                finding_of("sign", joint=joint, channel=channel.name, before=float(low), unit="Pa", strength=5.0)
            )
    # One chamber may be open to the air; a cylinder with both chambers empty does not work.
    small = [j for j, own in tops.items() if max(own.values()) < _WORKING[0]]
    large = [j for j, own in tops.items() if max(own.values()) > _WORKING[1]]
    for joints, what in ((small, "fitting.no_cylinder_works_little"), (large, "fitting.no_cylinder_holds")):
        theirs = {name: top for j in joints for name, top in tops[j].items() if joints is small or top > _WORKING[1]}
        channels = [channel for channel in machine.channels if channel.name in theirs]
        if not channels:
            continue
        largest, sizes = max(channels, key=lambda channel: theirs[channel.name]), _sizes(recordings, tops)
        others = [size for name, size in sizes.items() if name not in theirs] or [np.log([usual, np.nan])]
        size = sizes.get(largest.name, np.log([max(theirs[largest.name], 1e-300), np.nan]))
        unit = _unit_of(machine, largest, size, np.median(others, axis=0))
        like = Sentence("fitting.values_look_like", unit=unit) if unit else Sentence("fitting.they_no_unit_known")
        every = len(channels) == sum(len(own) for own in tops.values()) and len(tops) > 1
        for channel in [largest] if every else channels:
            who, top = "all pressures" if every else channel.name, theirs[channel.name]
            found.append(
                Finding(
                    "unit",
                    Sentence("fitting.reach_pa", who=who, top=top, what=Sentence(what), named=like),
                    Sentence("fitting.set_unit", unit=unit) if unit else Sentence("fitting.look_at_unit_and_wiring"),
                    joint=None if every else channel.joint,
                    channel=None if every else channel.name,
                    before=top,
                    unit="Pa",
                    says=unit,
                    channels=tuple(c.name for c in channels) if every else (),
                    strength=_STRENGTH,
                )
            )
    return found, tops


def _unlike(machine: Machine, recordings: Sequence[Recording], tops: dict[str, dict[str, float]]) -> list[Finding]:
    """Find a pressure whose values and noise are both smaller (larger) than those of the others by a unit's factor."""
    sizes = _sizes(recordings, tops)
    found = []
    for channel in machine.channels:
        others = [size for name, size in sizes.items() if name != channel.name]
        if channel.name not in sizes or not others:
            continue
        away = sizes[channel.name] - np.median(others, axis=0)
        for gain, unit in gains(machine, channel).items():
            if abs(np.log(gain)) < np.log(500) or np.any(np.abs(away + np.log(gain)) > np.log(_ALIKE)):
                continue
            top = float(np.exp(sizes[channel.name][0]))
            if not _USUAL_RANGE[0] < top * gain < _USUAL_RANGE[1] or _USUAL_RANGE[0] < top < _USUAL_RANGE[1]:
                continue
            found.append((float(np.abs(away + np.log(gain)).sum()), channel, unit, top))
    best = {item[1].name: item for item in sorted(found, key=lambda item: -item[0])}
    # Two channels alone cannot show which of them is odd: the one whose values no cylinder has.
    return [
        finding_of(
            "unit/unlike",
            says=unit,
            joint=channel.joint,
            channel=channel.name,
            before=top,
            unit="Pa",
            strength=_STRENGTH,
        )
        for _, channel, unit, top in best.values()
    ]


def _sizes(recordings: Sequence[Recording], tops: dict[str, dict[str, float]]) -> dict[str, FloatArray]:
    """Compute the logarithms of largest value and noise (2,) of each channel where both are above zero."""
    found = {}
    for name, top in ((name, top) for own in tops.values() for name, top in own.items()):
        measured = [r.values[name][np.isfinite(r.values[name])] for r in recordings if name in r.values]
        noise = max((white_noise_of([values]) for values in measured), default=0.0)
        if noise > 0 and top > 0:
            found[name] = np.log([top, noise])
    return found


def _unit_of(machine: Machine, channel: Channel, size: FloatArray, usual: FloatArray) -> str | None:
    """Choose the unit in which a channel is of a usual size, and nearest to ``usual`` in value and, if known, noise."""
    low, high = np.log(_USUAL_RANGE)
    options = {unit: size + np.log(gain) for gain, unit in gains(machine, channel).items()}
    away = {unit: (own - usual) / np.log(_SPREAD) for unit, own in options.items() if low < own[0] < high}
    near = {unit: float(np.nansum(own**2)) for unit, own in away.items()}
    return min(near, key=lambda unit: near[unit]) if near else None


def _positions(machine: Machine, recordings: Sequence[Recording]) -> list[Finding]:
    found: list[Finding] = []
    for channel, name, values in _measured(machine, recordings, POSITIONS):
        joint = machine.joint(name)
        low, high = joint.limits.position
        if channel.quantity == "piston_position" and joint.cylinder is not None:
            low, high = 0.0, joint.cylinder.stroke
        least, most = (float(v) for v in np.percentile(values, [1, 99]))
        width, unit = high - low, machine.si_unit(channel)
        beyond = max(low - least, most - high) / width
        if beyond <= _BEYOND:
            found += _too_little(machine, channel, (least, most), (low, high))
            continue
        options = gains(machine, channel)
        fitting = [
            (abs(np.log((most - least) * g / (0.6 * width))) + (0.7 if likely in RARE else 0.0), likely)
            for g, likely in options.items()
            if abs(g) < 1 and least * g > low - 0.15 * width and most * g < high + 0.15 * width
            and (most - least) * g > 0.02 * width
        ]  # fmt: skip
        likely = min(fitting)[1] if fitting and most - least > 1.5 * width else None
        sign = likely is None and -most > low - 0.15 * width and -least < high + 0.15 * width
        if likely:
            code, what = "unit", Sentence("fitting.values_look_like", unit=likely)
            cure = Sentence("fitting.set_its_unit", unit=likely)
        elif sign:
            code, what = "sign", Sentence("fitting.looks_if_counted_other")
            cure = Sentence("fitting.correct_sign_scale")
        else:
            code, what = "out_of_range", Sentence("fitting.unit_zero_sign_wrong")
            cure = Sentence("fitting.look_at_unit_sign_offset")
        goes = Sentence("fitting.goes_beyond", least=least, most=most, unit=unit, low=low, high=high, what=what)
        found.append(
            Finding(
                code,
                Sentence("daq.named", name=channel.name, what=goes),
                cure,
                joint=channel.joint,
                channel=channel.name,
                before=beyond,
                says=likely,
                strength=_STRENGTH if likely else 4.0,
            )
        )
    return _together(found, machine)


def _too_little(
    machine: Machine, channel: Channel, seen: tuple[float, float], allowed: tuple[float, float]
) -> list[Finding]:
    """Find a motion that is next to nothing in the file's declared unit and a usual one in the SI unit."""
    factor, unit = machine.conversion(channel).factor, machine.si_unit(channel)
    width, span = allowed[1] - allowed[0], seen[1] - seen[0]
    inside = seen[0] / factor > allowed[0] - 0.1 * width and seen[1] / factor < allowed[1] + 0.1 * width
    if factor > 0.05 or span > _TINY * width or span / factor < 0.1 * width or not inside:
        return []
    who: dict[str, Any] = {"joint": channel.joint, "channel": channel.name, "declared": channel.unit, "says": unit}
    before, after = span / width, span / factor / width
    return [finding_of("unit/too_little", before=before, after=after, unit="of the limits", strength=_STRENGTH, **who)]


def _together(found: list[Finding], machine: Machine) -> list[Finding]:
    """Merge into one finding where all channels of a kind have the same one."""
    result = found
    for quantity in dict.fromkeys(c.quantity for c in machine.channels if c.quantity in POSITIONS):
        names = {c.name for c in machine.channels if c.quantity == quantity and c.joint is not None}
        own = [f for f in result if f.channel in names and f.code == "unit"]
        if 1 < len(names) == len(own) and len({f.cure for f in own}) == 1:
            first = own[0]
            whole = Finding(
                "unit",
                Sentence("fitting.all_channels_quantity", quantity=quantity, text=first.text),
                first.cure if first.says is None else Sentence("fitting.set_unit", unit=first.says),
                before=first.before,
                says=first.says,
                channels=tuple(str(f.channel) for f in own),
                strength=first.strength + 1,
            )
            result = [whole, *(f for f in result if f not in own)]
    return result


#: Last key of a number that enters an identification, and what the mistake is called.
_ENTER = {
    "gravity": "gravity",
    "a": "length",
    "d": "length",
    "alpha": "axis",
    "theta": "offset",
    "bore": "bore",
    "rod": "rod",
}


def machine_findings(machine: Machine, places: Places) -> list[Finding]:
    """Check the machine file alone."""
    content = machine_content(machine)
    found = list(unusual_values(content))
    bores = {warning.place[:-1] for warning in found if warning.place[-1] == "bore"}
    # A rod is only compared with its bore.
    kept = [warning for warning in found if warning.place[-1] != "rod" or warning.place[:-1] not in bores]
    return [_finding(content, warning, places) for warning in kept]


def _finding(content: dict[str, Any], warning: Unusual, places: Places) -> Finding:
    code = "linkage" if "linkage" in warning.place else _ENTER.get(str(warning.place[-1]))
    joint = content["joints"][warning.place[1]]["name"] if warning.place[0] == "joints" else None
    key = ".".join(str(part) for part in warning.place if part != "joints" and not isinstance(part, int))
    where = named(key, warning.text)
    return Finding(
        code or "machine_file",
        named(joint, where) if joint else where,
        warning.cure + places.key(warning.place),
        joint=joint,
        severity="mistake" if code and not warning.slight else "note",
        strength=_STRENGTH if code and not warning.slight else 0.0,
    )
