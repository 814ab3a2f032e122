"""A cycle in which nothing is out of the ordinary, taken at once: as nearly all are, and it costs a fraction.

Where every node runs and lives, and each of its TPDOs answers the SYNC of this cycle in time, looking at the nodes one
by one would find nothing. Then the data of all TPDOs are decoded as one, and no channel is handled by itself. Whatever
else is the case is left to the driver, which looks at each node and each TPDO, and nothing has been changed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.drivers.base import Samples
from daq.drivers.canopen.mapping import PdoDecoder
from daq.drivers.canopen.node import Arrival, Node
from daq.drivers.canopen.watch import NodeWatch


class Sweep:
    """Takes whole cycles of the nodes of one bus.

    Parameters
    ----------
    count : channels of the driver
    late_ns : after a SYNC, from which on a TPDO is late
    """

    def __init__(self, nodes: Sequence[Node], watch: NodeWatch, count: int, late_ns: float) -> None:
        self._nodes = [(node, watch.limit_ns(node), node.tpdos) for node in nodes]
        self._late_ns = late_ns
        tpdos = [tpdo for node in nodes for tpdo in node.tpdos]
        self._wrong = [0] * len(tpdos)
        self._decoder = PdoDecoder([kind for tpdo in tpdos for kind in tpdo.mapping.decoder.data_types])
        entries = [positions for tpdo in tpdos for positions in tpdo.mapping.positions]
        self._from = np.zeros(count, dtype=np.intp)  # for each channel, which of the decoded numbers
        for number, positions in enumerate(entries):
            self._from[list(positions)] = number
        self._possible = not any(node.decimals for node in nodes)
        self._fresh = np.zeros(count, dtype=np.uint8)
        self._no_cycles, self._at_sync = np.zeros(count, dtype=np.int64), np.zeros(count)
        for constant in (self._fresh, self._no_cycles, self._at_sync):
            constant.flags.writeable = False

    def samples(self, number: int, now_ns: int) -> Samples | None:
        """Samples of cycle ``number``; None, and nothing changed, if there is anything to be looked at."""
        arrivals = self._arrivals(number, now_ns)
        if arrivals is None:
            return None
        decoded = np.array(self._decoder.unpack(b"".join([arrival.data for arrival in arrivals])), dtype=np.float64)
        if not np.isfinite(decoded).all():
            return None
        waiting = iter(arrivals)
        for node, _, tpdos in self._nodes:
            for tpdo in tpdos:
                arrival = next(waiting)
                tpdo.taken = arrival.ordinal
                node.latency.add(arrival.at_ns - arrival.sync_ns)
        return Samples(decoded[self._from], self._fresh, self._no_cycles, self._at_sync, plain=True)

    def _arrivals(self, number: int, now_ns: int) -> list[Arrival] | None:
        """What came, in the order of nodes and TPDOs, if it is all that is due and there is nothing else to be seen."""
        if not self._possible:
            return None
        found: list[Arrival] = []
        late_ns, wrong = self._late_ns, self._wrong
        for node, limit_ns, tpdos in self._nodes:
            if (
                node.state != "running"
                or node.errors != node.emergencies_seen
                or node.boot_ups != node.boot_ups_seen
                or node.emergency is not None
                or now_ns - node.heartbeat_ns > limit_ns
                or node.misses
                or node.late_run
                or node.surplus_run
                or node.starting_anew
                or node.heartbeat_lost
            ):
                return None
            for tpdo in tpdos:
                arrival = tpdo.latest
                if (
                    arrival is None
                    or arrival.cycle != number
                    or arrival.ordinal != tpdo.taken + 1
                    or arrival.at_ns - arrival.sync_ns > late_ns
                    or tpdo.in_doubt
                    or tpdo.surplus != tpdo.surplus_seen
                ):
                    return None
                if tpdo.wrong != wrong[len(found)]:
                    wrong[len(found)] = tpdo.wrong
                    return None
                found.append(arrival)
        return found
