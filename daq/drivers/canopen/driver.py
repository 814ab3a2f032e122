"""The CANopen driver: SYNC out, TPDOs in, and nodes that come and go without disturbing the others.

Threads: the caller's (``trigger``, ``collect``), the link's receive thread, and a keeper for each node and for the bus
(:mod:`daq.drivers.keeper`), which commission nodes that rebooted and rebuild a bus that failed while the cycle goes on.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

from daq.drivers.base import DeviceStatus, Driver, DriverContext, DriverStatistics, Problem, Samples, nothing
from daq.drivers.can.health import BusHealth, advice, told
from daq.drivers.canopen.care import VERIFY_CYCLES, NodeCare, Start
from daq.drivers.canopen.commissioning import LEFT, PRE_OPERATIONAL
from daq.drivers.canopen.lead import Lead
from daq.drivers.canopen.link import CanLink
from daq.drivers.canopen.listening import ListeningDriver
from daq.drivers.canopen.look import Look
from daq.drivers.canopen.node import MISSES_TOLERATED, Cycle, Node, make_nodes
from daq.drivers.canopen.sweep import Sweep
from daq.drivers.canopen.watch import NodeWatch
from daq.drivers.keeper import Keeper
from daq.errors import AcquisitionError, BusError
from daq.frames.clock import NS
from daq.machine.machine_file import CanopenBus, Channel
from daq.quality import Quality

ANSWER_S = (
    0.06  # at the start a SYNC is waited for so long that also an answer that is three cycles late is seen as it is
)
EMERGENCY_CODES = 16  # codes that are told one by one; a device that makes codes up must not flood the statistics
COUNTS = (
    "sync", "missing", "late", "superseded", "surplus", "not_a_number", "short_pdo", "emergency", "boot_up", "silent",
    "heartbeat_lost", "started_anew", "commissioned", "bus_rebuilt", "keeper_broke",
)  # fmt: skip


class CanopenDriver:
    """CANopen sensors on one bus, sampled at SYNC (see :class:`daq.drivers.base.Driver`).

    On the bus it sends SYNC, NMT commands to its own nodes, and the SDO requests of their commissioning; nothing else.
    """

    leads = True

    def __init__(self, bus: CanopenBus, channels: Sequence[Channel], context: DriverContext) -> None:
        self._config = bus
        self._context = context
        self._names = tuple(channel.name for channel in channels)
        cycle = Cycle()
        self._nodes = make_nodes(bus, channels, cycle)
        self._all_ids = frozenset().union(*(node.cob_ids for node in self._nodes.values()))
        self._counts = dict.fromkeys(COUNTS, 0)
        self._health = BusHealth(told(bus.name, context.events))
        self._watch = NodeWatch(bus.name, context, self._counts)
        self._lead = Lead(self._nodes.values(), cycle, context)
        self._start = Start()
        self._cares = {
            number: NodeCare(node, bus.name, context, self._watch, self._counts, self._lead, self._start)
            for number, node in self._nodes.items()
        }
        count, late_ns = len(self._names), context.late_ns
        self._sweep = Sweep(tuple(self._nodes.values()), self._watch, count, late_ns)
        self._look = Look(tuple(self._cares.values()), self._watch, self._counts, count, late_ns)
        self._failure = ""  # why the bus could not be opened
        self._stopped = threading.Event()
        self._leading = False  # whether anything was ever sent
        self._bus_keeper = Keeper(f"keeper-{bus.name}", self._rebuild, self._bus_broke, context.monotonic_ns)
        self._before: dict[str, int] = {}  # counts of the links that were closed

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the samples."""
        return self._names

    # Start

    def start(self) -> tuple[str, ...]:
        """Commission all nodes side by side, then check that each sends every TPDO within three cycles.

        Raises
        ------
        BusError
            If another master leads this bus; then nothing was sent, and nothing will be.
        """
        self._start.under_way = True
        self._bus_keeper.start()
        for care in self._cares.values():
            care.keeper.start()
        try:
            link = self._lead.link = self._open()
        except AcquisitionError as error:
            self._start.under_way = False
            self._bus_is_down(str(error))
            return (Problem(str(error), self._names),)
        self._alone(link)
        self._leading = True
        self._start.expect(self._nodes)
        for care in self._cares.values():
            care.keeper.soon()
        untried = self._start.wait(self._context.start_s)
        ready = [number for number, node in self._nodes.items() if node.operational and number not in untried]
        self._first_syncs(link, [self._nodes[number] for number in ready])
        for number in ready:
            self._cares[number].verify()
        return tuple(
            Problem(node.detail or f"{node.place}: has not answered yet; check its power", self._channels_of(node))
            for node in self._nodes.values()
            if node.state != "running"
        )

    def _alone(self, link: CanLink) -> None:
        """Listen before the first frame is sent; in lockstep with a simulation there is no time to listen in."""
        heard = link.listen(self._config.listen_s if self._context.patience_s == 0 else 0.0, self._stopped.wait)
        if heard:
            self._start.under_way = False
            self.stop()
            self._failure = (
                f"bus '{self._config.name}': another master leads it ({heard} within {self._config.listen_s:g} s); "
                "nothing was sent; take its sensors as they are with 'listen_only: true', or disconnect it"
            )
            self._context.events.begin(self._config.name, "second_master", self._failure)
            raise BusError(self._failure)

    def _channels_of(self, node: Node) -> list[str]:
        return [self._names[position] for mapping in node.mappings for entry in mapping.positions for position in entry]

    def _first_syncs(self, link: CanLink, ready: Sequence[Node]) -> None:
        """SYNCs without a cycle, each waited for until everybody has answered."""
        for number in range(-VERIFY_CYCLES, 0):
            if all(node.complete() for node in ready):
                return
            self._lead.sync(link, number, set().union(*(node.cob_ids for node in ready)))
            self._lead.cycle.done.wait(max(self._context.period_s, ANSWER_S) + self._context.patience_s)

    def _open(self) -> CanLink:
        link = CanLink(self._config, self._context, self._health)
        for node in self._nodes.values():
            link.handlers.update(node.handlers())
        return link

    # What the keeper of the bus does

    def _bus_broke(self, error: Exception) -> None:
        self._counts["keeper_broke"] += 1
        self._bus_is_down(f"bus '{self._config.name}': opening it broke ({type(error).__name__}: {error})")

    def _rebuild(self) -> None:
        link, self._lead.link = self._lead.link, None
        if link is not None:
            for name, value in self._counts_of(link).items():
                self._before[name] = self._before.get(name, 0) + value
            link.close()
        try:
            link = self._open()
        except AcquisitionError as error:
            self._bus_is_down(str(error))
            return
        self._counts["bus_rebuilt"] += 1
        self._failure = ""
        self._health.opened()
        self._context.events.end(self._config.name, "bus_down")
        self._lead.link = link  # from here on the cycle sends SYNC again
        self._bus_keeper.settled()
        self._leading = True
        for care in self._cares.values():
            care.keeper.soon()

    def _bus_is_down(self, line: str) -> None:
        self._failure = line
        self._context.events.begin(self._config.name, "bus_down", line)
        for node in self._nodes.values():
            node.operational = False
            self._watch.away(node, "failed", "bus_down", line)
        self._bus_keeper.later()

    # The cycle

    def trigger(self, cycle: int) -> None:
        """Send SYNC."""
        link = self._lead.working_link()
        if link is None:
            self._lead.no_sync(cycle)
            return
        nodes = self._nodes.values()
        there = [n for n in nodes if n.state == "running" and n.operational and n.misses < MISSES_TOLERATED]
        expected = set(self._all_ids) if len(there) == len(nodes) else set().union(*(node.cob_ids for node in there))
        self._lead.sync(link, cycle, expected)
        self._counts["sync"] += 1

    def collect(self, until_ns: int) -> Samples:
        """TPDOs of this cycle, as soon as all that are expected came."""
        link = self._lead.link
        if link is None or link.failure is not None:
            if link is not None and not self._failure:
                self._bus_is_down(f"bus '{self._config.name}': {link.failure}; it is opened again")
            return nothing(len(self._names), Quality.BUS_ERROR)
        remaining = (until_ns - self._context.monotonic_ns()) / NS
        lost = remaining > 0 and not self._lead.cycle.done.wait(remaining) and self._context.patience_s > 0
        if lost:  # waited for far longer than anything takes; a machine that does not stand still is told by counting
            for tpdo in (
                tpdo for node in self._nodes.values() if node.misses < MISSES_TOLERATED for tpdo in node.tpdos
            ):
                tpdo.give_up()
        now = self._context.monotonic_ns()
        number = self._lead.cycle.number
        whole = self._sweep.samples(number, now)
        return self._look.samples(number, now) if whole is None else whole

    # What it says

    def _counts_of(self, link: CanLink) -> dict[str, int]:
        return {
            "frames": link.frames,
            "extended_frames": link.extended,
            "remote_frames": link.remote,
            "unreadable_frames": link.broken,
            "lost_frames": link.lost,
            "foreign_sync": link.foreign_syncs,
            "foreign_nmt": link.foreign_nmts,
        }

    def statistics(self) -> DriverStatistics:
        """State of the bus and of every node, and counters since the start."""
        link = self._lead.link
        failure = link.failure if link is not None else self._failure or "closed"
        devices = tuple(
            DeviceStatus(
                f"node {number}",
                "failed" if failure else node.state,
                failure or self._watch.line(node),
                node.latency.told(),
                node.objects,
            )
            for number, node in self._nodes.items()
        )
        counts = dict(self._counts) | {"error_frames": self._health.error_frames}
        for name, value in (self._counts_of(link) if link is not None else {}).items():
            counts[name] = value + self._before.get(name, 0)
        for name, value in self._before.items():
            counts.setdefault(name, value)
        counts |= self._watch.emergency_codes(self._nodes.values(), EMERGENCY_CODES)
        state = self._health.state if not failure or self._health.state == "bus_off" else "down"
        return DriverStatistics(
            self._config.name, devices, counts, state, advice(self._config.name, self._health.state) or failure or ""
        )

    def stop(self) -> None:
        """Leave each node in the state in which its heartbeat found it, else pre-operational; close the bus."""
        self._stopped.set()
        for keeper in (self._bus_keeper, *(care.keeper for care in self._cares.values())):
            keeper.stop()
        link, self._lead.link = self._lead.link, None
        if link is not None:
            for number, node in self._nodes.items() if self._leading else ():
                link.send_nmt(LEFT.get(node.found_state, PRE_OPERATIONAL), number)
            link.close()


def canopen_driver(bus: CanopenBus, channels: Sequence[Channel], context: DriverContext) -> Driver:
    """The driver for a CANopen bus: one that leads it, or one that only listens."""
    return (ListeningDriver if bus.listen_only else CanopenDriver)(bus, channels, context)
