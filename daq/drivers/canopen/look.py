"""How a cycle's TPDOs are taken: at once where nothing is out of the ordinary, else node by node.

Where every node runs and lives, and each of its TPDOs answers the SYNC of this cycle in time, as nearly always, looking
at the nodes one by one would find nothing (:class:`Sweep`): the data of all TPDOs are decoded as one, and no channel is
handled by itself, which costs a fraction. Whatever else is the case, nothing has been changed, and each node and each
TPDO is looked at (:class:`Look`).
"""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence

import numpy as np

from daq.drivers.base import Answers, Samples
from daq.drivers.canopen.care import NodeCare
from daq.drivers.canopen.mapping import PdoDecoder
from daq.drivers.canopen.node import SURPLUS_TOLERATED, Arrival, Node
from daq.drivers.canopen.watch import NodeWatch
from daq.frames.clock import NS
from daq.quality import Quality

LATENCY_EVERY = 8  # whole cycles, of one of which it is noted how long answers took


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
        decoded = self._decoder.array(b"".join([arrival.data for arrival in arrivals]))
        if np.count_nonzero(np.isfinite(decoded)) != len(decoded):  # quicker than all()
            return None
        told = number % LATENCY_EVERY == 0
        waiting = iter(arrivals)
        for node, _, tpdos in self._nodes:
            for tpdo in tpdos:
                arrival = next(waiting)
                tpdo.taken = arrival.ordinal
                if told:
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


class Look:
    """Takes cycles of the nodes of one bus.

    Parameters
    ----------
    cares : of the nodes, who are told what is to be done
    watch, counts : of the bus
    count : channels of the driver
    late_ns : after a SYNC, from which on a TPDO is late
    """

    def __init__(
        self,
        cares: Sequence[NodeCare],
        watch: NodeWatch,
        counts: MutableMapping[str, int],
        count: int,
        late_ns: float,
    ) -> None:
        self._cares = cares
        self._watch = watch
        self._counts = counts
        self._count = count
        self._late_ns = late_ns

    def samples(self, number: int, now_ns: int) -> Samples:
        """Samples of cycle ``number``; what happened to each node is noticed, and its keeper told."""
        answers = Answers(self._count)
        for care in self._cares:
            node = care.node
            if self._watch.look(node, now_ns):
                care.keeper.soon()
            elif node.state == "silent":
                care.keeper.later()
            if node.state == "running":
                self.take(care, number, answers)
        self._counts["not_a_number"] += answers.no_numbers
        return answers.samples()

    def take(self, care: NodeCare, number: int, answers: Answers) -> None:
        """What came from one node that runs."""
        node = care.node
        brought = current = 0
        mixed = node.surplus_run > 0
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
            late = ago > 0 or tpdo.in_doubt or after_ns > self._late_ns
            self._counts["late"] += late
            current += not late
            good = Quality.EMERGENCY if node.emergency is not None else Quality.LATE if late else Quality.FRESH
            good = Quality.INVALID if mixed else good
            for value, positions in zip(tpdo.mapping.decoder.unpack(arrival.data), tpdo.mapping.positions, strict=True):
                for position in positions:
                    decimals = node.decimals.get(position)
                    answers.value(position, value if decimals is None else decimals.value(value), good)
                    if late:
                        answers.cycles_ago[position] = ago
                        answers.after_sync_s[position] = 0.0 if ago else after_ns / NS
        if not node.starting_anew:
            self._judge(care, brought, current)

    def _judge(self, care: NodeCare, brought: int, current: int) -> None:
        """Whether a node that brought so many TPDOs, so many of them in time, goes on as it is."""
        node = care.node
        node.misses = 0 if brought else node.misses + 1
        node.late_run = node.late_run + 1 if brought and not current else 0
        if self._watch.miscounted(node, brought):
            node.starting_anew = True
            care.keeper.soon()
        elif node.surplus_run >= SURPLUS_TOLERATED:
            care.failed(
                f"{node.place}: more TPDOs than SYNCs: two devices have this node-ID, or something else sends SYNC as "
                "well; give each device an ID of its own, and let only one send SYNC",
            )
