"""A cycle looked at node by node and TPDO by TPDO, wherever :mod:`~daq.drivers.canopen.sweep` finds anything to see."""

from __future__ import annotations

import math
from collections.abc import MutableMapping, Sequence

from daq.drivers.base import Answers, Samples
from daq.drivers.canopen.care import NodeCare
from daq.drivers.canopen.node import SURPLUS_TOLERATED, Node
from daq.drivers.canopen.watch import NodeWatch
from daq.frames.clock import NS
from daq.quality import Quality


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
            _with_decimals(node, answers)
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


def _with_decimals(node: Node, answers: Answers) -> None:
    for position, decimals in node.decimals.items():
        if math.isfinite(answers.raw[position]):
            value = answers.raw[position] = decimals.value(answers.raw[position])
            if not math.isfinite(value):
                answers.quality[position] = Quality.INVALID
