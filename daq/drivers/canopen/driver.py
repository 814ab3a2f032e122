"""The CANopen driver: SYNC out, TPDOs in, and nodes that come and go without disturbing the others.

Threads: the caller's (``trigger``, ``collect``), the link's receive thread, and a keeper for each node and for the bus
(:mod:`daq.drivers.keeper`), which commission nodes that rebooted and rebuild a bus that failed while the cycle goes on.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from daq.drivers.base import Answers, DeviceStatus, Driver, DriverContext, DriverStatistics, Problem, Samples, nothing
from daq.drivers.can.health import BusHealth, advice, told
from daq.drivers.canopen.commissioning import LEFT, OPERATIONAL, PRE_OPERATIONAL, commission
from daq.drivers.canopen.identity import ask
from daq.drivers.canopen.link import CanLink
from daq.drivers.canopen.listening import ListeningDriver
from daq.drivers.canopen.node import MISSES_TOLERATED, SURPLUS_TOLERATED, UNANSWERED, Cycle, Node, make_nodes
from daq.drivers.canopen.sweep import Sweep
from daq.drivers.canopen.watch import NodeWatch
from daq.drivers.keeper import Keeper
from daq.errors import AcquisitionError, BusError
from daq.found_setups import FoundSetup
from daq.machine_file import CanopenBus, Channel
from daq.quality import Quality

NS = 1_000_000_000
VERIFY_CYCLES = 3
VERIFY_PATIENCE_S = 0.5  # beyond the three cycles: a shared host may not run us for that long
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
        self._cycle = Cycle()
        self._nodes = make_nodes(bus, channels, self._cycle)
        self._all_ids = frozenset().union(*(node.cob_ids for node in self._nodes.values()))
        self._counts = dict.fromkeys(COUNTS, 0)
        self._health = BusHealth(told(bus.name, context.events))
        self._watch = NodeWatch(bus.name, context, self._counts)
        late_ns = math.inf if context.patience_s > 0 else 0.5 * context.period_s * NS
        self._sweep = Sweep(tuple(self._nodes.values()), self._watch, len(self._names), late_ns)
        self._link: CanLink | None = None
        self._failure = ""  # why the bus could not be opened
        self._order = threading.Lock()  # SYNC and NMT one after the other: which SYNCs a node answers has to be known
        self._synced = threading.Condition()
        self._tried = threading.Condition()
        self._stopped = threading.Event()
        self._leading = False  # whether anything was ever sent
        self._untried: set[int] = set()
        self._starting = False
        self._keepers = {number: self._keeper(node) for number, node in self._nodes.items()}
        self._bus_keeper = Keeper(f"keeper-{bus.name}", self._rebuild, self._bus_broke, context.monotonic_ns)
        self._before: dict[str, int] = {}  # counts of the links that were closed

    def _keeper(self, node: Node) -> Keeper:
        return Keeper(
            f"keeper-{self._config.name}-{node.config.node}",
            lambda: self._care(node),
            lambda error: self._broke(node, error),
            self._context.monotonic_ns,
        )

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
        self._starting = True
        self._bus_keeper.start()
        for keeper in self._keepers.values():
            keeper.start()
        try:
            self._link = self._open()
        except AcquisitionError as error:
            self._starting = False
            self._bus_is_down(str(error))
            return (Problem(str(error), self._names),)
        self._alone(self._link)
        self._leading = True
        self._untried = set(self._nodes)
        for keeper in self._keepers.values():
            keeper.soon()
        with self._tried:
            self._tried.wait_for(lambda: not self._untried, self._context.start_s)
            self._starting = False  # who comes later is checked by its keeper
            ready = [node for number, node in self._nodes.items() if node.operational and number not in self._untried]
        self._first_syncs(self._link, ready)
        for node in ready:
            self._verify(node)
        return tuple(
            Problem(node.detail or f"{node.place}: has not answered yet; check its power", self._channels_of(node))
            for node in self._nodes.values()
            if node.state != "running"
        )

    def _alone(self, link: CanLink) -> None:
        """Listen before the first frame is sent; in lockstep with a simulation there is no time to listen in."""
        heard = link.listen(self._config.listen_s if self._context.patience_s == 0 else 0.0, self._stopped.wait)
        if heard:
            self._starting = False
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
            self._send_sync(link, number, set().union(*(node.cob_ids for node in ready)))
            self._cycle.done.wait(max(self._context.period_s, ANSWER_S) + self._context.patience_s)

    def _send_sync(self, link: CanLink, number: int, expected: set[int]) -> None:
        with self._order:
            now = self._context.monotonic_ns()
            self._cycle.begin(number, now, expected)
            for node in self._nodes.values():
                for tpdo in node.tpdos if node.operational else ():
                    tpdo.asked(number, now)
            link.send_sync()
        with self._synced:
            self._synced.notify_all()

    def _open(self) -> CanLink:
        link = CanLink(self._config, self._context, self._health)
        for node in self._nodes.values():
            link.handlers.update(node.handlers())
        return link

    # What keepers do

    def _care(self, node: Node) -> None:
        link = self._link
        if link is None or link.failure is not None:
            return  # the keeper of the bus hands it over again
        if node.starting_anew and node.state == "running":
            self._start_anew(link, node)
            return
        if node.to_be_asked and node.state == "running":
            self._ask(link, node)
            return
        done = self._commission(link, node)
        with self._tried:
            self._untried.discard(node.config.node)
            self._tried.notify_all()
            if self._starting:
                return  # all together, by start()
        if done:
            self._await_tpdos(node)
            self._verify(node)

    def _commission(self, link: CanLink, node: Node) -> bool:
        node.state = "commissioning"
        node.starting_anew = False
        if node.found_state is None:
            node.found_state = node.heartbeat_state
        node.forget()
        sdo = link.sdo(node.config.node)
        try:
            commission(
                sdo,
                lambda command: self._command(link, node, command),
                node.config,
                node.mappings,
                node.place,
                monotonic_ns=self._context.monotonic_ns,
                answered=node.accept_boot_ups,
                boot_up_s=node.config.boot_up_s if self._starting else 0.0,
                keep=lambda found, wrote, identity: self._keep(node, FoundSetup(found, wrote, identity)),
                learn=node.learn_decimals,
            )
        except AcquisitionError as error:
            self._failed(node, str(error))
            return False
        finally:
            sdo.close()
        return True

    def _ask(self, link: CanLink, node: Node) -> None:
        """Once it runs: what it says of itself. A node that does not answer this goes on all the same."""
        node.to_be_asked = False
        sdo = link.sdo(node.config.node)
        try:
            node.objects = ask(sdo)
        except AcquisitionError:
            node.objects = {}
        finally:
            sdo.close()

    def _keep(self, node: Node, setup: FoundSetup) -> None:
        """Before a node is changed: keep what it was like."""
        if self._context.found is not None:
            state = -1 if node.found_state is None else node.found_state
            self._context.found.keep(self._config.name, node.config.node, replace(setup, state=state))

    def _command(self, link: CanLink, node: Node, command: int) -> None:
        """An NMT command; a node is made operational right behind a SYNC, so that it is ready at the next one."""
        if command == OPERATIONAL:
            node.forget_answers()
            if not self._starting:
                with self._synced:
                    self._synced.wait(2 * self._context.period_s + self._context.patience_s)
        with self._order:
            link.send_nmt(command, node.config.node)
            node.operational = command == OPERATIONAL

    def _await_tpdos(self, node: Node) -> None:
        keeper = self._keepers[node.config.node]
        deadline = time.monotonic() + VERIFY_CYCLES * self._context.period_s + VERIFY_PATIENCE_S
        while not node.complete() and time.monotonic() < deadline and not keeper.stopping:
            time.sleep(self._context.period_s / 4)

    def _verify(self, node: Node) -> None:
        if node.complete():
            self._counts["commissioned"] += 1
            self._keepers[node.config.node].settled()
            self._watch.back(node)
            node.to_be_asked = True
            self._keepers[node.config.node].soon()
            return
        missing = [f"TPDO{t.mapping.number}" for t in node.tpdos if t.count == 0]
        self._failed(
            node,
            node.short()
            or f"{node.place}: {', '.join(missing)} did not come within {VERIFY_CYCLES} SYNCs; "
            "see its manual for synchronous transmission",
        )

    def _start_anew(self, link: CanLink, node: Node) -> None:
        """Let a node stop and start, so that its answers and our SYNCs are counted from one point again."""
        self._command(link, node, PRE_OPERATIONAL)
        time.sleep(UNANSWERED * self._context.period_s)  # what was under way comes
        self._command(link, node, OPERATIONAL)
        self._await_tpdos(node)
        self._counts["started_anew"] += 1
        arrivals = [tpdo.latest for tpdo in node.tpdos if tpdo.latest is not None]
        # Only one SYNC was unanswered when these were sent: what is late now is late, and not the count wrong.
        node.slow = any(a.during > a.cycle or self._is_late(a.at_ns - a.sync_ns) for a in arrivals)
        node.late_run = 0
        node.starting_anew = False

    def _is_late(self, after_ns: int) -> bool:
        """Later than half a period; in lockstep with a simulation no time passes, so nothing is."""
        return self._context.patience_s == 0 and after_ns > 0.5 * self._context.period_s * NS

    def _failed(self, node: Node, detail: str) -> None:
        node.operational = False
        self._watch.away(node, "failed", "failed", detail)
        self._keepers[node.config.node].later()

    def _broke(self, node: Node, error: Exception) -> None:
        self._counts["keeper_broke"] += 1
        self._failed(node, f"{node.place}: commissioning broke ({type(error).__name__}: {error}); it is tried again")

    def _bus_broke(self, error: Exception) -> None:
        self._counts["keeper_broke"] += 1
        self._bus_is_down(f"bus '{self._config.name}': opening it broke ({type(error).__name__}: {error})")

    def _rebuild(self) -> None:
        link, self._link = self._link, None
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
        self._link = link  # from here on the cycle sends SYNC again
        self._bus_keeper.settled()
        self._leading = True
        for keeper in self._keepers.values():
            keeper.soon()

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
        link = self._link
        if link is None or link.failure is not None:
            self._cycle.begin(cycle, self._context.monotonic_ns(), set())
            return
        nodes = self._nodes.values()
        there = [n for n in nodes if n.state == "running" and n.operational and n.misses < MISSES_TOLERATED]
        expected = set(self._all_ids) if len(there) == len(nodes) else set().union(*(node.cob_ids for node in there))
        self._send_sync(link, cycle, expected)
        self._counts["sync"] += 1

    def collect(self, until_ns: int) -> Samples:
        """TPDOs of this cycle, as soon as all that are expected came."""
        link = self._link
        if link is None or link.failure is not None:
            if link is not None and not self._failure:
                self._bus_is_down(f"bus '{self._config.name}': {link.failure}; it is opened again")
            return nothing(len(self._names), Quality.BUS_ERROR)
        remaining = (until_ns - self._context.monotonic_ns()) / NS
        lost = remaining > 0 and not self._cycle.done.wait(remaining) and self._context.patience_s > 0
        if lost:  # waited for far longer than anything takes; a machine that does not stand still is told by counting
            for tpdo in (
                tpdo for node in self._nodes.values() if node.misses < MISSES_TOLERATED for tpdo in node.tpdos
            ):
                tpdo.give_up()
        now = self._context.monotonic_ns()
        if (whole := self._sweep.samples(self._cycle.number, now)) is not None:
            return whole
        answers = Answers(len(self._names))
        for node in self._nodes.values():
            if self._watch.look(node, now):
                self._keepers[node.config.node].soon()
            elif node.state == "silent":
                self._keepers[node.config.node].later()
            if node.state == "running":
                self._take(node, self._cycle.number, answers)
        return answers.samples()

    def _take(self, node: Node, number: int, answers: Answers) -> None:
        brought = current = 0
        mixed = node.surplus_run > 0
        half_ns = 0.5 * self._context.period_s * NS
        for tpdo in node.tpdos:
            arrival = tpdo.latest
            if arrival is None or arrival.ordinal <= tpdo.taken:
                self._counts["missing"] += 1
                continue
            self._counts["superseded"] += arrival.ordinal - tpdo.taken - 1
            tpdo.taken = arrival.ordinal
            brought += 1
            node.latency.add(arrival.at_ns - arrival.sync_ns)
            ago, after_ns = number - arrival.cycle, arrival.at_ns - arrival.sync_ns
            late = ago > 0 or tpdo.in_doubt or (after_ns > half_ns and self._is_late(after_ns))
            self._counts["late"] += late
            current += not late
            good = Quality.EMERGENCY if node.emergency is not None else Quality.LATE if late else Quality.FRESH
            for value, positions in zip(tpdo.mapping.decoder.unpack(arrival.data), tpdo.mapping.positions, strict=True):
                quality = good
                if mixed or not math.isfinite(value):
                    self._counts["not_a_number"] += not mixed
                    quality, value = Quality.INVALID, math.nan
                for position in positions:
                    answers.raw[position] = value
                    answers.quality[position] = quality
                    if late:
                        answers.cycles_ago[position] = ago
                        answers.after_sync_s[position] = 0.0 if ago else after_ns / NS
        if node.decimals:
            self._with_decimals(node, answers)
        if node.starting_anew:
            return
        node.misses = 0 if brought else node.misses + 1
        node.late_run = node.late_run + 1 if brought and not current else 0
        if self._watch.miscounted(node, brought):
            node.starting_anew = True
            self._keepers[node.config.node].soon()
        elif node.surplus_run >= SURPLUS_TOLERATED:
            self._failed(
                node,
                f"{node.place}: more TPDOs than SYNCs: two devices have this node-ID, or something else sends SYNC as "
                "well; give each device an ID of its own, and let only one send SYNC",
            )

    def _with_decimals(self, node: Node, answers: Answers) -> None:
        for position, decimals in node.decimals.items():
            if math.isfinite(answers.raw[position]):
                value = answers.raw[position] = decimals.value(answers.raw[position])
                if not math.isfinite(value):
                    answers.quality[position] = Quality.INVALID

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
        link = self._link
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
        for keeper in (self._bus_keeper, *self._keepers.values()):
            keeper.stop()
        link, self._link = self._link, None
        if link is not None:
            for number, node in self._nodes.items() if self._leading else ():
                link.send_nmt(LEFT.get(node.found_state, PRE_OPERATIONAL), number)
            link.close()


def canopen_driver(bus: CanopenBus, channels: Sequence[Channel], context: DriverContext) -> Driver:
    """The driver for a CANopen bus: one that leads it, or one that only listens."""
    return (ListeningDriver if bus.listen_only else CanopenDriver)(bus, channels, context)
