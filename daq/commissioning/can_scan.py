"""Who is on a CAN bus: listen, and ask only where nobody else leads and somebody wants it.

Listening tells the other master, heartbeats, what is sent and how often. Only where no sign of a master was heard
(:mod:`daq.drivers.canopen.leadership`) is every node asked for its device type, a frame each 5 ms, and those that
answer for their identity and their TPDOs. Nothing is ever written.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import can
import numpy as np

from daq.commissioning.can_questions import FoundNode, answering
from daq.commissioning.can_questions import asked as asked_node
from daq.drivers.base import DriverContext
from daq.drivers.can.health import BusHealth
from daq.drivers.canopen.link import CanLink
from daq.frames.clock import NS
from daq.machine.can_database import pgn_of
from daq.machine.machine_file import CanopenBus, CanSignalsBus

LISTEN_S = 2.0
LONGEST_S = 60.0  # that a machine file may say
NODES = range(1, 128)
STATES = {0x00: "booting", 0x04: "stopped", 0x05: "operational", 0x7F: "pre-operational"}
_TIMES = 4096  # of one identifier that are kept


@dataclass(frozen=True)
class Frames:
    """Frames of one identifier.

    Attributes
    ----------
    identifier, extended : 11 bits, or 29
    what : what it is in CANopen's predefined connection set, or in J1939
    node : node-ID (source address), where ``what`` has one
    count, length : frames, and bytes of the last one
    hz, jitter_ms : how often it came, and standard deviation of the time between two; None for fewer than three
    data : of the last one, hexadecimal
    """

    identifier: int
    extended: bool
    what: str
    node: int | None
    count: int
    length: int
    hz: float | None
    jitter_ms: float | None
    data: str


@dataclass(frozen=True)
class CanScan:
    """Findings of a scan of a CAN bus.

    Attributes
    ----------
    bus : the entry of ``buses:`` that it was opened by
    masters : what only another master sends, in words; empty: none was heard
    asked : whether anything was sent
    heard, nodes : in the order of their identifiers
    notes : lines for people
    """

    bus: dict[str, Any]
    seconds: float
    masters: str
    asked: bool
    heard: tuple[Frames, ...]
    nodes: tuple[FoundNode, ...]
    notes: tuple[str, ...]


class _Ear(CanLink):
    """A link that remembers every frame."""

    takes_extended: ClassVar[bool] = True

    def __init__(self, bus: CanopenBus, context: DriverContext, health: BusHealth) -> None:
        self.lock = threading.Lock()
        self.times: dict[tuple[int, bool], list[int]] = {}
        self.seen: dict[tuple[int, bool], int] = {}
        self.last: dict[tuple[int, bool], bytes] = {}
        super().__init__(bus, context, health)

    def dispatch(self, message: can.Message, at_ns: int) -> None:
        """Remember it, then do with it what a link does."""
        key = (message.arbitration_id, message.is_extended_id)
        with self.lock:
            times = self.times.setdefault(key, [])
            if len(times) < _TIMES:
                times.append(at_ns)
            self.seen[key] = self.seen.get(key, 0) + 1
            self.last[key] = bytes(message.data)
        if not message.is_extended_id:
            super().dispatch(message, at_ns)


def scan_can(
    bus: CanopenBus | CanSignalsBus,
    *,
    seconds: float = LISTEN_S,
    ask: bool = False,
    nodes: Sequence[int] = NODES,
) -> CanScan:
    """Look who is on a CAN bus.

    Parameters
    ----------
    bus : as in a machine file; one that is ``listen_only`` is never asked
    seconds : to listen before anything is sent
    ask : whether nodes are to be asked, if nobody else leads; else nothing is sent
    nodes : node-IDs to ask

    Raises
    ------
    BusError
        If the bus cannot be opened.
    """
    opened = _canopen(bus, listen_only=bus.listen_only or not ask, listen_s=min(seconds, LONGEST_S))
    health = BusHealth(bus.name)
    link = _Ear(opened, DriverContext(1.0, 0.0, time.monotonic_ns), health)
    try:
        time.sleep(seconds)
        health.look(time.monotonic_ns())
        with link.lock:
            seen = tuple(_frames(key, link) for key in sorted(link.times, key=lambda key: (key[1], key[0])))
        found = {node.node: node for node in _alive(seen)}
        asked = link.failure is None and link.leadership.lead()
        masters = link.leadership.masters_seen()
        if asked:
            for number, answers in answering(link, nodes).items():
                known = found.get(number, FoundNode(number))
                found[number] = asked_node(link, replace(known, answers=answers))
        notes = _notes(bus.name, link, health, seen, masters, asked=asked)
        notes += [
            f"bus '{bus.name}': {node.answers} devices answer as node {node.node}; give each an ID of its own"
            for node in found.values()
            if node.answers > 1
        ]
        described = bus.model_dump(mode="json", exclude_unset=True)
        nodes_found = tuple(found[number] for number in sorted(found))
        return CanScan(described, seconds, masters, asked, seen, nodes_found, tuple(notes))
    finally:
        link.close()


def questions(nodes: Sequence[int]) -> str:
    """Word what asking sends."""
    return (
        f"an SDO read of the device type to each of {len(nodes)} nodes, one per 5 ms; to those that answer SDO reads "
        "of identity, scaling and TPDOs; nothing where another master is heard, and nothing is written"
    )


def _canopen(bus: CanopenBus | CanSignalsBus, *, listen_only: bool, listen_s: float) -> CanopenBus:
    """Open the bus for CANopen; one that is only listened to does not even acknowledge."""
    return CanopenBus(
        name=bus.name, type="canopen", interface=bus.interface, channel=bus.channel, bitrate=bus.bitrate,
        options=bus.options, listen_only=listen_only, listen_s=listen_s,
    )  # fmt: skip


# Listening


def _frames(key: tuple[int, bool], link: _Ear) -> Frames:
    identifier, extended = key
    steps = np.diff(link.times[key]) / NS
    what, node = _meaning(identifier, extended)
    data = link.last[key]
    return Frames(
        identifier,
        extended,
        what,
        node,
        link.seen[key],
        len(data),
        float(1 / steps.mean()) if len(steps) > 1 and steps.mean() > 0 else None,
        float(1e3 * steps.std()) if len(steps) > 1 else None,
        data.hex(),
    )


def _meaning(identifier: int, extended: bool) -> tuple[str, int | None]:
    """Classify an identifier (CiA 301, 7.3.5; SAE J1939-21), and the device that it names."""
    if extended:
        return f"29 bits, PGN 0x{pgn_of(identifier):04X} from 0x{identifier & 0xFF:02X}", None
    function, node = identifier & 0x780, identifier & 0x7F
    if identifier in (0x000, 0x080, 0x100):
        return {0x000: "NMT command", 0x080: "SYNC", 0x100: "TIME"}[identifier], None
    names = {0x080: "EMCY", 0x580: "SDO answer", 0x600: "SDO request", 0x700: "heartbeat"}
    if not node or (function not in names and not 0x180 <= function <= 0x500):
        return "11 bits", None
    if function in names:
        return names[function], node
    number = (function - 0x180) // 0x100 + 1
    return (f"TPDO{number}" if function & 0x080 else f"RPDO{(function - 0x200) // 0x100 + 1}"), node


def _alive(seen: Sequence[Frames]) -> list[FoundNode]:
    """List the nodes that sent something."""
    found: dict[int, FoundNode] = {}
    for entry in seen:
        if entry.node is None or entry.what.startswith(("RPDO", "SDO request")):
            continue
        node = found.get(entry.node, FoundNode(entry.node))
        if entry.what == "heartbeat" and entry.data:
            state = STATES.get(bytes.fromhex(entry.data)[0] & 0x7F, "unknown")
            node = replace(node, state=state, heartbeat_ms=None if entry.hz is None else round(1e3 / entry.hz))
        found[entry.node] = node
    return list(found.values())


def _notes(name: str, link: _Ear, health: BusHealth, seen: Sequence[Frames], masters: str, *, asked: bool) -> list[str]:
    notes = []
    if link.failure is not None:
        notes.append(f"bus '{name}': {link.failure}; check the interface")
    if health.line:
        notes.append(health.line)
    if health.error_frames and not seen:
        notes.append(f"bus '{name}': {health.error_frames} error frames and nothing else; the bitrate is wrong")
    elif not seen and not asked:
        notes.append(f"bus '{name}': nothing was heard; check bitrate, cable and power")
    if masters:
        notes.append(
            f"bus '{name}': another master leads it ({masters}), so nothing was sent; take its PDOs as they are with "
            "listen_only: true"
        )
    if any(entry.extended for entry in seen):
        notes.append(
            f"bus '{name}': frames with 29 bits; if it is J1939, read them with type: can_signals and a DBC file"
        )
    return notes
