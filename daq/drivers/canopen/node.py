"""What the driver knows of one CANopen node: its TPDOs as they arrive, its heartbeat, its emergencies.

A TPDO does not say which SYNC it answers, and one that is a whole period late arrives when the next one is due: by its
time alone it looks fresh. But a node sends each synchronous TPDO once per SYNC, and a bus keeps the order of one
identifier. So every SYNC that a node has been told to answer waits in a queue of each of its TPDOs, and what arrives is
credited to the oldest one (:class:`Tpdo`). A frame that is lost makes the next ones look late, never fresh; the driver
then starts the node anew (pre-operational and back), after which queue and node agree again.
"""

from __future__ import annotations

import struct
import threading
from collections import Counter, deque
from collections.abc import Sequence
from typing import NamedTuple

from daq.drivers.base import Spread, by_device
from daq.drivers.canopen.leadership import BOOT_UP
from daq.drivers.canopen.link import Handler, Sdo, SdoRefusedError
from daq.drivers.canopen.mapping import Mapping, map_node
from daq.drivers.decimals import Decimals
from daq.errors import CommissioningError
from daq.machine.buses import object_of
from daq.machine.machine_file import CanNode, CanopenBus, CanSource, Channel

MISSES_TOLERATED = 3  # cycles without any TPDO after which a node is not waited for any more
MISSES_LOST = 25  # cycles without any TPDO, the heartbeat going on, after which it is commissioned again
LATE_TOLERATED = 10  # cycles in a row with TPDOs of older SYNCs only after which it is started anew: is it slow?
WRONG_TOLERATED = 3  # TPDOs of a wrong length after which a node's mapping is taken for lost
SURPLUS_TOLERATED = 3  # cycles in a row with more TPDOs than SYNCs after which two devices share the node-ID
WATCHDOG_PERIODS = 2.5  # heartbeat periods without a sign of life
UNANSWERED = 50  # SYNCs that a TPDO may be behind; beyond, the oldest one is given up and the count is in doubt
_EMERGENCY = struct.Struct("<HB")


class Cycle:
    """The cycle that is under way, shared by the receive thread and the one that collects."""

    def __init__(self) -> None:
        self.number = 0
        self.sync_ns = 0
        self._lock = threading.Lock()
        self._pending: set[int] = set()
        self._whole = threading.Lock()  # held while something is pending; an Event takes three times as long

    def begin(self, number: int, sync_ns: int, expected: set[int]) -> None:
        """Start cycle ``number`` in which TPDOs of the COB-IDs ``expected`` are waited for."""
        with self._lock:
            self.number, self.sync_ns, self._pending = number, sync_ns, expected
            self._whole.acquire(blocking=False)
            if not expected:
                self._whole.release()

    def arrived(self, cob_id: int, number: int) -> None:
        """A TPDO of cycle ``number`` came."""
        with self._lock:
            if number == self.number and self._pending:
                self._pending.discard(cob_id)
                if not self._pending:
                    self._whole.release()

    def whole(self, seconds: float) -> bool:
        """Wait until all that is expected came; whether it did. For one thread at a time."""
        if not self._whole.acquire(timeout=max(0.0, seconds)):
            return False
        self._whole.release()
        return True


class Arrival(NamedTuple):
    """A TPDO's data, when it was on the bus, and the SYNC that it is credited to."""

    data: bytes
    at_ns: int
    cycle: int
    sync_ns: int
    ordinal: int  # of its TPDO, counted from 1
    during: int  # the cycle that was under way when it came


