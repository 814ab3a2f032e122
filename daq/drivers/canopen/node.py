"""A CANopen node that we lead: what is known of it, and what is noticed about it once per cycle.

Boot-ups, emergencies, wrong lengths, surplus TPDOs and silence are noticed and said; what is to be done about them the
driver hands to the node's keeper.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import MutableMapping, Sequence

from daq.drivers.base import DriverContext, Spread, by_device
from daq.drivers.canopen.leadership import BOOT_UP, OPERATIONAL, PRE_OPERATIONAL, STOPPED, Leadership
from daq.drivers.canopen.link import Handler, Sdo, SdoRefusedError
from daq.drivers.canopen.mapping import Mapping, map_node
from daq.drivers.canopen.tpdo import Cycle, Tpdo
from daq.drivers.wire import Decimals
from daq.errors import CommissioningError
from daq.frames.clock import NS
from daq.machine.buses import object_of
from daq.machine.machine_file import CanNode, CanopenBus, CanSource, Channel
from daq.messages import Sentence

MISSES_TOLERATED = 3  # cycles without any TPDO after which a node is not waited for any more
MISSES_LOST = 25  # cycles without any TPDO, the heartbeat going on, after which it is commissioned again
LATE_TOLERATED = 10  # cycles in a row with TPDOs of older SYNCs only after which it is started anew: is it slow?
WRONG_TOLERATED = 3  # TPDOs of a wrong length after which a node's mapping is taken for lost
SURPLUS_TOLERATED = 3  # cycles in a row with more TPDOs than SYNCs after which two devices share the node-ID
WATCHDOG_PERIODS = 2.5  # heartbeat periods without a sign of life
_EMERGENCY = struct.Struct("<HB")
NO_HEARTBEAT_MS = 100  # that takes its place for a node whose TPDOs alone say that it lives


class Node:
    """State of one node.

    ``state`` is ``commissioning``, ``running``, ``silent`` or ``failed``; it changes in the driver's threads, never in
    the receive thread, which only leaves time stamps, counts and bytes behind.

    Parameters
    ----------
    config : what it must be
    bus, place : names of its bus, and of itself in errors
    counts : the driver's counters, which it adds to
    """

    def __init__(
        self,
        config: CanNode,
        bus: str,
        place: str,
        mappings: tuple[Mapping, ...],
        cycle: Cycle,
        context: DriverContext,
        counts: MutableMapping[str, int],
    ) -> None:
        self.config = config
        self.place = place
        self._name = f"{bus}/node {config.node}"
        self._context = context
        self._counts = counts
        self.leadership: Leadership | None = None  # of its bus
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
        self.operational = False  # whether it was ordered to answer SYNCs
        self.starting_anew = False
        self.slow = False  # it is late, and nobody miscounted
        self.misses = 0
        self.late_run = 0  # cycles with late TPDOs only
        self.behind_run = 0  # with TPDOs of older SYNCs only
        self.surplus_run = 0
        self.emergency: int | None = None
        self.emergencies: Counter[int] = Counter()  # by code, since the start; 0 is "error reset"
        self.errors = 0  # EMCY messages so far about an error
        self.emergencies_seen = 0
        self.heartbeat_ns = 0
        self.heartbeat_state = -1
        self.found_state: int | None = None  # by its heartbeat, before anything was sent to it; -1: it sent none
        self.boot_ups = 0
        self.boot_ups_seen = 0
        self.wrong_seen = 0
        self.wrong_run = 0

    def handlers(self) -> dict[int, Handler]:
        """Return the handler of each COB-ID."""
        found: dict[int, Handler] = {t.mapping.cob_id: t.receive for t in self.tpdos}
        found[0x700 + self.config.node] = self.on_heartbeat
        found[0x080 + self.config.node] = self.on_emergency
        return found

    def on_heartbeat(self, data: bytearray, now_ns: int) -> None:
        """Handle a heartbeat or boot-up message; bit 7 is node guarding's toggle."""
        state = data[0] & 0x7F if data else -1
        self.heartbeat_ns = now_ns
        self.heartbeat_state = state
        if state == BOOT_UP:
            self.boot_ups += 1

    def on_emergency(self, data: bytearray, now_ns: int) -> None:
        """Handle EMCY: 16 bits of error code first; 0x00xx reports that the error is gone (CiA 301, 7.2.7)."""
        if len(data) < _EMERGENCY.size:
            return
        code = int(_EMERGENCY.unpack_from(data)[0])
        self.emergency = code if code & 0xFF00 else None
        self.emergencies[code if code & 0xFF00 else 0] += 1
        self.errors += bool(code & 0xFF00)

    def wrong_lengths(self) -> int:
        """Count TPDOs of a wrong length."""
        found = 0
        for tpdo in self.tpdos:  # once per cycle and node: cheaper than a generator
            found += tpdo.wrong
        return found

    def take_surplus(self) -> int:
        """Count TPDOs that no SYNC asked for, since the last look."""
        found = 0
        for tpdo in self.tpdos:
            found += tpdo.surplus - tpdo.surplus_seen
            tpdo.surplus_seen = tpdo.surplus
        return found

    def last_tpdo_ns(self) -> int:
        """Return when the last TPDO came."""
        newest = 0
        for tpdo in self.tpdos:
            if tpdo.arrived_ns > newest:
                newest = tpdo.arrived_ns
        return newest

    def short(self) -> str | None:
        """Word a TPDO of the wrong length, if one came since the last commissioning."""
        for tpdo in self.tpdos:
            if tpdo.wrong_length:
                return Sentence(
                    "daq.tpdo_bytes_instead",
                    place=self.place,
                    number=tpdo.mapping.number,
                    wrong_length=tpdo.wrong_length,
                    length=tpdo.mapping.length,
                )
        return None

    def forget(self) -> None:
        """Forget before a commissioning what came so far: it answers no SYNC."""
        self.operational = False
        self.emergency = None
        self.heartbeat_state = -1
        self.wrong_seen = self.wrong_lengths()
        self.wrong_run = 0
        self.slow = False
        self.forget_answers()

    def forget_answers(self) -> None:
        """Forget what came on SYNC so far."""
        self.misses = self.late_run = self.behind_run = self.surplus_run = 0
        for tpdo in self.tpdos:
            tpdo.forget()

    def ambiguous(self) -> bool:
        """Return whether its TPDOs may be credited to the wrong SYNC."""
        for tpdo in self.tpdos:  # noqa: SIM110  # once per cycle and node: cheaper than a generator
            if tpdo.ambiguous:
                return True
        return False

    def learn(self, sdo: Sdo) -> None:
        """Ask for its heartbeat time, and its channels' decimals (CommissioningError if none, or too many)."""
        try:
            self.heartbeat_ms = sdo.read_unsigned(0x1017)
        except SdoRefusedError:
            self.heartbeat_ms = 0
        for position, text in self.decimals_objects.items():
            places = sdo.read_unsigned(*object_of(text))
            if not self.decimals[position].learn(places):
                raise CommissioningError("daq.says_decimals_cannot", place=self.place, places=places, text=text)

    def accept_boot_ups(self) -> None:
        """Ignore boot-ups up to now."""
        self.boot_ups_seen = self.boot_ups

    def complete(self) -> bool:
        """Return whether every TPDO came at least once since :meth:`forget`."""
        return all(tpdo.count > 0 for tpdo in self.tpdos)

    # What is noticed

    def gone(self, state: str, what: str, detail: str) -> None:
        """Note that it is not running any more (or still not), and why."""
        self.state, self.detail = state, detail
        if not self.away:
            self.away = what
            self.cause = detail
            self._context.events.begin(self._name, what, detail)
        elif what != self.away:
            self.cause = detail
            self._context.events.note(self._name, what, detail)

    def back(self) -> None:
        """Note that it runs."""
        self.state, self.detail, self.misses = "running", "", 0
        self.watched_ns = self._context.monotonic_ns()
        heartbeat_s = WATCHDOG_PERIODS * max((self.heartbeat_ms or NO_HEARTBEAT_MS) * 1e-3, self._context.period_s)
        self.limit_ns = max(heartbeat_s, self._context.patience_s) * NS
        if self.away:
            seconds = self._context.events.end(self._name, self.away)
            self.cause = Sentence("daq.was_away", cause=self.cause, seconds=seconds or 0.0)
            self.away = ""

    def look(self, received_ns: int) -> bool:
        """Notice what happened to it until ``received_ns``; whether its keeper has to see to it at once."""
        if self.errors != self.emergencies_seen:
            self._emergencies()
        if self.boot_ups != self.boot_ups_seen and self.state != "commissioning":
            self.boot_ups_seen = self.boot_ups
            self._counts["boot_up"] += 1
            self.operational = False
            self.gone("commissioning", "boot_up", Sentence("daq.booted_being_commissioned_again", place=self.place))
            return True
        if self.state not in ("running", "silent"):
            return False
        surplus = self.take_surplus()
        self._counts["surplus"] += surplus
        self.surplus_run = self.surplus_run + 1 if surplus else 0
        wrong = self.wrong_lengths() - self.wrong_seen
        if wrong:
            self._counts["short_pdo"] += wrong
            self.wrong_seen += wrong
            self.wrong_run += wrong
            if self.wrong_run >= WRONG_TOLERATED:
                self.gone(
                    "commissioning", "short_pdo", self.short() or Sentence("daq.tpdos_wrong_length", place=self.place)
                )
                return True
        return self._signs_of_life(received_ns)

    def _emergencies(self) -> None:
        errors = self.errors
        new = errors - self.emergencies_seen
        self.emergencies_seen = errors
        self._counts["emergency"] += new
        code = "reset since" if self.emergency is None else f"0x{self.emergency:04X}"
        text = Sentence("daq.emergency_see_manual", place=self.place, code=code)
        self._context.events.note(self._name, "emergency", text, new)

    def _signs_of_life(self, now: int) -> bool:
        limit = self.limit_ns
        if self.state == "running" and now - self.heartbeat_ns <= limit and not (self.misses or self.heartbeat_lost):
            return False  # as nearly always: what follows would find nothing
        alive = max(self.heartbeat_ns, self.last_tpdo_ns())
        if self.state == "running" and now - alive > limit:
            self._counts["silent"] += 1
            self.gone(
                "silent",
                "silent",
                Sentence("daq.no_heartbeat", place=self.place, now=(now - alive) / NS),
            )
            return False
        if self.state == "silent":
            if now - alive <= limit and self.heartbeat_state == OPERATIONAL:
                self.back()  # only the cable was out: its mapping is still there
            return False
        self._heartbeat(now - max(self.heartbeat_ns, self.watched_ns), limit)
        if self._out_of_step():
            self.gone("commissioning", "no_tpdos", Sentence("daq.sends_no_tpdos", place=self.place))
            return True
        return False

    def _heartbeat(self, since_ns: int, limit_ns: float) -> None:
        """Check its heartbeat while its TPDOs come."""
        lost = since_ns > limit_ns and self.heartbeat_ms > 0
        if lost and not self.heartbeat_lost:
            self._counts["heartbeat_lost"] += 1
            self._context.events.begin(self._name, "heartbeat_lost", self._no_heartbeat())
        elif self.heartbeat_lost and not lost:
            self._context.events.end(self._name, "heartbeat_lost")
        self.heartbeat_lost = lost

    def _no_heartbeat(self) -> str:
        return Sentence("daq.tpdos_come_but_no", place=self.place)

    def _out_of_step(self) -> bool:
        """Return whether it is alive but out of its commissioned state by its own doing, not another master's."""
        if self.starting_anew:
            return False
        if self.heartbeat_state in (PRE_OPERATIONAL, STOPPED):
            by_itself = self.leadership is None or self.leadership.excused(self.config.node)
            return by_itself and self.misses >= MISSES_TOLERATED
        return self.misses >= MISSES_LOST

    def miscounted(self, brought: int) -> bool:
        """Return whether TPDOs may be credited to wrong SYNCs, so that it must restart."""
        if not brought:
            return False
        return self.ambiguous() or (self.behind_run >= LATE_TOLERATED and not self.slow)

    def line(self) -> str:
        """Return what there is to report about it, also while it runs."""
        if self.detail:
            return self.detail
        if self.emergency is not None:
            return f"emergency 0x{self.emergency:04X}"
        if self.heartbeat_lost:
            return self._no_heartbeat()
        if self.slow:
            arrivals = [tpdo.latest for tpdo in self.tpdos if tpdo.latest is not None]
            worst = max(((a.at_ns - a.sync_ns) / 1e6 for a in arrivals), default=0.0)
            return Sentence("daq.tpdos_come_ms_after", place=self.place, worst=worst)
        return self.cause


def make_nodes(
    bus: CanopenBus,
    channels: Sequence[Channel],
    cycle: Cycle,
    context: DriverContext,
    counts: MutableMapping[str, int],
) -> dict[int, Node]:
    """Make the nodes of a bus's channels, by node-ID, each with its mapping."""
    known = {node.node: node for node in bus.nodes}
    nodes = {}
    for number, members in by_device(channels, lambda source: source.node).items():
        place = Sentence(
            "daq.bus_node_named", bus=bus.name, number=number, member=", ".join((c.name for _, c in members[:3]))
        )
        config = known.get(number) or CanNode(node=number)
        mappings = map_node(number, members, place)
        node = nodes[number] = Node(config, bus.name, place, mappings, cycle, context, counts)
        for position, channel in members:
            assert isinstance(channel.source, CanSource)
            if channel.source.decimals_object is not None:
                node.decimals[position] = Decimals(channel.source.sentinels)
                node.decimals_objects[position] = channel.source.decimals_object
    return nodes
