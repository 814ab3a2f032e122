"""A CANopen bus that another master leads: nothing is ever sent, PDOs are taken as they come.

Nodes need neither answer our SYNC nor send a heartbeat, and their mapping is what the machine file (``cob_id`` and
``byte`` of a source) or the node's EDS or DCF says it is. The cycle is paced by our clock, each value with its age
(:mod:`daq.drivers.can.listening`), or, with ``sync: external``, by the other master's SYNC. Then a PDO that is sampled
at SYNC belongs to the SYNC before it: half a period after that it is late.
"""

from __future__ import annotations

import math
import statistics
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from daq import wire
from daq.drivers.base import DriverContext, Problem, Samples
from daq.drivers.can.listening import FIRST_S, Inbox, Listener, Stream
from daq.drivers.can.port import CanPort
from daq.drivers.canopen.eds import Place, pdo_places
from daq.drivers.canopen.link import SYNC_ID, CanLink, Handler
from daq.errors import MachineFileError
from daq.frames.clock import NS
from daq.machine.machine_file import CanopenBus, CanSource, Channel
from daq.quality import Quality

EMERGENCY_ID = 0x080
RATE_TOLERANCE = 0.03  # of a SYNC's period against the machine file's
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
            f"PDO 0x{cob_id:03X}", f"node {node}", [m.position for m in members], event_ms * 1e6 if event_ms else None
        )
        self.members = tuple(members)
        self.inbox = Inbox(1)
        self.synchronous = any(member.place.synchronous for member in members)
        self.newest_ns = 0
        self.due = threading.Event()

    def receive(self, data: bytearray, at_ns: int) -> None:
        """In the receive thread."""
        self.inbox.receive(data, at_ns)
        self.newest_ns = at_ns
        self.due.set()


class ListeningDriver(Listener):
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
        super().__init__(bus, [channel.name for channel in channels], context)
        nothing_to_ask(bus, channels)
        self._bus = bus
        grouped: dict[int, list[Member]] = {}
        for member in pdo_members(bus, channels) if members is None else members:
            grouped.setdefault(member.place.cob_id, []).append(member)
        self._pdos = {cob_id: _Pdo(cob_id, members) for cob_id, members in grouped.items()}
        self.streams = [pdo.stream for pdo in self._pdos.values()]
        self.counts |= dict.fromkeys(("emergency", "sync"), 0)
        self._emergencies: dict[int, int] = {}
        self._external = bus.sync == "external"
        self._syncs: deque[int] = deque(maxlen=_SYNCS)
        self._sync_came = threading.Condition()
        self._taken_ns = 0  # the SYNC that next_sync told last
        self._led = False  # whether the cycle that is under way began with a SYNC
        self._wrong_rate = ""

    # The other master's SYNC

    @property
    def follows_sync(self) -> bool:
        """Whether the machine file wants the cycle to be led by this bus's SYNC."""
        return self._external

    @property
    def external_sync(self) -> bool:
        """Whether the cycle is to be led by :meth:`next_sync`: it is wanted, and SYNC comes at a rate that fits."""
        return self._external and not self._wrong_rate

    def next_sync(self, deadline_ns: int) -> int | None:
        """When the next SYNC came, monotonic ns, or None if none has until the deadline."""
        with self._sync_came:
            left = (deadline_ns - self.context.monotonic_ns()) / NS
            self._led = self._sync_came.wait_for(self._new_sync, max(0.0, left))
            if not self._led:
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
        if not self._external or self._port is None:
            return problems
        period_ns = self.context.period_s * NS
        allowed = min(FIRST_S, self.context.start_s or FIRST_S)
        with self._sync_came:
            self._sync_came.wait_for(lambda: len(self._syncs) == _SYNCS, allowed)
            steps = [after - before for before, after in zip(self._syncs, list(self._syncs)[1:], strict=False)]
        if not steps:
            line = f"bus '{self._bus.name}': no SYNC comes; start its master, or leave out sync: external"
            return (*problems, Problem(line, self._names))
        every = period_ns / statistics.median(steps)
        if abs(every / max(1, round(every)) - 1) > RATE_TOLERANCE:
            hz = NS / statistics.median(steps)
            self._wrong_rate = (
                f"bus '{self._bus.name}': SYNC comes at {hz:.4g} Hz, which is no multiple of the machine file's "
                "rate_hz; correct rate_hz, or leave out sync: external"
            )
            return (*problems, Problem(self._wrong_rate, self._names))
        return problems

    # Frames

    def connected(self) -> CanPort:
        """The bus, its PDOs into the inboxes."""
        made = CanLink(self._bus, self.context, self.health)
        for cob_id, pdo in self._pdos.items():
            made.handlers[cob_id] = pdo.receive
        for node in {member.source.node for pdo in self._pdos.values() for member in pdo.members}:
            made.handlers.setdefault(EMERGENCY_ID + node, self._on_emergency(node))
        if self._external:
            made.handlers[SYNC_ID] = self._on_sync
        return made

    def _on_emergency(self, node: int) -> Handler:
        def receive(data: bytearray, at_ns: int) -> None:
            code = int.from_bytes(data[:2], "little")
            if code & 0xFF00:
                self._emergencies[node] = code
                self.counts["emergency"] += 1
            else:
                self._emergencies.pop(node, None)

        return receive

    def trigger(self, cycle: int) -> None:
        """Nothing is sent; the cycle began at the other master's SYNC, or now."""
        super().trigger(cycle)
        if self._led:
            self.cycle_ns = self._taken_ns

    def collect(self, until_ns: int) -> Samples:
        """What came since the last cycle; of a cycle that a SYNC leads, what was sampled at it."""
        if self._led and self._port is not None and self._port.failure is None:
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

    def decode(self, samples: Samples) -> None:
        """The newest frame of every PDO."""
        for pdo in self._pdos.values():
            for data, at_ns, _ in pdo.inbox.taken():
                quality = self.came(pdo.stream, at_ns, samples)
                if pdo.synchronous and self._led:
                    quality = self._at_sync(pdo, at_ns, samples)
                for member in pdo.members:
                    self._member(pdo, data, member, quality, samples)

    def _at_sync(self, pdo: _Pdo, at_ns: int, samples: Samples) -> Quality:
        """A PDO that was sampled at SYNC: at which, and whether it was in time."""
        period_ns = self.context.period_s * NS
        behind_ns = at_ns - self.cycle_ns
        ago = max(0, math.ceil(-behind_ns / period_ns))
        for position in pdo.stream.positions:
            samples.cycles_ago[position] = ago
            samples.after_sync_s[position] = 0.0
        return Quality.LATE if ago or behind_ns > period_ns / 2 else Quality.FRESH

    def _member(self, pdo: _Pdo, data: bytes, member: Member, quality: Quality, samples: Samples) -> None:
        try:
            value = wire.from_bits(member.source.data_type, data, member.place.bit, member.place.bits)
        except ValueError:
            self.counts["short"] += 1
            pdo.stream.fault = (
                f"{pdo.stream.name} has {len(data)} bytes, fewer than its channels need; check byte, data_type"
            )
            samples.quality[member.position] = Quality.INVALID
            return
        emergency = member.source.node in self._emergencies
        self.value(member.position, value, Quality.EMERGENCY if emergency else quality, samples)

    def device_line(self, device: str) -> str:
        """Its emergency, or what is wrong with the SYNC that should lead."""
        code = self._emergencies.get(int(device.split()[1]))
        return self._wrong_rate if code is None else f"emergency 0x{code:04X}"


