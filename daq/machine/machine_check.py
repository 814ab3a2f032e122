"""``hilfit machine check``: everything that is wrong or doubtful in a machine file, at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import ValidationError

from daq.errors import MachineFileError
from daq.machine.buses import CanopenBus, CanSignalsBus
from daq.machine.coherence import incoherences
from daq.machine.joints import Cylinder, Drive, Joint
from daq.machine.machine_file import Channel, Machine, content_of, machine_of, read_machine_text
from daq.machine.machine_file_errors import Place, Problem, key_of, line_of
from daq.machine.plausible import unusual_values, unusual_valves
from daq.machine.travel import travel_of
from daq.machine.valves import Valve
from daq.units import SI_UNITS


@dataclass(frozen=True)
class Checked:
    """A machine file that was looked at: the machine if it is valid, and all findings, errors first."""

    machine: Machine | None
    findings: tuple[Problem, ...]

    @property
    def errors(self) -> tuple[Problem, ...]:
        """Problems that have to be corrected."""
        return tuple(f for f in self.findings if f.level == "error")


def check_machine(path: str | Path) -> Checked:
    """Look at a machine file.

    Raises
    ------
    MachineFileError
        If there is no text to look at.
    """
    text = read_machine_text(Path(path))
    tree, content, problem = content_of(text)
    if problem is not None:  # no YAML, or of another kind: there is nothing else to say of it
        return Checked(None, (problem,))
    machine, problems = machine_of(tree, content, Path(path).absolute().parent)
    if machine is None and all(p.key for p in problems):  # parts are wrong, so that nobody looked at the whole
        problems += [Problem(line_of(tree, place), "", text) for place, text in _of_the_parts(content)]
    findings = list(problems)
    named = {finding.key for finding in findings}
    for unusual in (*unusual_values(content), *(() if machine is None else unusual_valves(machine))):
        key = key_of(unusual.place)
        if key not in named:  # of several about one key the first holds most
            named.add(key)
            findings.append(Problem(line_of(tree, unusual.place), key, unusual.text, unusual.cure, "warning"))
    if machine is not None:
        findings += _of_the_files(machine, tree)
    return Checked(machine, tuple(findings))


def _of_the_parts(content: dict[str, Any]) -> list[tuple[Place, str]]:
    """List what does not belong together in a file of which parts are wrong, as far as possible."""
    joints, channels = content.get("joints"), content.get("channels")
    if not (isinstance(joints, list) and isinstance(channels, list)):
        return []
    skeletons = [_joint(raw) for raw in joints]
    read = [_channel(raw) for raw in channels]
    whole = [skeleton for skeleton in skeletons if skeleton is not None]
    known = [channel for channel in read if channel is not None]
    if len(whole) < len(joints) or len(known) < len(channels):  # what joints lack is not known then
        return []
    return incoherences(Machine.model_construct(joints=tuple(whole), channels=tuple(known), buses=()))


def _of_the_files(machine: Machine, tree: yaml.Node | None) -> list[Problem]:
    """List what does not belong together in a machine file and its files: DBC, EDS, DCF."""
    findings = []
    for number, bus in enumerate(machine.buses):
        own = [
            (index, c) for index, c in enumerate(machine.channels) if c.source is not None and c.source.bus == bus.name
        ]
        channels = [channel for _, channel in own]
        place: list[str | int] = ["buses", number]
        try:
            if isinstance(bus, CanSignalsBus):
                from daq.machine.can_database import listed_messages, unusual_units

                listed, problems = listed_messages(bus, channels)
                levels: tuple[tuple[Literal["error", "warning"], list[tuple[int, str]]], ...] = (
                    ("error", problems),
                    ("warning", unusual_units(machine, listed, channels)),
                )
                for level, found in levels:
                    for position, text in found:
                        index = own[position][0]
                        line = line_of(tree, ["channels", index, "source"])
                        findings.append(Problem(line, f"channels[{index}].source", text, level=level))
            elif isinstance(bus, CanopenBus) and bus.listen_only:
                from daq.drivers.canopen.listening import pdo_members

                pdo_members(bus, channels)
        except MachineFileError as error:
            findings.append(Problem(line_of(tree, place), f"buses[{number}]", str(error)))
    return findings


def _joint(raw: object) -> Joint | None:
    """Parse a joint, or as much of it as channels need; None without a name."""
    if not isinstance(raw, dict) or not isinstance(raw.get("name"), str):
        return None
    try:
        return Joint.model_validate(raw)
    except ValidationError:
        cylinder, drive = raw.get("cylinder"), raw.get("drive")
        vented = cylinder.get("vented") if isinstance(cylinder, dict) else None
        valve = Valve.model_construct() if isinstance(cylinder, dict) and cylinder.get("valve") else None
        try:
            own = None if drive is None else Drive.model_validate(drive)
        except ValidationError:
            own = Drive()
        return Joint.model_construct(
            name=raw["name"],
            type=raw.get("type", "revolute"),
            cylinder=Cylinder.model_construct(vented=vented, valve=valve) if isinstance(cylinder, dict) else None,
            drive=own,
        )


def _channel(raw: object) -> Channel | None:
    """Parse a channel, or as much of it as a joint needs; None without what it measures."""
    try:
        return Channel.model_validate(raw)
    except ValidationError:
        if not isinstance(raw, dict):
            return None
        name, quantity, joint, unit = (raw.get(key) for key in ("name", "quantity", "joint", "unit"))
        if not (isinstance(name, str) and isinstance(unit, str) and isinstance(joint, str | None)):
            return None
        if not isinstance(quantity, str) or quantity not in SI_UNITS:
            return None
        return Channel.model_construct(name=name, quantity=quantity, joint=joint, unit=unit)


def facts_of(machine: Machine) -> dict[str, Any]:
    """Return what a valid machine file describes, for people and programs."""
    return {
        "name": machine.name,
        "rate_hz": machine.rate_hz,
        "joints": len(machine.joints),
        "cylinders": sum(joint.cylinder is not None for joint in machine.joints),
        "channels": len(machine.channels),
        "buses": [f"{bus.name} ({bus.type})" for bus in machine.buses],
        "can_be_acquired": bool(machine.buses) and all(channel.source for channel in machine.channels),
        "travel": [travel_of(joint).facts() for joint in machine.joints],
    }
