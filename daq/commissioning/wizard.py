"""Drafts of ``hilfit machine new``: buses and channels from scans, EDS and DBC files, asked value by value."""

from __future__ import annotations

import json as json_text
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import typer
import yaml
from pydantic import TypeAdapter, ValidationError

from daq import safe_yaml
from daq.commissioning import SCAN_SCHEMA
from daq.commissioning.offers import Offer, of_dbc, of_eds, of_nodes, signals_bus
from daq.errors import InputError
from daq.machine.buses import Bus
from daq.machine.machine_check import check_machine
from daq.machine.machine_file import Channel, read_machine_text
from daq.machine.quantities import JOINT_QUANTITIES, Quantity
from daq.validation_words import in_words

_DEFAULT_JOINTS = 6


@dataclass(frozen=True)
class Origins:
    """The sources that describe devices.

    Attributes
    ----------
    scan : what ``bus scan -o`` wrote
    eds : ``NODE=FILE`` each
    dbc : DBC files
    interface, channel : of the CAN bus where no scan says it
    joints : machine file whose joints are taken over
    """

    scan: Sequence[Path]
    eds: Sequence[str]
    dbc: Sequence[Path]
    interface: str
    channel: str
    joints: Path | None


@dataclass(frozen=True)
class Written:
    """Contents of a draft: numbers of buses, names of channels, number of values left out, notes; and its joints."""

    buses: int
    channels: tuple[str, ...]
    skipped: int
    notes: tuple[str, ...]
    whole: bool


def write_draft(output: Path, origins: Origins, *, ask: bool) -> Written:
    """Write the file; ``ask`` a person what each value is, else take what is proposed.

    Raises
    ------
    InputError
        One line, before anything is written.
    """
    whole = {} if origins.joints is None else safe_yaml.read(read_machine_text(origins.joints))[1]
    names = [f"joint{number}" for number in range(1, _DEFAULT_JOINTS + 1)]
    if whole:
        names = [str(joint["name"]) for joint in whole["joints"]]
    buses, offers = _gathered(origins, output.absolute().parent)
    draft = _Draft(names, lambda offer, proposed: _asked(offer, proposed, names)) if ask else _Draft(names)
    draft.add(offers)
    for channel in draft.channels:
        try:
            Channel.model_validate(channel)
        except ValidationError as error:
            raise InputError("daq.channel_wrong", channel=channel["name"], what=in_words(error.errors()[0])) from None
    head = _head(draft, whole=bool(whole))
    kept = {key: value for key, value in whole.items() if key not in ("buses", "channels")}
    text = _as_text(head, {**kept, "channels": draft.channels, "buses": buses})
    output.write_text(text, encoding="utf-8")
    notes = [finding.under(str(output)) for finding in check_machine(output).errors] if whole else []
    made = tuple(str(content["name"]) for content in draft.channels)
    return Written(len(buses), made, len(draft.skipped), tuple(notes), bool(whole))


def _gathered(origins: Origins, folder: Path) -> tuple[list[dict[str, Any]], list[Offer]]:
    """Gather buses, and what their devices offer."""
    interface, channel, dbc = origins.interface, origins.channel, origins.dbc
    files = dict(_node_file(text) for text in origins.eds)
    buses: list[dict[str, Any]] = []
    offers: list[Offer] = []
    for path in origins.scan:
        for scanned, bus in _scan(path):
            buses.append(bus)
            if bus["type"] != "canopen":
                continue
            silent = bool(bus.get("listen_only"))
            own = [node for node in scanned["nodes"] if node["node"] not in files]
            offers += of_nodes(bus["name"], own, silent)
            for node in [n["node"] for n in scanned["nodes"] if n["node"] in files]:
                offers += _eds_offers(bus, node, files.pop(node), folder, silent)
    if files:
        first = next((bus for bus in buses if bus["type"] == "canopen"), None)
        if first is None:
            first = {"name": "can", "type": "canopen", "interface": interface, "channel": channel}
            buses.append(first)
        for node, file in files.items():
            offers += _eds_offers(first, node, file, folder, bool(first.get("listen_only")))
    if dbc:
        name = "signals" if any(bus["name"] == "can" for bus in buses) else "can"
        buses.append(signals_bus(name, interface, channel, [_beside(path, folder) for path in dbc]))
        for path in dbc:
            offers += of_dbc(name, str(path))
    return buses, offers


