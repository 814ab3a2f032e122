"""SYNC and NMT commands of a bus that we lead, and care of one node, in its keeper's thread.

A node is commissioned, checked, started anew and asked. Whatever takes long or fails there costs this node alone, while
the cycle and the other nodes go on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Iterable, MutableMapping
from dataclasses import dataclass, replace

from daq.drivers.base import DriverContext
from daq.drivers.bus_driver import Keeper
from daq.drivers.canopen.commissioning import OPERATIONAL, PRE_OPERATIONAL, commission
from daq.drivers.canopen.leadership import State
from daq.drivers.canopen.link import CanLink
from daq.drivers.canopen.node import Node
from daq.drivers.canopen.profiles import ask
from daq.drivers.canopen.tpdo import Cycle
from daq.drivers.found_setups import FoundSetup
from daq.errors import AcquisitionError, first_line
from daq.messages import Sentence


class Lead:
    """Sends SYNC and NMT commands, and knows which cycle is under way.

    They go one after the other, because which SYNCs a node answers has to be known: each SYNC waits in a queue of every
    TPDO of the nodes that were operational when it was sent (:mod:`daq.drivers.canopen.tpdo`).

    Attributes
    ----------
    cycle : the one that is under way
    link : the open bus, once we lead it
    """

    def __init__(self, nodes: Collection[Node], cycle: Cycle, context: DriverContext) -> None:
        self.cycle = cycle
        self.link: CanLink | None = None
        self._nodes = nodes
        self._context = context
        self._order = threading.Lock()
        self._synced = threading.Condition()

    def working_link(self) -> CanLink | None:
        """Return the link, if it can be used, and is ours to lead."""
        link = self.link
        usable = link is not None and link.failure is None and link.leadership.state is State.LEADING
        return link if usable else None

    def sync(self, link: CanLink, number: int, expected: set[int]) -> None:
        """Send SYNC of cycle ``number``, in which TPDOs of the COB-IDs ``expected`` are waited for."""
        with self._order:
            now = self._context.monotonic_ns()
            self.cycle.begin(number, now, expected)
            for node in self._nodes:
                for tpdo in node.tpdos if node.operational else ():
                    tpdo.asked(number, now)
            link.send_sync()
        with self._synced:
            self._synced.notify_all()

    def no_sync(self, number: int) -> None:
        """Begin cycle ``number`` without a bus; nothing is waited for."""
        self.cycle.begin(number, self._context.monotonic_ns(), set())

    def command(self, link: CanLink, node: Node, command: int, *, behind_sync: bool) -> None:
        """Send an NMT command to one node.

        Parameters
        ----------
        behind_sync : make a node operational right behind a SYNC, so that it is ready at the next one
        """
        if command == OPERATIONAL:
            node.forget_answers()
            if behind_sync:
                with self._synced:
                    self._synced.wait(2 * self._context.period_s + self._context.patience_s)
        with self._order:
            link.send_nmt(command, node.config.node)
            node.operational = command == OPERATIONAL


VERIFY_CYCLES = 3
UNDER_WAY = 4  # cycles that answers may be under way when a node was ordered to stop
VERIFY_PATIENCE_S = 0.5  # beyond the three cycles: a shared host may not run us for that long


class Start:
    """The start of a bus, at which nodes are commissioned side by side and then checked together.

    ``under_way`` until it is over; nodes that come later are checked by their own keepers.
    """

    def __init__(self) -> None:
        self.under_way = False
        self._untried: set[int] = set()
        self._tried = threading.Condition()

    def expect(self, numbers: Iterable[int]) -> None:
        """Note which nodes are being commissioned."""
        self._untried = set(numbers)

    def tried(self, number: int) -> bool:
        """Note that a node was commissioned or could not be; return whether its start is under way."""
        with self._tried:
            self._untried.discard(number)
            self._tried.notify_all()
            return self.under_way

    def wait(self, seconds: float | None) -> frozenset[int]:
        """Wait until all were tried; then it is over. The nodes that were not."""
        with self._tried:
            self._tried.wait_for(lambda: not self._untried, seconds)
            self.under_way = False
            return frozenset(self._untried)


@dataclass(eq=False)
class NodeCare:
    """Takes care of one node of a bus.

    Attributes
    ----------
    node : whose state it changes
    bus : name of its bus
    counts, lead, start : of the bus, shared by all its nodes
    """

    node: Node
    bus: str
    context: DriverContext
    counts: MutableMapping[str, int]
    lead: Lead
    start: Start

    def __post_init__(self) -> None:
        name = f"keeper-{self.bus}-{self.node.config.node}"
        self.keeper = Keeper(name, self._care, self._broke, self.context.monotonic_ns)

    def verify(self) -> None:
        """Check that each of the node's TPDOs came: it runs; else it failed, and is tried again."""
        node = self.node
        if node.complete():
            self.counts["commissioned"] += 1
            self.keeper.settled()
            node.back()
            node.to_be_asked = True
            self.keeper.soon()
            return
        missing = [f"TPDO{t.mapping.number}" for t in node.tpdos if t.count == 0]
        self.failed(
            node.short()
            or Sentence(
                "daq.not_come_within_syncs", place=node.place, missing=", ".join(missing), verify_cycles=VERIFY_CYCLES
            )
        )

    def failed(self, detail: str) -> None:
        """Mark the node as unusable; it is tried again after a while."""
        self.node.operational = False
        self.node.gone("failed", "failed", detail)
        self.keeper.later()

    def _broke(self, error: Exception) -> None:
        self.counts["keeper_broke"] += 1
        self.failed(
            Sentence(
                "daq.commissioning_broke", place=self.node.place, name=type(error).__name__, error=first_line(error)
            )
        )
        self.start.tried(self.node.config.node)

    def _care(self) -> None:
        node = self.node
        link = self.lead.working_link()
        if link is None:
            return  # the keeper of the bus hands it over again
        if node.state == "running":  # one that was silent may be back by itself
            if node.starting_anew:
                self._start_anew(link)
            elif node.to_be_asked:
                self._ask(link)
            return
        done = self._commission(link)
        if not self.start.tried(node.config.node) and done:
            self._await_tpdos()
            self.verify()

    def _commission(self, link: CanLink) -> bool:
        node = self.node
        node.state = "commissioning"
        node.starting_anew = False
        if node.found_state is None:
            node.found_state = node.heartbeat_state
        node.forget()
        sdo = link.sdo(node.config.node)
        try:
            commission(
                sdo,
                lambda command: self._command(link, command),
                node.config,
                node.mappings,
                node.place,
                monotonic_ns=self.context.monotonic_ns,
                answered=node.accept_boot_ups,
                boot_up_s=node.config.boot_up_s if self.start.under_way else 0.0,
                keep=lambda found, wrote, identity: self._keep(FoundSetup(found, wrote, identity)),
                learn=node.learn,
            )
        except AcquisitionError as error:
            self.failed(str(error))
            return False
        return True

    def _keep(self, setup: FoundSetup) -> None:
        """Keep a node's settings before it is changed."""
        if self.context.found is not None:
            state = -1 if self.node.found_state is None else self.node.found_state
            self.context.found.keep(self.bus, self.node.config.node, replace(setup, state=state))

    def _ask(self, link: CanLink) -> None:
        """Ask a running node about itself. A node that does not answer this goes on all the same."""
        node = self.node
        node.to_be_asked = False
        try:
            node.objects = ask(link.sdo(node.config.node))
        except AcquisitionError:
            node.objects = {}

    def _command(self, link: CanLink, command: int) -> None:
        self.lead.command(link, self.node, command, behind_sync=not self.start.under_way)

    def _await_tpdos(self) -> None:
        deadline = time.monotonic() + VERIFY_CYCLES * self.context.period_s + VERIFY_PATIENCE_S
        while not self.node.complete() and time.monotonic() < deadline and not self.keeper.stopping:
            time.sleep(self.context.period_s / 4)

    def _start_anew(self, link: CanLink) -> None:
        """Stop and start a node, so that its answers and our SYNCs are counted from one point."""
        node = self.node
        self._command(link, PRE_OPERATIONAL)
        time.sleep(UNDER_WAY * self.context.period_s)
        try:
            link.sdo(node.config.node).read(0x1000)  # what it sent before this answer has come
        except AcquisitionError as error:
            self.failed(str(error))
            return
        self._command(link, OPERATIONAL)
        self._await_tpdos()
        self.counts["started_anew"] += 1
        arrivals = [tpdo.latest for tpdo in node.tpdos if tpdo.latest is not None]
        # Only one SYNC was unanswered when these were sent: what is late now is late, and not the count wrong.
        node.slow = any(a.during > a.cycle or a.at_ns - a.sync_ns > self.context.late_ns for a in arrivals)
        node.late_run = node.behind_run = 0
        node.starting_anew = False