class Tpdo:
    """The last frame of one TPDO; :meth:`receive` runs in the receive thread.

    Attributes
    ----------
    latest : the newest one that a SYNC asked for
    count : how many of them came; the cycle has looked at those up to ``taken``
    surplus : frames that no SYNC asked for
    in_doubt : whether an unanswered SYNC was given up, so that the count may be wrong until the node is started anew
    """

    def __init__(self, mapping: Mapping, of: Cycle) -> None:
        self.mapping = mapping
        self.latest: Arrival | None = None
        self.count = 0
        self.taken = 0
        self.surplus = 0
        self.surplus_seen = 0
        self.wrong = 0
        self.wrong_length = 0
        self.in_doubt = False
        self.arrived_ns = 0
        self._of = of
        self._unanswered: deque[tuple[int, int]] = deque()

    def asked(self, number: int, sync_ns: int) -> None:
        """A SYNC is about to be sent that the node will answer."""
        if len(self._unanswered) >= UNANSWERED:
            self._unanswered.popleft()
            self.in_doubt = True
        self._unanswered.append((number, sync_ns))

    def give_up(self) -> None:
        """What is still due is taken for lost; should it come all the same, it must not pass for fresh."""
        if self._unanswered:
            self._unanswered.clear()
            self.in_doubt = True

    def receive(self, data: bytearray, now_ns: int) -> None:
        """Keep the bytes and the time, if the length is right; canopen itself accepts a short PDO without a word."""
        if len(data) != self.mapping.length:
            self.wrong_length = len(data)
            self.wrong += 1
            return
        self.arrived_ns = now_ns
        try:
            number, sync_ns = self._unanswered.popleft()
        except IndexError:
            self.surplus += 1
            return
        self.count += 1
        self.latest = Arrival(bytes(data), now_ns, number, sync_ns, self.count, self._of.number)
        self._of.arrived(self.mapping.cob_id, number)

    def forget(self) -> None:
        """What came and what was asked does not count."""
        self._unanswered.clear()
        self.latest = None
        self.count = self.taken = 0
        self.surplus_seen = self.surplus
        self.wrong_length = 0
        self.in_doubt = False


