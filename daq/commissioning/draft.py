"""The ``buses`` and ``channels`` part of a machine file, from what devices have to offer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import yaml

from daq.commissioning.offers import Offer
from daq.machine.quantities import JOINT_QUANTITIES

#: Quantities that a value of a kind may be, the likeliest first.
QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "angle": ("joint_position", "motor_position", "base_roll", "base_pitch"),
    "length": ("piston_position", "joint_position"),
    "pressure": ("head_pressure", "rod_pressure", "supply_pressure", "tank_pressure"),
    "temperature": ("oil_temperature",),
    "tilt": ("base_pitch", "base_roll"),
    "force": ("cylinder_force", "external_force"),
    "torque": ("joint_effort", "motor_effort"),
    "value": (),
}
SKIP = "skip"
_NAMES = {"joint_position": "angle"}


@dataclass(frozen=True)
class Choice:
    """What an offer becomes: a quantity, of a joint where it belongs to one; None: no channel."""

    quantity: str | None
    joint: str | None = None


@dataclass
class Draft:
    """A draft as it grows: ``choose`` is asked for every offer, with what it would be by itself."""

    joints: Sequence[str]
    choose: Callable[[Offer, Choice], Choice] = lambda offer, proposed: proposed
    channels: list[dict[str, Any]] = field(default_factory=list)
    skipped: list[Offer] = field(default_factory=list)
    _taken: set[tuple[str, str | None]] = field(default_factory=set)
    _joint_of: dict[str, str] = field(default_factory=dict)  # a device with two pressures measures one cylinder

    def add(self, offers: Iterable[Offer]) -> None:
        """Offers, one after another."""
        for offer in offers:
            chosen = self.choose(offer, self._proposed(offer))
            if chosen.quantity is None:
                self.skipped.append(offer)
                continue
            self._taken.add((chosen.quantity, chosen.joint))
            if chosen.joint is not None:
                self._joint_of.setdefault(offer.device, chosen.joint)
            self.channels.append(self._channel(offer, chosen))

    def _proposed(self, offer: Offer) -> Choice:
        for quantity in QUANTITIES[offer.kind]:
            if quantity not in JOINT_QUANTITIES:
                if (quantity, None) not in self._taken:
                    return Choice(quantity)
                continue
            own = self._joint_of.get(offer.device)
            for joint in self.joints if own is None else [own]:
                if (quantity, joint) not in self._taken:
                    return Choice(quantity, joint)
        return Choice(None)

    def _channel(self, offer: Offer, chosen: Choice) -> dict[str, Any]:
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


def bus_of(scanned: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of ``buses:`` for a bus of a scan: listen_only where somebody else leads, nodes with their identity."""
    bus = {key: value for key, value in scanned["bus"].items() if key != "nodes"}
    if scanned.get("masters"):
        bus["listen_only"] = True
    nodes = [
        {"node": node["node"]} | {key: node[key] for key in ("device_type", "vendor_id", "product_code") if node[key]}
        for node in scanned.get("nodes", ())
        if node.get("device_type") is not None
    ]
    return bus | ({"nodes": nodes} if nodes else {})


def as_text(head: Sequence[str], content: Mapping[str, Any]) -> str:
    """YAML with a line per channel and node, objects in hexadecimal."""
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
    """A value on one line; a mapping that is not closed has its keys on lines of their own."""
    if isinstance(value, Mapping):
        parts = [f"{k}: {_flow(v, key=k)}" for k, v in value.items()]
        return "{" + ", ".join(parts) + "}" if closed else "\n    ".join(parts)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(part) for part in value) + "]"
    if key in _HEXADECIMAL and isinstance(value, int):
        return f"0x{value:0{_HEXADECIMAL[key]}X}"
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=1000)
    return text.removesuffix("\n").removesuffix("\n...").strip()