def pdo_members(bus: CanopenBus, channels: Sequence[Channel]) -> list[Member]:
    """Where each channel is: as its source says, else as the EDS of its node.

    Raises
    ------
    MachineFileError
        If neither says it.
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
            raise MachineFileError(
                f"bus '{bus.name}': is listen_only, so {channel.name} needs the PDO that carries it; add cob_id "
                f"and byte to its source, or eds to node {source.node}"
            )
        else:
            places = known.setdefault(source.node, {}) or pdo_places(eds, source.node, bus.name)
            known[source.node] = places
            place = _fits(bus, channel, source, places, eds)
        found.append(Member(position, source, place))
    return found


def nothing_to_ask(bus: CanopenBus, channels: Sequence[Channel]) -> None:
    """Raise MachineFileError if a channel's decimals would have to be asked for."""
    for channel in channels:
        if isinstance(channel.source, CanSource) and channel.source.told_decimals:
            raise MachineFileError(
                f"bus '{bus.name}': {channel.name}: nothing can be asked on this bus; give decimals instead of "
                "decimals_object"
            )


def _fits(
    bus: CanopenBus, channel: Channel, source: CanSource, places: dict[tuple[int, int], Place], eds: str
) -> Place:
    place = places.get((source.object, source.subindex))
    what = f"bus '{bus.name}': {channel.name}: object 0x{source.object:04X}:{source.subindex}"
    if place is None:
        raise MachineFileError(f"{what} is in no PDO of {eds}; add cob_id and byte to its source")
    size = 8 * wire.size(source.data_type)
    if place.bits > size or (place.bits != size and source.data_type.startswith("float")):
        raise MachineFileError(
            f"{what} has {place.bits} bits in {eds}, and {source.data_type} {size}; correct data_type"
        )
    return place
