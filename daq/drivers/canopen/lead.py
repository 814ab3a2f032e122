"""What a bus that we lead is told: SYNC to all, NMT commands to nodes of ours.

They go one after the other, because which SYNCs a node answers has to be known: each SYNC waits in a queue of every
TPDO of the nodes that were operational when it was sent (:mod:`daq.drivers.canopen.tpdo`).
"""

from __future__ import annotations

import threading
from collections.abc import Collection

from daq.drivers.base import DriverContext
from daq.drivers.canopen.commissioning import OPERATIONAL
from daq.drivers.canopen.leadership import State
from daq.drivers.canopen.link import CanLink
from daq.drivers.canopen.node import Node
from daq.drivers.canopen.tpdo import Cycle


class Lead:
    """Sends SYNC and NMT commands, and knows which cycle is under way.

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
