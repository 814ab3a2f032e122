"""A CANopen bus that another master leads: nothing is ever sent, PDOs are taken as they come.

Nodes need neither answer our SYNC nor send a heartbeat, and their mapping is what the machine file (``cob_id`` and
``byte`` of a source) or the node's EDS or DCF says it is. The cycle is paced by our clock, each value with its age
(:mod:`daq.drivers.listening`), or, with ``sync: external``, by the other master's SYNC. Then a PDO that is sampled
at SYNC belongs to the SYNC before it: half a period after that it is late.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from daq.drivers import wire
from daq.drivers.base import Answers, DriverContext, Problem, Samples, by_device
from daq.drivers.can.health import CanDriver
from daq.drivers.can.port import CanPort
from daq.drivers.canopen.eds import Place, pdo_places
from daq.drivers.canopen.leadership import SYNC_ID
from daq.drivers.canopen.link import CanLink, Handler
from daq.drivers.canopen.mapping import laid_out, map_node
from daq.drivers.listening import FIRST_S, Inbox, Listener, Stream
from daq.errors import MachineFileError
from daq.frames.clock import NS
from daq.machine.machine_file import CanopenBus, CanSource, Channel
from daq.messages import Sentence
from daq.quality import Quality

EMERGENCY_ID, HEARTBEAT_ID, SDO_ID = 0x080, 0x700, 0x600
RATE_TOLERANCE = 0.03  # of a SYNC's period against the machine file's
STANDARD_ERRORS = 4
_SYNCS = 16
_RECENT_PERIODS = 4  # a PDO that has not come for so long is not waited for


@dataclass(frozen=True)
class Member:
    """A channel of a PDO: its position in the driver's order, source and place."""

    position: int
    source: CanSource
    place: Place


class _Pdo:
    """One PDO that is listened to."""

    def __init__(self, cob_id: int, members: Sequence[Member]) -> None:
        node = members[0].source.node
        event_ms = max(member.place.event_ms for member in members)
        self.stream = Stream(
            f"PDO 0x{cob_id:03X}",
            Sentence("daq.node_number", number=node),
            [m.position for m in members],
            event_ms * 1e6 if event_ms else None,
        )
        self.members = tuple(members)
        self.node = node
        self.length = members[0].place.length  # 0 while nobody said it and nothing came
        self.inbox = Inbox(4)  # of one sender the newest counts; more of them are for telling two apart
        self.synchronous = any(member.place.synchronous for member in members)
        self.newest_ns = 0
        self.due = threading.Event()

    def receive(self, data: bytearray, at_ns: int) -> None:
        """Receive, in the receive thread."""
        self.inbox.receive(data, at_ns)
        self.newest_ns = at_ns
        self.due.set()


