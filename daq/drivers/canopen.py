"""The CANopen driver: SYNC out, TPDOs in, and nodes that come and go without disturbing the others.

Three threads: the caller's (``trigger``, ``collect``), the link's receive thread, and a keeper that commissions
nodes which rebooted and rebuilds a bus that failed, both with back-off, while the cycle goes on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

from daq.drivers.base import DeviceStatus, DriverContext, DriverStatistics, Samples, nothing
from daq.drivers.canopen_commissioning import PRE_OPERATIONAL, commission
from daq.drivers.canopen_link import CanLink
from daq.drivers.canopen_mapping import map_node
from daq.drivers.canopen_node import (
    MISSES_LOST,
    MISSES_TOLERATED,
    STATE_OPERATIONAL,
    STATE_PRE_OPERATIONAL,
    STATE_STOPPED,
    WATCHDOG_PERIODS,
    WRONG_TOLERATED,
    Cycle,
    Node,
)
from daq.errors import AcquisitionError
from daq.machine_file import CanNode, CanopenBus, CanSource, Channel
from daq.quality import Quality

NS = 1_000_000_000
BACK_OFF_S = (0.5, 1.0, 2.0, 5.0)
BUS = 0  # the keeper's key for the bus itself; node-IDs start at 1
STOP_TIMEOUT_S = 3.0
VERIFY_CYCLES = 3
VERIFY_PATIENCE_S = 0.5  # beyond the three cycles: a shared host may not run us for that long


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
        self._nodes = self._make_nodes(bus, channels)
        self._link: CanLink | None = None
        self._condition = threading.Condition()
        self._due: dict[int, int] = {}  # node-ID, or BUS, to when the keeper takes care of it
        self._attempts: dict[int, int] = {}
        self._stopping = False
        self._keeper: threading.Thread | None = None
        self._counts = dict.fromkeys(
            (
                "sync",
                "missing",
                "late",
                "short_pdo",
                "emergency",
                "boot_up",
                "silent",
                "commissioned",
                "bus_rebuilt",
            ),
            0,
        )
        self._frames_before = self._errors_before = 0

    def _make_nodes(self, bus: CanopenBus, channels: Sequence[Channel]) -> dict[int, Node]:
        known = {node.node: node for node in bus.nodes}
        grouped: dict[int, list[tuple[int, Channel]]] = {}
        for position, channel in enumerate(channels):
            assert isinstance(channel.source, CanSource)
            grouped.setdefault(channel.source.node, []).append((position, channel))
        nodes = {}
        for number, members in grouped.items():
            place = f"bus '{bus.name}' node {number} ({', '.join(c.name for _, c in members[:3])})"
            config = known.get(number) or CanNode(node=number)
            nodes[number] = Node(config, place, map_node(number, members, place), self._cycle)
        return nodes

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the samples."""
        return self._names

    def start(self) -> tuple[str, ...]:
        """Commission all nodes, then check that each sends every TPDO within three cycles."""
        self._link = self._open()
        problems = []
        for node in self._nodes.values():
            if not self._commission(self._link, node, boot_up_s=node.config.boot_up_s):
                problems.append(node.detail)
        commissioned = [node for node in self._nodes.values() if node.state == "commissioning"]
        for _ in range(VERIFY_CYCLES):
            self._cycle.begin(-1, self._context.monotonic_ns(), set().union(*(n.cob_ids for n in commissioned)))
            self._link.send_sync()
            self._cycle.done.wait(self._context.period_s + self._context.patience_s)
            if all(node.complete() for node in commissioned):
                break
        problems += [node.detail for node in commissioned if not self._verify(node)]
        self._keeper = threading.Thread(target=self._keep, name=f"keeper-{self._config.name}", daemon=True)
        self._keeper.start()
        return tuple(problems)

    def _open(self) -> CanLink:
        link = CanLink(self._config, self._context.monotonic_ns)
        for node in self._nodes.values():
            link.handlers.update(node.handlers())
        return link

    def _commission(self, link: CanLink, node: Node, boot_up_s: float) -> bool:
        node.state, node.detail = "commissioning", ""
        node.forget()
        sdo = link.sdo(node.config.node)
        try:
            commission(
                sdo,
                lambda command: link.send_nmt(command, node.config.node),
                node.config,
                node.mappings,
                node.place,
                monotonic_ns=self._context.monotonic_ns,
                answered=node.accept_boot_ups,
                boot_up_s=boot_up_s,
            )
        except AcquisitionError as error:
            self._failed(node, str(error))
            return False
        finally:
            sdo.close()
        node.forget()
        return True

    def _verify(self, node: Node) -> bool:
        if node.complete():
            node.state, node.misses = "running", 0
            self._counts["commissioned"] += 1
            self._attempts.pop(node.config.node, None)
            return True
        missing = [f"TPDO{t.mapping.number}" for t in node.tpdos if t.count == 0]
        self._failed(
            node,
            node.short()
            or f"{node.place}: {', '.join(missing)} did not come within {VERIFY_CYCLES} SYNCs; "
            "see its manual for synchronous transmission",
        )
        return False

    def _failed(self, node: Node, detail: str) -> None:
        node.state, node.detail = "failed", detail
        self._later(node.config.node)

    def trigger(self, cycle: int) -> None:
        """Send SYNC."""
        link = self._link
        if link is None or link.failure is not None:
            self._cycle.begin(cycle, self._context.monotonic_ns(), set())
            return
        expected: set[int] = set()
        for node in self._nodes.values():
            if node.state == "running" and node.misses < MISSES_TOLERATED:
                expected |= node.cob_ids
        self._cycle.begin(cycle, self._context.monotonic_ns(), expected)
        link.send_sync()
        self._counts["sync"] += 1

    def collect(self, until_ns: int) -> Samples:
        """TPDOs of this cycle, as soon as all that are expected came."""
        link = self._link
        if link is None or link.failure is not None:
            self._later(BUS)
            return nothing(len(self._names), Quality.BUS_ERROR)
        remaining = (until_ns - self._context.monotonic_ns()) / NS
        if remaining > 0:
            self._cycle.done.wait(remaining)
        samples = nothing(len(self._names))
        number = self._cycle.number
        for node in self._nodes.values():
            self._look_after(node)
            if node.state == "running":
                self._take(node, number, samples)
        return samples

    def _take(self, node: Node, number: int, samples: Samples) -> None:
        fresh = True
        for tpdo in node.tpdos:
            ago = number - tpdo.cycle
            if tpdo.cycle < 0 or ago > 1 or (ago == 1 and tpdo.taken == tpdo.count):
                fresh = False
                self._counts["missing"] += 1
                continue
            if ago == 1:
                fresh = False
                self._counts["late"] += 1
            tpdo.taken = tpdo.count
            quality = Quality.FRESH if node.emergency is None else Quality.EMERGENCY
            for value, positions in zip(tpdo.mapping.decoder.unpack(tpdo.data), tpdo.mapping.positions, strict=True):
                for position in positions:
                    samples.raw[position] = value
                    samples.quality[position] = quality
                    samples.cycles_ago[position] = ago
        node.misses = 0 if fresh else node.misses + 1

    def _look_after(self, node: Node) -> None:
        """Boot-ups, emergencies, wrong lengths and silence of one node, noticed once per cycle."""
        self._counts["emergency"] += node.take_emergencies()
        if node.boot_ups != node.boot_ups_seen and node.state != "commissioning":
            node.boot_ups_seen = node.boot_ups
            self._counts["boot_up"] += 1
            node.state, node.detail = "commissioning", f"{node.place}: booted; it is being commissioned again"
            self._attempts.pop(node.config.node, None)
            self._soon(node.config.node)
            return
        if node.state not in ("running", "silent"):
            return
        wrong = node.wrong_lengths() - node.wrong_seen
        if wrong:
            self._counts["short_pdo"] += wrong
            node.wrong_seen += wrong
            node.wrong_run += wrong
            if node.wrong_run >= WRONG_TOLERATED:
                node.detail = node.short() or ""
                node.state = "commissioning"
                self._soon(node.config.node)
                return
        alive = node.last_sign_ns()
        heartbeat_s = WATCHDOG_PERIODS * max(node.config.heartbeat_ms * 1e-3, self._context.period_s)
        limit = max(heartbeat_s, self._context.patience_s) * NS
        now = self._context.monotonic_ns()
        if node.state == "running" and now - alive > limit:
            node.state = "silent"
            node.detail = f"{node.place}: no heartbeat for {(now - alive) / NS:.2f} s; check its power and cable"
            self._counts["silent"] += 1
            self._later(node.config.node)
        elif node.state == "silent" and now - alive <= limit and node.heartbeat_state == STATE_OPERATIONAL:
            node.state, node.detail, node.misses = (
                "running",
                "",
                0,
            )  # only the cable was out: its mapping is still there
            self._forget_due(node.config.node)
        elif node.state == "running" and self._out_of_step(node):
            node.state, node.detail = (
                "commissioning",
                f"{node.place}: sends no TPDOs; it is being commissioned again",
            )
            self._soon(node.config.node)

    @staticmethod
    def _out_of_step(node: Node) -> bool:
        """Alive, but no longer doing what it was commissioned for."""
        if node.heartbeat_state in (STATE_PRE_OPERATIONAL, STATE_STOPPED):
            return node.misses >= MISSES_TOLERATED  # a single such heartbeat may be from before it went operational
        return node.misses >= MISSES_LOST

    def _soon(self, key: int) -> None:
        with self._condition:
            self._due[key] = self._context.monotonic_ns()
            self._condition.notify()

    def _later(self, key: int) -> None:
        """Hand ``key`` to the keeper after its back-off, unless it has it already."""
        with self._condition:
            if key in self._due:
                return
            attempt = self._attempts.get(key, 0)
            self._attempts[key] = attempt + 1
            pause = BACK_OFF_S[min(attempt, len(BACK_OFF_S) - 1)]
            self._due[key] = self._context.monotonic_ns() + round(pause * NS)
            self._condition.notify()

    def _forget_due(self, key: int) -> None:
        with self._condition:
            self._due.pop(key, None)
            self._attempts.pop(key, None)

    def _keep(self) -> None:
        while True:
            with self._condition:
                if self._stopping:
                    return
                now = self._context.monotonic_ns()
                key = min(self._due, key=self._due.__getitem__, default=None)
                if key is None or self._due[key] > now:
                    self._condition.wait(0.5 if key is None else min(0.5, (self._due[key] - now) / NS))
                    continue
                del self._due[key]
            link = self._link
            healthy = link is not None and link.failure is None
            if key == BUS and not healthy:
                self._rebuild()
            elif key != BUS and link is not None and healthy:
                self._recommission(link, self._nodes[key])

    def _recommission(self, link: CanLink, node: Node) -> None:
        if not self._commission(link, node, boot_up_s=0.0):
            return
        deadline = time.monotonic() + VERIFY_CYCLES * self._context.period_s + VERIFY_PATIENCE_S
        while not node.complete() and time.monotonic() < deadline and not self._stopping:
            time.sleep(self._context.period_s / 4)
        self._verify(node)

    def _rebuild(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            self._frames_before += link.frames
            self._errors_before += link.error_frames
            link.close()
        try:
            link = self._open()
        except AcquisitionError as error:
            for node in self._nodes.values():
                node.state, node.detail = "failed", str(error)
            self._later(BUS)
            return
        self._counts["bus_rebuilt"] += 1
        for node in self._nodes.values():
            node.state = "commissioning"
        self._link = link  # from here on the cycle sends SYNC again
        self._forget_due(BUS)
        for node in self._nodes.values():
            if not self._stopping:
                self._recommission(link, node)

    def statistics(self) -> DriverStatistics:
        """State of every node, and counters since the start."""
        link = self._link
        failure = link.failure if link is not None else None
        devices = tuple(
            DeviceStatus(
                f"node {number}",
                "failed" if failure else node.state,
                failure or node.detail or (f"emergency 0x{node.emergency:04X}" if node.emergency is not None else ""),
            )
            for number, node in self._nodes.items()
        )
        counts = dict(self._counts)
        counts["frames"] = self._frames_before + (link.frames if link is not None else 0)
        counts["error_frames"] = self._errors_before + (link.error_frames if link is not None else 0)
        return DriverStatistics(self._config.name, devices, counts)

    def stop(self) -> None:
        """Leave the nodes pre-operational, so that they stop sending, and close the bus."""
        with self._condition:
            self._stopping = True
            self._condition.notify()
        if self._keeper is not None:
            self._keeper.join(timeout=STOP_TIMEOUT_S)
            self._keeper = None
        link, self._link = self._link, None
        if link is not None:
            for number in self._nodes:
                link.send_nmt(PRE_OPERATIONAL, number)
            link.close()