class Node:
    """State of one node.

    ``state`` is ``commissioning``, ``running``, ``silent`` or ``failed``; it changes in the driver's threads, never in
    the receive thread, which only leaves time stamps, counts and bytes behind.
    """

    def __init__(self, config: CanNode, place: str, mappings: tuple[Mapping, ...], cycle: Cycle) -> None:
        self.config = config
        self.place = place
        self.mappings = mappings
        self.tpdos = tuple(Tpdo(mapping, cycle) for mapping in mappings)
        self.cob_ids = frozenset(mapping.cob_id for mapping in mappings)
        self.latency = Spread()  # of its TPDOs after the SYNC that they answer
        self.heartbeat_ms = config.heartbeat_ms  # as it says itself; 0: it sends none
        self.objects: dict[str, int | str] = {}  # what it said of itself, once it ran
        self.to_be_asked = False
        self.decimals: dict[int, Decimals] = {}  # by position, of channels whose decimals the device tells
        self.decimals_objects: dict[int, str] = {}  # by position, where
        self.state = "commissioning"
        self.detail = ""
        self.away = ""  # short name of why it is not running
        self.cause = ""  # of its last absence, kept when it is back
        self.watched_ns = 0  # since when its heartbeat has been due
        self.limit_ns = 0.0  # that it may give no sign of life, once it runs
        self.heartbeat_lost = False
        self.operational = False  # whether it was told to answer SYNCs
        self.starting_anew = False
        self.slow = False  # it is late, and nobody miscounted
        self.misses = 0
        self.late_run = 0  # cycles with late TPDOs only
        self.behind_run = 0  # with TPDOs of older SYNCs only
        self.surplus_run = 0
        self.emergency: int | None = None
        self.emergencies: Counter[int] = Counter()  # by code, since the start; 0 is "error reset"
        self.errors = 0  # EMCY messages so far that told of an error
        self.emergencies_seen = 0
        self.heartbeat_ns = 0
        self.heartbeat_state = -1
        self.found_state: int | None = None  # by its heartbeat, before anything was sent to it; -1: it sent none
        self.boot_ups = 0
        self.boot_ups_seen = 0
        self.wrong_seen = 0
        self.wrong_run = 0

    def handlers(self) -> dict[int, Handler]:
        """What to call for which COB-ID."""
        found: dict[int, Handler] = {t.mapping.cob_id: t.receive for t in self.tpdos}
        found[0x700 + self.config.node] = self.on_heartbeat
        found[0x080 + self.config.node] = self.on_emergency
        return found

    def on_heartbeat(self, data: bytearray, now_ns: int) -> None:
        """Heartbeat or boot-up message; bit 7 is node guarding's toggle bit."""
        state = data[0] & 0x7F if data else -1
        self.heartbeat_ns = now_ns
        self.heartbeat_state = state
        if state == BOOT_UP:
            self.boot_ups += 1

    def on_emergency(self, data: bytearray, now_ns: int) -> None:
        """EMCY message: 16 bits of error code first; 0x00xx says that the error is gone (CiA 301, 7.2.7)."""
        if len(data) < _EMERGENCY.size:
            return
        code = int(_EMERGENCY.unpack_from(data)[0])
        self.emergency = code if code & 0xFF00 else None
        self.emergencies[code if code & 0xFF00 else 0] += 1
        self.errors += bool(code & 0xFF00)

    def wrong_lengths(self) -> int:
        """TPDOs of a wrong length so far."""
        found = 0
        for tpdo in self.tpdos:  # once per cycle and node: cheaper than a generator
            found += tpdo.wrong
        return found

    def take_surplus(self) -> int:
        """TPDOs that no SYNC asked for, since the last look."""
        found = 0
        for tpdo in self.tpdos:
            found += tpdo.surplus - tpdo.surplus_seen
            tpdo.surplus_seen = tpdo.surplus
        return found

    def last_tpdo_ns(self) -> int:
        """When the last TPDO came."""
        newest = 0
        for tpdo in self.tpdos:
            if tpdo.arrived_ns > newest:
                newest = tpdo.arrived_ns
        return newest

    def short(self) -> str | None:
        """A line about a TPDO of the wrong length, if one came since the last commissioning."""
        for tpdo in self.tpdos:
            if tpdo.wrong_length:
                return (
                    f"{self.place}: TPDO{tpdo.mapping.number} has {tpdo.wrong_length} bytes instead of "
                    f"{tpdo.mapping.length}; its mapping is not the one that was written: see its manual"
                )
        return None

    def forget(self) -> None:
        """Before a commissioning: what came so far does not count, and it answers no SYNC."""
        self.operational = False
        self.emergency = None
        self.heartbeat_state = -1
        self.wrong_seen = self.wrong_lengths()
        self.wrong_run = 0
        self.slow = False
        self.forget_answers()

    def forget_answers(self) -> None:
        """What came on SYNC so far does not count."""
        self.misses = self.late_run = self.behind_run = self.surplus_run = 0
        for tpdo in self.tpdos:
            tpdo.forget()

    def in_doubt(self) -> bool:
        """Whether its TPDOs may be credited to the wrong SYNC."""
        for tpdo in self.tpdos:  # noqa: SIM110  # once per cycle and node: cheaper than a generator
            if tpdo.in_doubt:
                return True
        return False

    def learn(self, sdo: Sdo) -> None:
        """Ask for its heartbeat time, and the decimals of its channels (CommissioningError if none, or too many)."""
        try:
            self.heartbeat_ms = sdo.read_unsigned(0x1017)
        except SdoRefusedError:
            self.heartbeat_ms = 0
        for position, text in self.decimals_objects.items():
            places = sdo.read_unsigned(*object_of(text))
            if not self.decimals[position].learn(places):
                raise CommissioningError(
                    f"{self.place}: says {places} decimals ({text}), which cannot be; correct decimals_object"
                )

    def accept_boot_ups(self) -> None:
        """Boot-ups up to now are no news."""
        self.boot_ups_seen = self.boot_ups

    def complete(self) -> bool:
        """Whether every TPDO came at least once since :meth:`forget`."""
        return all(tpdo.count > 0 for tpdo in self.tpdos)


def make_nodes(bus: CanopenBus, channels: Sequence[Channel], cycle: Cycle) -> dict[int, Node]:
    """The nodes that the channels of a bus come from, by node-ID, each with its mapping."""
    known = {node.node: node for node in bus.nodes}
    nodes = {}
    for number, members in by_device(channels, lambda source: source.node).items():
        place = f"bus '{bus.name}' node {number} ({', '.join(c.name for _, c in members[:3])})"
        config = known.get(number) or CanNode(node=number)
        node = nodes[number] = Node(config, place, map_node(number, members, place), cycle)
        for position, channel in members:
            assert isinstance(channel.source, CanSource)
            if channel.source.decimals_object is not None:
                node.decimals[position] = Decimals(channel.source.sentinels)
                node.decimals_objects[position] = channel.source.decimals_object
    return nodes
