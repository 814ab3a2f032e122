"""The CANopen driver: SYNC out, TPDOs in, and nodes that come and go without disturbing the others.

Threads: the caller's (``trigger``, ``collect``), the link's receive thread, and a keeper for each node and for the bus
(:mod:`daq.drivers.bus_driver`), which commission nodes that rebooted and rebuild a bus that failed while the cycle
goes on.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from daq.drivers.base import DeviceStatus, Driver, DriverContext, DriverStatistics, Problem, Samples, nothing
from daq.drivers.can.health import CanDriver
from daq.drivers.can.port import CanPort
from daq.drivers.canopen.care import VERIFY_CYCLES, Lead, NodeCare, Start
from daq.drivers.canopen.commissioning import LEFT, PRE_OPERATIONAL
from daq.drivers.canopen.leadership import Leadership, State
from daq.drivers.canopen.link import CanLink
from daq.drivers.canopen.listening import Guest, ListeningDriver
from daq.drivers.canopen.look import Look
from daq.drivers.canopen.node import MISSES_TOLERATED, Node, make_nodes
from daq.drivers.canopen.tpdo import Cycle
from daq.drivers.listening import FIRST_S
from daq.errors import BusError
from daq.frames.clock import NS
from daq.machine.machine_file import CanopenBus, Channel
from daq.messages import Sentence
from daq.quality import Quality

ANSWER_S = (
    0.06  # at the start a SYNC is waited for so long that also an answer that is three cycles late is seen as it is
)
EMERGENCY_CODES = 16  # codes that are told one by one; a device that makes codes up must not flood the statistics
COUNTS = (
    "sync", "missing", "late", "superseded", "surplus", "not_a_number", "short_pdo", "emergency", "boot_up", "silent",
    "heartbeat_lost", "started_anew", "commissioned",
)  # fmt: skip


class CanopenDriver(CanDriver):
    """CANopen sensors on one bus, sampled at SYNC (see :class:`daq.drivers.base.Driver`).

    On the bus it sends SYNC, NMT commands to its own nodes, and the SDO requests of their commissioning; nothing else,
    and nothing at all where another master is heard (:mod:`daq.drivers.canopen.leadership`).
    """

    leads = True

    def __init__(self, bus: CanopenBus, channels: Sequence[Channel], context: DriverContext) -> None:
        super().__init__(bus, [channel.name for channel in channels], context, COUNTS)
        self._bus = bus
        self._declared = tuple(channels)
        cycle = Cycle()
        self._nodes = make_nodes(bus, channels, cycle, context, self.counts)
        self._all_ids = frozenset().union(*(node.cob_ids for node in self._nodes.values()))
        self._lead = Lead(self._nodes.values(), cycle, context)
        self._start = Start()
        self._cares = {
            number: NodeCare(node, bus.name, context, self.counts, self._lead, self._start)
            for number, node in self._nodes.items()
        }
        count, late_ns = len(channels), context.late_ns
        self._look = Look(tuple(self._cares.values()), self.counts, count, late_ns)
        started = context.found.started(bus.name) if context.found is not None else frozenset()
        for number in started & self._nodes.keys():
            self._nodes[number].found_state = -1  # as an earlier run of ours left it, not as it was found
        self._leadership = Leadership(bus, context, self._nodes, started)
        for node in self._nodes.values():
            node.leadership = self._leadership
        self._guest: Guest | None = None

    # Start

    def start(self) -> tuple[str, ...]:
        """Commission all nodes side by side, then check that each sends every TPDO within three cycles.

        Raises
        ------
        BusError
            If another master leads this bus; then nothing was sent, and nothing will be.
        """
        self._start.under_way = True
        self.keeper.start()
        for care in self._cares.values():
            care.keeper.start()
        self._start.expect(self._nodes)
        self.open()
        link = self._lead.link
        if link is None:
            self._start.under_way = False
            if self._leadership.state is State.GUEST:
                self._refused()
            if self.port is not None:
                self.keeper.soon()  # listens on
            return (Problem(self.failure or Sentence("daq.bus_still_listened", bus=self._bus.name), self._names),)
        untried = self._start.wait(self.context.start_s)
        ready = [number for number, node in self._nodes.items() if node.operational and number not in untried]
        self._first_syncs(link, [self._nodes[number] for number in ready])
        for number in ready:
            self._cares[number].verify()
        return tuple(
            Problem(node.detail or Sentence("daq.not_answered_yet", place=node.place), self._channels_of(node))
            for node in self._nodes.values()
            if node.state != "running"
        )

    def _refused(self) -> None:
        """Refuse to start: another master leads, and nothing was sent yet."""
        self.stop()
        self.failure = Sentence(
            "daq.bus_another_master_leads",
            bus=self._bus.name,
            leadership=self._leadership.masters_seen(),
            listen_s=self._bus.listen_s,
        )
        self.context.events.begin(self._bus.name, "second_master", self.failure)
        raise BusError(self.failure)

    def _channels_of(self, node: Node) -> list[str]:
        return [self._names[position] for mapping in node.mappings for entry in mapping.positions for position in entry]

    def _first_syncs(self, link: CanLink, ready: Sequence[Node]) -> None:
        """Send SYNCs without a cycle, each until everybody has answered."""
        for number in range(-VERIFY_CYCLES, 0):
            if all(node.complete() for node in ready):
                return
            self._lead.sync(link, number, set().union(*(node.cob_ids for node in ready)))
            self._lead.cycle.whole(max(self.context.period_s, ANSWER_S) + self.context.patience_s)

    def connected(self) -> CanPort:
        """Connect the bus, frames of its nodes to them, or to the guest."""
        link = CanLink(self._bus, self.context, self.health, self._leadership)
        if self._guest is not None:
            self._guest.attach(link)
            self._guest.port = link
            return link
        for node in self._nodes.values():
            link.handlers.update(node.handlers())
        return link

    def open(self) -> None:
        """Close the bus if it is open, and open it; listen on to one that was not listened to for long enough."""
        if self._leadership.state is State.LISTENING and self.working():
            self._take_lead()
        else:
            super().open()

    def opened(self) -> None:
        """Listen; then lead, and commission all nodes. A guest only listens on."""
        super().opened()
        self._take_lead()

    def _take_lead(self) -> None:
        """Listen for as long as the machine file asks, then lead; a start that may not take long goes on before."""
        link = self.port
        assert isinstance(link, CanLink)
        hurried = self._start.under_way and self.context.start_s is not None
        if not self._leadership.lead(self.keeper.paused, FIRST_S if hurried else math.inf):
            return
        if self.context.found is not None:
            self.context.found.leads(self._bus.name, self._nodes)
        self._lead.link = link  # from here on the cycle sends SYNC
        for care in self._cares.values():
            care.keeper.soon()

    def went_down(self) -> None:
        """Note that no node can be reached."""
        self._lead.link = None
        for node in self._nodes.values():
            node.operational = False
            node.gone("failed", "bus_down", self.failure)

    def _hand_over(self) -> Guest:
        """Go on without sending: another master was noticed while we led, or before."""
        line = Sentence("daq.bus_another_master_leads_nothing", bus=self._bus.name, reason=self._leadership.reason)
        self.context.events.begin(self._bus.name, "second_master", line)
        self._lead.link = None
        refused = {
            number: Sentence("daq.not_commissioned_before_another", place=node.place)
            for number, node in self._nodes.items()
            if node.state != "running"
        }
        guest = Guest(self._bus, self._declared, self.context, refused)
        self._guest = guest
        for care in self._cares.values():
            care.keeper.settled()
        if isinstance(self.port, CanLink):
            guest.attach(self.port)
            guest.port = self.port
        return guest

    @property
    def external_sync(self) -> bool:
        """True if the cycle is led by :meth:`next_sync`: another master's, since it was noticed."""
        return self._guest is not None and self._guest.external_sync

    def next_sync(self, deadline_ns: int) -> int | None:
        """Return the monotonic ns of the other master's next SYNC, or None at the deadline."""
        return None if self._guest is None else self._guest.next_sync(deadline_ns)

    # The cycle

    def trigger(self, cycle: int) -> None:
        """Send SYNC, if we lead."""
        if self._leadership.state is State.GUEST:
            (self._guest or self._hand_over()).trigger(cycle)
            return
        link = self._lead.working_link()
        if link is None:
            self._lead.no_sync(cycle)
            return
        nodes = self._nodes.values()
        there = [n for n in nodes if n.state == "running" and n.operational and n.misses < MISSES_TOLERATED]
        expected = set(self._all_ids) if len(there) == len(nodes) else set().union(*(node.cob_ids for node in there))
        self._lead.sync(link, cycle, expected)
        self.counts["sync"] += 1

    def collect(self, until_ns: int) -> Samples:
        """Collect TPDOs of this cycle, as soon as all that are expected came."""
        if not self.working():
            return nothing(len(self._names), Quality.BUS_ERROR)
        if self._guest is not None:
            return self._guest.collect(until_ns)
        remaining = (until_ns - self.context.monotonic_ns()) / NS
        lost = remaining > 0 and not self._lead.cycle.whole(remaining) and self.context.patience_s > 0
        if lost:  # waited for far longer than anything takes; a machine that does not stand still is told by counting
            for tpdo in (
                tpdo for node in self._nodes.values() if node.misses < MISSES_TOLERATED for tpdo in node.tpdos
            ):
                tpdo.give_up()
        port = self.port
        received_ns = 0 if port is None else port.received_ns(self.context.monotonic_ns())
        return self._look.samples(self._lead.cycle, received_ns)

    # What it says

    def devices(self, failure: str) -> Iterable[DeviceStatus]:
        """Return the state of every node."""
        if self._guest is not None:
            yield from self._guest.devices(failure)
            return
        for number, node in self._nodes.items():
            line = failure or node.line()
            yield DeviceStatus(
                Sentence("daq.node_number", number=number),
                "failed" if failure else node.state,
                line,
                node.latency.mean_std(),
                node.objects,
            )

    def statistics(self) -> DriverStatistics:
        """Return the state of the bus and of every node, and counters since the start."""
        whole = super().statistics()
        codes = _emergency_codes(self._nodes.values())
        guest = {} if self._guest is None else {name: n for name, n in self._guest.counts.items() if n}
        foreign = {"foreign_sync": self._leadership.count("SYNC"), "foreign_nmt": self._leadership.count("NMT")}
        return replace(whole, counts={**whole.counts, **foreign, **codes, **guest})

    def stop(self) -> None:
        """Leave each node in the state in which its heartbeat found it, else pre-operational; close the bus."""
        if (busy := self._lead.link) is not None:
            busy.hurry()
        self.keeper.stop()
        for care in self._cares.values():
            care.keeper.stop()
        link, self._lead.link = self._lead.working_link(), None
        if link is not None:
            for number, node in self._nodes.items():
                link.send_nmt(LEFT.get(node.found_state, PRE_OPERATIONAL), number)
            if self.context.found is not None:
                self.context.found.left(self._bus.name)
        super().stop()


def _emergency_codes(nodes: Iterable[Node]) -> dict[str, int]:
    """Count each error code, the most frequent ones by name."""
    found: Counter[int] = Counter()
    for node in nodes:
        found.update({code: count for code, count in list(node.emergencies.items()) if code})
    named = found.most_common(EMERGENCY_CODES)
    counts = {f"emergency 0x{code:04X}": count for code, count in named}
    rest = sum(found.values()) - sum(count for _, count in named)
    return counts | ({"emergency, other codes": rest} if rest else {})


def canopen_driver(bus: CanopenBus, channels: Sequence[Channel], context: DriverContext) -> Driver:
    """Make the driver for a CANopen bus: one that leads it, or one that only listens."""
    return (ListeningDriver if bus.listen_only else CanopenDriver)(bus, channels, context)
