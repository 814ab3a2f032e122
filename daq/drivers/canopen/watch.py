"""Looking after CANopen nodes once per cycle: boot-ups, emergencies, wrong lengths, surplus TPDOs, silence.

It only notices and says so; what is to be done about it the driver hands to the node's keeper.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, MutableMapping

from daq.drivers.base import DriverContext
from daq.drivers.canopen.leadership import OPERATIONAL, PRE_OPERATIONAL, STOPPED, Leadership
from daq.drivers.canopen.node import (
    LATE_TOLERATED,
    MISSES_LOST,
    MISSES_TOLERATED,
    WATCHDOG_PERIODS,
    WRONG_TOLERATED,
    Node,
)
from daq.frames.clock import NS

NO_HEARTBEAT_MS = 100  # that takes its place for a node whose TPDOs alone say that it lives


class NodeWatch:
    """Watches the nodes of one bus.

    Parameters
    ----------
    counts : the driver's counters, which it adds to
    """

    def __init__(self, bus: str, context: DriverContext, counts: MutableMapping[str, int]) -> None:
        self._bus = bus
        self._context = context
        self._counts = counts
        self.leadership: Leadership | None = None

    def _name(self, node: Node) -> str:
        return f"{self._bus}/node {node.config.node}"

    def away(self, node: Node, state: str, what: str, detail: str) -> None:
        """The node is not running any more (or still not), and why."""
        node.state, node.detail = state, detail
        if not node.away:
            node.away = what
            node.cause = detail
            self._context.events.begin(self._name(node), what, detail)
        elif what != node.away:
            node.cause = detail
            self._context.events.note(self._name(node), what, detail)

    def back(self, node: Node) -> None:
        """The node is running."""
        node.state, node.detail, node.misses = "running", "", 0
        node.watched_ns = self._context.monotonic_ns()
        heartbeat_s = WATCHDOG_PERIODS * max((node.heartbeat_ms or NO_HEARTBEAT_MS) * 1e-3, self._context.period_s)
        node.limit_ns = max(heartbeat_s, self._context.patience_s) * NS
        if node.away:
            seconds = self._context.events.end(self._name(node), node.away)
            node.cause = f"{node.cause} (it was away for {seconds or 0.0:.1f} s)"
            node.away = ""

    def look(self, node: Node, heard_ns: int) -> bool:
        """Notice what happened to a node until ``heard_ns``; whether its keeper has to see to it at once."""
        if node.errors != node.emergencies_seen:
            self._emergencies(node)
        if node.boot_ups != node.boot_ups_seen and node.state != "commissioning":
            node.boot_ups_seen = node.boot_ups
            self._counts["boot_up"] += 1
            node.operational = False
            self.away(node, "commissioning", "boot_up", f"{node.place}: booted; it is being commissioned again")
            return True
        if node.state not in ("running", "silent"):
            return False
        surplus = node.take_surplus()
        self._counts["surplus"] += surplus
        node.surplus_run = node.surplus_run + 1 if surplus else 0
        wrong = node.wrong_lengths() - node.wrong_seen
        if wrong:
            self._counts["short_pdo"] += wrong
            node.wrong_seen += wrong
            node.wrong_run += wrong
            if node.wrong_run >= WRONG_TOLERATED:
                self.away(node, "commissioning", "short_pdo", node.short() or f"{node.place}: TPDOs of a wrong length")
                return True
        return self._signs_of_life(node, heard_ns)

    def _emergencies(self, node: Node) -> None:
        errors = node.errors
        new = errors - node.emergencies_seen
        node.emergencies_seen = errors
        self._counts["emergency"] += new
        code = "reset since" if node.emergency is None else f"0x{node.emergency:04X}"
        text = f"{node.place}: emergency {code}; see its manual"
        self._context.events.note(self._name(node), "emergency", text, new)

    def _signs_of_life(self, node: Node, now: int) -> bool:
        limit = node.limit_ns
        if node.state == "running" and now - node.heartbeat_ns <= limit and not (node.misses or node.heartbeat_lost):
            return False  # as nearly always: what follows would find nothing
        alive = max(node.heartbeat_ns, node.last_tpdo_ns())
        if node.state == "running" and now - alive > limit:
            self._counts["silent"] += 1
            self.away(
                node,
                "silent",
                "silent",
                f"{node.place}: no heartbeat for {(now - alive) / NS:.2f} s; check its power and cable",
            )
            return False
        if node.state == "silent":
            if now - alive <= limit and node.heartbeat_state == OPERATIONAL:
                self.back(node)  # only the cable was out: its mapping is still there
            return False
        self._heartbeat(node, now - max(node.heartbeat_ns, node.watched_ns), limit)
        if self._out_of_step(node):
            self.away(
                node, "commissioning", "no_tpdos", f"{node.place}: sends no TPDOs; it is being commissioned again"
            )
            return True
        return False

    def _heartbeat(self, node: Node, since_ns: int, limit_ns: float) -> None:
        """Its TPDOs come; whether its heartbeat does as well."""
        lost = since_ns > limit_ns and node.heartbeat_ms > 0
        if lost and not node.heartbeat_lost:
            self._counts["heartbeat_lost"] += 1
            self._context.events.begin(self._name(node), "heartbeat_lost", self._no_heartbeat(node))
        elif node.heartbeat_lost and not lost:
            self._context.events.end(self._name(node), "heartbeat_lost")
        node.heartbeat_lost = lost

    @staticmethod
    def _no_heartbeat(node: Node) -> str:
        return f"{node.place}: TPDOs come, but no heartbeat; check what else writes to it (0x1017)"

    def _out_of_step(self, node: Node) -> bool:
        """Alive, but no longer doing what it was commissioned for, by its own doing and not another master's."""
        if node.starting_anew:
            return False
        if node.heartbeat_state in (PRE_OPERATIONAL, STOPPED):
            by_itself = self.leadership is None or self.leadership.excused(node.config.node)
            return by_itself and node.misses >= MISSES_TOLERATED
        return node.misses >= MISSES_LOST

    @staticmethod
    def miscounted(node: Node, brought: int) -> bool:
        """Whether its TPDOs may be credited to wrong SYNCs, so that it has to be started anew."""
        if not brought:
            return False
        return node.in_doubt() or (node.behind_run >= LATE_TOLERATED and not node.slow)

    def line(self, node: Node) -> str:
        """What there is to say about a node, also about one that runs."""
        if node.detail:
            return node.detail
        if node.emergency is not None:
            return f"emergency 0x{node.emergency:04X}"
        if node.heartbeat_lost:
            return self._no_heartbeat(node)
        if node.slow:
            arrivals = [tpdo.latest for tpdo in node.tpdos if tpdo.latest is not None]
            worst = max(((a.at_ns - a.sync_ns) / 1e6 for a in arrivals), default=0.0)
            return f"{node.place}: its TPDOs come {worst:.0f} ms after SYNC, so they are marked late"
        return node.cause

    @staticmethod
    def emergency_codes(nodes: Iterable[Node], most: int) -> dict[str, int]:
        """How often each error code came, the most frequent ones by name."""
        found: Counter[int] = Counter()
        for node in nodes:
            found.update({code: count for code, count in list(node.emergencies.items()) if code})
        named = found.most_common(most)
        counts = {f"emergency 0x{code:04X}": count for code, count in named}
        rest = sum(found.values()) - sum(count for _, count in named)
        return counts | ({"emergency, other codes": rest} if rest else {})
