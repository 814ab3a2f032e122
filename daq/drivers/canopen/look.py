"""Taking the TPDOs of a cycle: at once where nothing is out of the ordinary, else node by node.

Where every node runs and lives, and each of its TPDOs answers the SYNC of this cycle in time, as nearly always, looking
at the nodes one by one would find nothing: the data of all TPDOs are decoded as one, and no channel is handled by
itself, which costs a fraction. Whatever else is the case, nothing has been changed, and each node and each TPDO is
looked at.
"""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence

import numpy as np

from daq.drivers.base import Answers, Samples
from daq.drivers.canopen.care import NodeCare
from daq.drivers.canopen.mapping import PdoDecoder
from daq.drivers.canopen.node import LATE_TOLERATED, SURPLUS_TOLERATED
from daq.drivers.canopen.tpdo import Arrival, Cycle
from daq.frames.clock import NS
from daq.messages import Sentence
from daq.quality import Quality

LATENCY_EVERY = 8  # whole cycles, of one of which it is noted how long answers took


class Look:
    """Takes cycles of the nodes of one bus.

    Parameters
    ----------
    cares : of the nodes, which do what is to be done
    counts : of the bus
    count : channels of the driver
    late_ns : after a SYNC, from which on a TPDO is late
    """

    def __init__(
        self,
        cares: Sequence[NodeCare],
        counts: MutableMapping[str, int],
        count: int,
        late_ns: float,
    ) -> None:
        self._cares = cares
        self._counts = counts
        self._count = count
        self._late_ns = late_ns
        self._nodes = [care.node for care in cares]
        self._tpdos = [(node, tpdo) for node in self._nodes for tpdo in node.tpdos]
        tpdos = [tpdo for _, tpdo in self._tpdos]
        self._wrong = [0] * len(tpdos)
        self._decoder = PdoDecoder([kind for tpdo in tpdos for kind in tpdo.mapping.decoder.data_types])
        entries = [positions for tpdo in tpdos for positions in tpdo.mapping.positions]
        self._from = np.zeros(count, dtype=np.intp)  # for each channel, which of the decoded numbers
        for number, positions in enumerate(entries):
            self._from[list(positions)] = number
        self._possible = not any(care.node.decimals for care in cares)
        self._fresh = np.zeros(count, dtype=np.uint8)
        self._no_cycles, self._at_sync = np.zeros(count, dtype=np.int64), np.zeros(count)
        for constant in (self._fresh, self._no_cycles, self._at_sync):
            constant.flags.writeable = False

    def samples(self, cycle: Cycle, received_ns: int) -> Samples:
        """Return samples of a cycle; all that came up to ``received_ns`` was taken."""
        whole = self._whole(cycle.number, received_ns)
        return self._one_by_one(cycle, received_ns) if whole is None else whole

    def _whole(self, number: int, received_ns: int) -> Samples | None:
        """Return samples of a cycle that is usual; None, and nothing changed, if there is anything to be seen."""
        arrivals = self._arrivals(number, received_ns)
        if arrivals is None:
            return None
        decoded = self._decoder.array(b"".join([arrival.data for arrival in arrivals]))
        if np.count_nonzero(np.isfinite(decoded)) != len(decoded):  # quicker than all()
            return None
        timed = number % LATENCY_EVERY == 0
        for (node, tpdo), arrival in zip(self._tpdos, arrivals, strict=True):
            tpdo.taken = arrival.ordinal
            if timed:
                node.latency.add(arrival.at_ns - arrival.sync_ns)
        return Samples(decoded[self._from], self._fresh, self._no_cycles, self._at_sync, plain=True)

    def _arrivals(self, number: int, received_ns: int) -> list[Arrival] | None:
        """Return what came, by node and TPDO, if it is all that is due and there is nothing else to be seen."""
        if not self._possible:
            return None
        found: list[Arrival] = []
        late_ns, wrong = self._late_ns, self._wrong
        for node in self._nodes:
            if (
                node.state != "running"
                or node.errors != node.emergencies_seen
                or node.boot_ups != node.boot_ups_seen
                or node.emergency is not None
                or received_ns - node.heartbeat_ns > node.limit_ns
                or node.misses
                or node.late_run
                or node.slow
                or node.surplus_run
                or node.starting_anew
                or node.heartbeat_lost
            ):
                return None
            for tpdo in node.tpdos:
                arrival = tpdo.latest
                if (
                    arrival is None
                    or arrival.cycle != number
                    or arrival.ordinal != tpdo.taken + 1
                    or arrival.at_ns - arrival.sync_ns > late_ns
                    or tpdo.ambiguous
                    or tpdo.surplus != tpdo.surplus_seen
                ):
                    return None
                if tpdo.wrong != wrong[len(found)]:
                    wrong[len(found)] = tpdo.wrong
                    return None
                found.append(arrival)
        return found

    def _one_by_one(self, cycle: Cycle, received_ns: int) -> Samples:
        """Notice what happened to each node, and notify its keeper."""
        number, received = cycle.number, received_ns > cycle.sync_ns
        answers = Answers(self._count)
        for care in self._cares:
            node = care.node
            if node.look(received_ns):
                care.keeper.soon()
            elif node.state == "silent":
                care.keeper.later()
            if node.state == "running":
                self.take(care, number, answers, received=received)
        self._counts["not_a_number"] += answers.no_numbers
        return answers.samples()

    def take(self, care: NodeCare, number: int, answers: Answers, *, received: bool) -> None:
        """Take what came from one running node; ``received``: whether this process listened since the SYNC."""
        node = care.node
        brought = timely = current = 0
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
            late = ago > 0 or tpdo.ambiguous or after_ns > self._late_ns
            self._counts["late"] += late
            timely += not late
            current += not (ago or tpdo.ambiguous)
            good = Quality.EMERGENCY if node.emergency is not None else Quality.LATE if late else Quality.FRESH
            good = Quality.INVALID if mixed else good
            for value, positions in zip(tpdo.mapping.decoder.unpack(arrival.data), tpdo.mapping.positions, strict=True):
                for position in positions:
                    decimals = node.decimals.get(position)
                    answers.value(position, value if decimals is None else decimals.value(value), good)
                    if late:
                        answers.cycles_ago[position] = ago
                        answers.after_sync_s[position] = 0.0 if ago else after_ns / NS
        if not node.starting_anew and (brought or received):
            self._judge(care, brought, timely, current)

    def _judge(self, care: NodeCare, brought: int, timely: int, current: int) -> None:
        """Decide whether a node with so many TPDOs, some in time, some of this cycle, goes on as it is."""
        node = care.node
        node.misses = 0 if brought else node.misses + 1
        node.late_run = node.late_run + 1 if brought and not timely else 0
        node.behind_run = node.behind_run + 1 if brought and not current else 0
        if timely:
            node.slow = False
        elif node.late_run >= LATE_TOLERATED and current:  # no older SYNC waits: late, and not miscounted
            node.slow = True
        if node.miscounted(brought):
            node.starting_anew = True
            care.keeper.soon()
        elif node.surplus_run >= SURPLUS_TOLERATED:
            care.failed(Sentence("daq.more_tpdos_syncs_two", place=node.place))