def _eds_offers(bus: dict[str, Any], node: int, file: Path, folder: Path, silent: bool) -> list[Offer]:
    entry = next((held for held in bus.setdefault("nodes", []) if held["node"] == node), None)
    if entry is None:
        entry = {"node": node}
        bus["nodes"].append(entry)
    entry["eds"] = _beside(file, folder)
    return of_eds(bus["name"], node, str(file), silent)


def _beside(path: Path, folder: Path) -> str:
    """Write a path for the machine file: relative where it lies beside it."""
    absolute = path.absolute()
    return str(absolute.relative_to(folder)) if absolute.is_relative_to(folder) else str(absolute)


def _node_file(text: str) -> tuple[int, Path]:
    number, equals, path = text.partition("=")
    if not equals or not number.isdigit() or not 1 <= int(number) <= 127:
        raise InputError("daq.eds_no_pair", text=text)
    return int(number), Path(path)


def _scan(path: Path) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Scan each bus, and make the entry of ``buses:`` for it."""
    try:
        content = json_text.loads(path.read_text(encoding="utf-8"))
        if content["schema"] != SCAN_SCHEMA:
            raise ValueError
        found = [(scanned, _bus_of(scanned)) for scanned in content["buses"]]
        for _, bus in found:
            TypeAdapter(Bus).validate_python(bus)
        return found
    except FileNotFoundError:
        raise InputError("daq.no_scan_file", path=path) from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError("daq.not_a_scan", path=path) from None


def _asked(offer: Offer, proposed: _Choice, joints: Sequence[str]) -> _Choice:
    """Ask a person what a value is."""
    default = SKIP
    if proposed.quantity is not None:
        default = proposed.quantity if proposed.joint is None else f"{proposed.joint} {proposed.quantity}"
    allowed = (*QUANTITIES[offer.kind], *OF_VALVES.get(offer.kind, ())) or get_args(Quantity)
    unit = f" in {offer.unit}" if offer.unit else ""
    while True:
        reply = str(typer.prompt(f"{offer.device} {offer.what}, {offer.kind}{unit}: JOINT QUANTITY, or skip", default))
        words = reply.split()
        if words == [SKIP]:
            return _Choice(None)
        quantity = words[-1] if words else ""
        if quantity not in allowed:
            typer.echo(f"  there is no '{quantity}' for this; one of {', '.join(allowed)}")
        elif (quantity in JOINT_QUANTITIES) != (len(words) == 2):
            typer.echo("  a joint's value has a joint before it, others have none")
        elif len(words) == 2 and words[0] not in joints:
            typer.echo(f"  there is no joint '{words[0]}'; there are {', '.join(joints)}")
        else:
            return _Choice(quantity, words[0] if len(words) == 2 else None)


def _head(draft: _Draft, *, whole: bool) -> list[str]:
    head = ["Made by 'hilfit machine new'; look at every line. Ranges and noise_std are not known to a bus."]
    if not whole:
        head.append("A part of a machine file: schema, name, gravity and joints are missing.")
    head += [f"left out: {offer.device} {offer.what} ({offer.kind}): {dict(offer.source)}" for offer in draft.skipped]
    return head


#: Quantities that a value of a kind may be, the likeliest first.
QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "angle": ("joint_position", "motor_position", "base_roll", "base_pitch"),
    "length": ("piston_position", "joint_position"),
    "pressure": ("head_pressure", "rod_pressure", "supply_pressure", "tank_pressure"),
    "temperature": ("oil_temperature",),
    "tilt": ("base_pitch", "base_roll"),
    "force": ("cylinder_force", "external_force"),
    "torque": ("joint_effort", "motor_effort"),
    "sent": (),
    "value": (),
}
#: What they may be besides, where a person says so: not every joint has a valve.
OF_VALVES: Mapping[str, tuple[str, ...]] = {
    "pressure": ("head_port_pressure", "rod_port_pressure"),
    "sent": ("command", "spool_position"),
}
SKIP = "skip"
_NAMES = {"joint_position": "angle"}


@dataclass(frozen=True)
class _Choice:
    """The quantity that an offer becomes, of a joint where it belongs to one; None: no channel."""

    quantity: str | None
    joint: str | None = None


@dataclass
class _Draft:
    """A draft as it grows: ``choose`` is asked for every offer, with what it would be by itself."""

    joints: Sequence[str]
    choose: Callable[[Offer, _Choice], _Choice] = lambda offer, proposed: proposed
    channels: list[dict[str, Any]] = field(default_factory=list)
    skipped: list[Offer] = field(default_factory=list)
    _taken: set[tuple[str, str | None]] = field(default_factory=set)
    _joint_of: dict[str, str] = field(default_factory=dict)  # a device with two pressures measures one cylinder

    def add(self, offers: Iterable[Offer]) -> None:
        """Add offers, one after another."""
        for offer in offers:
            chosen = self.choose(offer, self._proposed(offer))
            if chosen.quantity is None:
                self.skipped.append(offer)
                continue
            self._taken.add((chosen.quantity, chosen.joint))
            if chosen.joint is not None:
                self._joint_of.setdefault(offer.device, chosen.joint)
            self.channels.append(self._channel(offer, chosen))

    def _proposed(self, offer: Offer) -> _Choice:
        for quantity in QUANTITIES[offer.kind]:
            if quantity not in JOINT_QUANTITIES:
                if (quantity, None) not in self._taken:
                    return _Choice(quantity)
                continue
            own = self._joint_of.get(offer.device)
            for joint in self.joints if own is None else [own]:
                if (quantity, joint) not in self._taken:
                    return _Choice(quantity, joint)
        return _Choice(None)

    def _channel(self, offer: Offer, chosen: _Choice) -> dict[str, Any]:
        assert chosen.quantity is not None
        name = chosen.quantity
        if chosen.joint is not None:
            name = f"{chosen.joint}.{_NAMES.get(chosen.quantity, chosen.quantity)}"
        used = Counter(channel["name"] for channel in self.channels)
        content: dict[str, Any] = {"name": name if not used[name] else f"{name}.{used[name] + 1}"}
        content["quantity"] = chosen.quantity
        if chosen.joint is not None:
            content["joint"] = chosen.joint
        return content | {"unit": offer.unit or "TODO", "source": dict(offer.source)}


def _bus_of(scanned: Mapping[str, Any]) -> dict[str, Any]:
    """Build the entry of ``buses:`` for a scanned bus: listen_only where another leads, nodes with identity."""
    bus = {key: value for key, value in scanned["bus"].items() if key != "nodes"}
    if scanned.get("masters"):
        bus["listen_only"] = True
    nodes = [
        {"node": node["node"]} | {key: node[key] for key in ("device_type", "vendor_id", "product_code") if node[key]}
        for node in scanned.get("nodes", ())
        if node.get("device_type") is not None
    ]
    return bus | ({"nodes": nodes} if nodes else {})


def _as_text(head: Sequence[str], content: Mapping[str, Any]) -> str:
    """Write YAML with a line per channel and node, objects in hexadecimal."""
    lines = [f"# {line}" for line in head]
    for key, value in content.items():
        if key not in ("buses", "channels"):
            lines.append(yaml.safe_dump({key: value}, sort_keys=False, allow_unicode=True).rstrip())
            continue
        lines.append(f"{key}:")
        for entry in value:
            nodes = entry.get("nodes") if key == "buses" else None
            lines.append("  - " + _flow({k: v for k, v in entry.items() if k != "nodes"}, closed=not nodes))
            if nodes:
                lines.append("    nodes:")
                lines += [f"      - {_flow(node)}" for node in nodes]
    return "\n".join(lines) + "\n"


_HEXADECIMAL = {"object": 4, "cob_id": 3, "device_type": 8, "vendor_id": 8, "product_code": 8}


def _flow(value: Any, *, closed: bool = True, key: str = "") -> str:
    """Write a value on one line; an open mapping has its keys on lines of their own."""
    if isinstance(value, Mapping):
        parts = [f"{k}: {_flow(v, key=k)}" for k, v in value.items()]
        return "{" + ", ".join(parts) + "}" if closed else "\n    ".join(parts)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(part) for part in value) + "]"
    if key in _HEXADECIMAL and isinstance(value, int):
        return f"0x{value:0{_HEXADECIMAL[key]}X}"
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=1000)
    return text.removesuffix("\n").removesuffix("\n...").strip()