class ListeningDriver(Listener, CanDriver):
    """CANopen PDOs of a bus that is not ours (see :class:`daq.drivers.base.Driver`).

    Parameters
    ----------
    members : where each channel is; None: as sources and EDS files say
    """

    def __init__(
        self,
        bus: CanopenBus,
        channels: Sequence[Channel],
        context: DriverContext,
        members: Sequence[Member] | None = None,
    ) -> None:
        super().__init__(bus, [channel.name for channel in channels], context, ("emergency", "boot_up", "sync"))
        self._bus = bus
        grouped: dict[int, list[Member]] = {}
        for member in pdo_members(bus, channels) if members is None else members:
            grouped.setdefault(member.place.cob_id, []).append(member)
        self._pdos = {cob_id: _Pdo(cob_id, members) for cob_id, members in grouped.items()}
        self.streams = [pdo.stream for pdo in self._pdos.values()]
        self.refused: dict[int, str] = {}  # nodes of which nothing is taken, and why
        self._emergencies: dict[int, int] = {}
        self._external = bus.sync == "external"
        self._syncs: deque[int] = deque(maxlen=_SYNCS)
        self._sync_came = threading.Condition()
        self._taken_ns = 0  # the SYNC that next_sync returned last
        self._wrong_rate = ""
        self._fits = False

    # The other master's SYNC

    @property
    def follows_sync(self) -> bool:
        """True if the machine file wants the cycle to be led by this bus's SYNC."""
        return self._external

    @property
    def external_sync(self) -> bool:
        """True if the cycle is led by :meth:`next_sync`: it is wanted, and SYNC comes at a rate that fits."""
        if not self._fits and self._external and not self._wrong_rate and len(self._syncs) == _SYNCS:
            with self._sync_came:
                self._judge_rate()
        return self._fits

    def _judge_rate(self) -> None:
        """Judge SYNC's period, its mean over the span: within a tolerance and four standard errors."""
        steps = np.diff(self._syncs)
        if not len(steps):
            return
        mean = float(steps.mean())
        error = float(steps.std(ddof=1)) / math.sqrt(len(steps)) if len(steps) > 1 else 0.0
        every = self.context.period_s * NS / mean
        self._fits = abs(every / max(1, round(every)) - 1) <= RATE_TOLERANCE + STANDARD_ERRORS * error / mean
        if not self._fits:
            self._wrong_rate = Sentence("daq.sync_no_multiple", bus=self._bus.name, rate=NS / mean)

    def next_sync(self, deadline_ns: int) -> int | None:
        """Return the monotonic ns of the next SYNC, or None at the deadline."""
        with self._sync_came:
            left = (deadline_ns - self.context.monotonic_ns()) / NS
            self.led = self._sync_came.wait_for(self._new_sync, max(0.0, left))
            if not self.led:
                return None
            self._taken_ns = self._syncs[-1]
            return self._taken_ns

    def _new_sync(self) -> bool:
        return bool(self._syncs) and self._syncs[-1] > self._taken_ns

    def _on_sync(self, data: bytearray, at_ns: int) -> None:
        with self._sync_came:
            self._syncs.append(at_ns)
            self.counts["sync"] += 1
            self._sync_came.notify()

    def start(self) -> tuple[str, ...]:
        """Open the bus, wait a moment for every PDO, and for some SYNCs where they lead."""
        problems = super().start()
        if not self._external or self.port is None:
            return problems
        with self._sync_came:
            self._sync_came.wait_for(lambda: len(self._syncs) == _SYNCS, self.context.at_start(FIRST_S))
            self._judge_rate()
        line = self._wrong_rate
        if len(self._syncs) < 2:
            line = Sentence("daq.bus_no_sync_comes", bus=self._bus.name)
        return (*problems, Problem(line, self._names)) if line else problems

    # Frames

    def connected(self) -> CanPort:
        """Connect the bus, its PDOs into the inboxes."""
        made = CanLink(self._bus, self.context, self.health)
        self.attach(made)
        return made

    def attach(self, link: CanLink) -> None:
        """Attach a link's frames."""
        handlers: dict[int, Handler] = {cob_id: pdo.receive for cob_id, pdo in self._pdos.items()}
        for node in {pdo.node for pdo in self._pdos.values()}:
            handlers.setdefault(EMERGENCY_ID + node, partial(self._on_emergency, node))
            handlers.setdefault(HEARTBEAT_ID + node, partial(self._on_heartbeat, node))
        if self._external:
            handlers[SYNC_ID] = self._on_sync
        link.handlers |= handlers

    def _on_emergency(self, node: int, data: bytearray, at_ns: int) -> None:
        code = int.from_bytes(data[:2], "little")
        name = f"{self._bus.name}/node {node}"
        if code & 0xFF00:
            self._emergencies[node] = code
            self.counts["emergency"] += 1
            self.context.events.begin(
                name,
                "emergency",
                Sentence("daq.bus_node_emergency", bus=self._bus.name, node=node, emergency=f"{code:04X}"),
            )
        elif self._emergencies.pop(node, None) is not None:
            self.context.events.end(name, "emergency")

    def _on_heartbeat(self, node: int, data: bytearray, at_ns: int) -> None:
        if bytes(data[:1]) != b"\0":
            return
        name = f"{self._bus.name}/node {node}"
        self.counts["boot_up"] += 1
        self.context.events.note(name, "boot_up", Sentence("daq.bus_node_booted", bus=self._bus.name, node=node))
        if self._emergencies.pop(node, None) is not None:
            self.context.events.end(name, "emergency")
        self.booted(node)

    def booted(self, node: int) -> None:
        """Note that a node booted; its mapping is known to its master."""

    def trigger(self, cycle: int) -> None:
        """Send nothing; the cycle began at the other master's SYNC, or now."""
        super().trigger(cycle)
        if self.led:
            self.cycle_ns = self._taken_ns

    def collect(self, until_ns: int) -> Samples:
        """Collect what came since the last cycle; of a SYNC-led cycle, what was sampled at it."""
        if self.led and self.port is not None and self.port.failure is None:
            self._await(until_ns)
        return super().collect(until_ns)

    def _await(self, until_ns: int) -> None:
        recent = self.cycle_ns - _RECENT_PERIODS * self.context.period_s * NS
        for pdo in self._pdos.values():
            while pdo.synchronous and recent < pdo.newest_ns < self.cycle_ns:
                left = (until_ns - self.context.monotonic_ns()) / NS
                pdo.due.clear()
                if left <= 0 or (pdo.newest_ns < self.cycle_ns and not pdo.due.wait(left)):
                    return

    def decode(self, answers: Answers) -> None:
        """Decode the newest frame of every PDO."""
        for pdo in self._pdos.values():
            for data, at_ns, _ in pdo.inbox.taken():
                quality = self.came(pdo.stream, at_ns, answers)
                if quality != Quality.INVALID and pdo.synchronous and self.led:
                    quality = self._at_sync(pdo, at_ns, answers)
                if fault := self._fault(pdo, data):
                    quality, pdo.stream.fault = Quality.INVALID, fault
                elif quality != Quality.INVALID and pdo.node in self._emergencies:
                    quality = Quality.EMERGENCY
                for member in pdo.members:
                    known = quality != Quality.INVALID
                    place = member.place
                    value = wire.from_bits(member.source.data_type, data, place.bit, place.bits) if known else math.nan
                    answers.value(member.position, value, quality)
                if quality != Quality.INVALID:
                    self.alike(pdo.stream, answers)

    def _fault(self, pdo: _Pdo, data: bytes) -> str:
        """Return why nothing of a frame is taken; empty if it is."""
        if pdo.node in self.refused:
            return self.refused[pdo.node]
        pdo.length = pdo.length or max(len(data), *(-(-(m.place.bit + m.place.bits) // 8) for m in pdo.members))
        if len(data) == pdo.length:
            return ""
        self.counts["short"] += 1
        return Sentence("daq.bytes_instead_other_mapping", stream=pdo.stream.name, bytes=len(data), length=pdo.length)

    def _at_sync(self, pdo: _Pdo, at_ns: int, answers: Answers) -> Quality:
        """Judge a PDO sampled at SYNC: at which, and whether in time."""
        period_ns = self.context.period_s * NS
        with self._sync_came:  # the receiving thread adds to them
            sync_ns = max((sync for sync in self._syncs if self.cycle_ns < sync <= at_ns), default=self.cycle_ns)
        behind_ns = at_ns - sync_ns
        ago = max(0, math.ceil(-behind_ns / period_ns))
        for position in pdo.stream.positions:
            answers.cycles_ago[position] = ago
            answers.after_sync_s[position] = (sync_ns - self.cycle_ns) / NS
        return Quality.LATE if ago or self.late(sync_ns, behind_ns, 0.5) else Quality.FRESH

    def device_line(self, device: str) -> str:
        """Return its emergency, or what is wrong with the SYNC that should lead."""
        code = self._emergencies.get(int(device.split()[1]))
        return self._wrong_rate if code is None else f"emergency 0x{code:04X}"


class Guest(ListeningDriver):
    """Takes over a bus that we led until another master was noticed: TPDOs as we commissioned them, nothing is sent.

    Of a node whose mapping may be another one nothing is taken any more: one that boots loses ours, and what is
    written to its PDO objects is not ours.

    Parameters
    ----------
    refused : nodes that are not commissioned, and why
    """

    def __init__(
        self, bus: CanopenBus, channels: Sequence[Channel], context: DriverContext, refused: Mapping[int, str]
    ) -> None:
        followed = bus.model_copy(update={"listen_only": True, "sync": "external"})
        members = [member for member in commissioned(bus, channels) if not member.source.asks_decimals]
        super().__init__(followed, channels, context, members)
        self.refused |= refused

    def attach(self, link: CanLink) -> None:
        """Attach as any listener, and to what the other master writes."""
        super().attach(link)
        for pdo in self._pdos.values():
            link.handlers[SDO_ID + pdo.node] = partial(self._on_request, pdo.node)

    def _on_request(self, node: int, data: bytearray, at_ns: int) -> None:
        if len(data) >= 3 and data[0] >> 5 == 1 and 0x1800 <= int.from_bytes(data[1:3], "little") < 0x1C00:
            self._refuse(node, "another master changes its PDOs")

    def booted(self, node: int) -> None:
        """Note that its mapping is not ours any more."""
        self._refuse(node, "it booted, and its mapping is another one")

    def _refuse(self, node: int, why: str) -> None:
        self.refused.setdefault(node, Sentence("daq.describe_its_pdos", bus=self._bus.name, node=node, why=why))


def commissioned(bus: CanopenBus, channels: Sequence[Channel]) -> list[Member]:
    """Return the channels' places in the TPDOs that commissioning maps."""
    found = []
    for node, members in by_device(channels, lambda source: source.node).items():
        for mapping in map_node(node, members, Sentence("daq.bus_node", bus_name=bus.name, node=node)):
            for (_, _, bit, bits), positions in zip(laid_out(mapping.entries), mapping.positions, strict=True):
                place = Place(mapping.cob_id, bit, bits, True, 0, mapping.length)
                for position in positions:
                    source = channels[position].source
                    assert isinstance(source, CanSource)
                    found.append(Member(position, source, place))
    return found


def pdo_members(bus: CanopenBus, channels: Sequence[Channel]) -> list[Member]:
    """Return each channel's place: of its source, else of the EDS of its node.

    Raises
    ------
    MachineFileError
        If neither has it.
    """
    nothing_to_ask(bus, channels)
    files = {node.node: node.eds for node in bus.nodes}
    known: dict[int, dict[tuple[int, int], Place]] = {}
    found = []
    for position, channel in enumerate(channels):
        source = channel.source
        assert isinstance(source, CanSource)
        eds = files.get(source.node)
        if source.cob_id is not None:
            place = Place(source.cob_id, 8 * source.byte, 8 * wire.size(source.data_type), source.synchronous, 0)
        elif eds is None:
            raise MachineFileError("daq.needs_its_pdo", bus=bus.name, channel=channel.name, node=source.node)
        else:
            places = known.setdefault(source.node, {}) or pdo_places(eds, source.node, bus.name)
            known[source.node] = places
            place = _fits(bus, channel, source, places, eds)
        found.append(Member(position, source, place))
    return found


def nothing_to_ask(bus: CanopenBus, channels: Sequence[Channel]) -> None:
    """Raise MachineFileError if a channel's decimals would have to be asked for."""
    for channel in channels:
        if isinstance(channel.source, CanSource) and channel.source.asks_decimals:
            raise MachineFileError("daq.nothing_asked_here", bus=bus.name, channel=channel.name)


def _fits(
    bus: CanopenBus, channel: Channel, source: CanSource, places: dict[tuple[int, int], Place], eds: str
) -> Place:
    place = places.get((source.object, source.subindex))
    what = Sentence(
        "daq.channel_object",
        bus=bus.name,
        channel=channel.name,
        object=f"{source.object:04X}",
        subindex=source.subindex,
    )
    if place is None:
        raise MachineFileError("daq.in_no_pdo", what=what, eds=eds)
    size = 8 * wire.size(source.data_type)
    if place.bits > size or (place.bits != size and source.data_type.startswith("float")):
        raise MachineFileError(
            "daq.has_other_size", what=what, bits=place.bits, eds=eds, data_type=source.data_type, size=size
        )
    return place
