"""The process of all simulated CANopen nodes of a machine.

One loop, no threads: packets from the hub, orders from the parent, heartbeats when they are due. Frames that belong
to one wake-up leave as one packet, already in socketcand's text, so that the hub only has to pass it on.
"""

from __future__ import annotations

import random
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import daq.without_mdf4  # noqa: F401
from sim_backends import backplane
from sim_backends.child import Order, Orders, report
from sim_backends.devices.canopen_device import SimulatedNode
from sim_backends.devices.device_plans import NodePlan, nodes_from_dict

Emit = Callable[[int, bytes], None]  # COB-ID, data
_TPDOS = (0x180, 0x280, 0x380, 0x480)
KINDS = ("lag", "lose", "drop", "corrupt", "doubled", "garbled")


class FaultyLine:
    """One node's frames on their way to the bus, which the node knows nothing of.

    Delays are counted in SYNCs, because to a simulated machine nothing but SYNC is time.

    Attributes
    ----------
    lag : SYNCs by which TPDOs come too late
    lose : TPDOs that are still to be lost
    drop : share of the TPDOs that are lost
    corrupt : share of the TPDOs that are disturbed on the cable: their check sum does not fit, so that everybody sees
        an error frame instead of them
    doubled : a second device with the same node-ID: TPDOs and SDO answers come twice, with other values
    garbled : SDO answers are cut to two bytes
    """

    def __init__(self, node: int, emit: Emit, emit_error: Callable[[], None]) -> None:
        self._node = node
        self._emit = emit
        self._emit_error = emit_error
        self._random = random.Random(node)
        self._syncs = 0
        self._delayed: deque[tuple[int, int, bytes]] = deque()
        self.lag = self.lose = 0
        self.drop = self.corrupt = 0.0
        self.doubled = self.garbled = False

    def on_sync(self) -> None:
        """Send at a SYNC what was delayed until now."""
        self._syncs += 1
        while self._delayed and (not self.lag or self._delayed[0][0] <= self._syncs):
            _, cob_id, data = self._delayed.popleft()
            self._emit(cob_id, data)

    def emit(self, cob_id: int, data: bytes) -> None:
        """Send a frame from the node."""
        function = cob_id - self._node
        if function == 0x580:
            data = data[:2] if self.garbled else data
        elif function in _TPDOS and self._spoilt(cob_id, data):
            return
        self._emit(cob_id, data)
        if self.doubled:
            self._emit(cob_id, data[:-1] + bytes([data[-1] ^ 0x01]) if data else data)

    def _spoilt(self, cob_id: int, data: bytes) -> bool:
        """Test whether a TPDO does not get through now."""
        if self.lose:
            self.lose -= 1
            return True
        if self.drop and self._random.random() < self.drop:
            return True
        if self.corrupt and self._random.random() < self.corrupt:
            self._emit_error()
            return True
        if self.lag:
            self._delayed.append((self._syncs + self.lag, cob_id, data))
            return True
        return False


BIT_ERROR = 0x088  # protocol violation, bus error (linux/can/error.h)
FRAMES_PER_PACKET = 1000  # of at most 50 characters: a packet is no longer than backplane.PACKET


class _Nodes:
    """All nodes, and the bus they share."""

    def __init__(self, hub: socket.socket, plans: tuple[NodePlan, ...], rate_hz: float) -> None:
        self._hub = hub
        self._out: list[bytes] = []
        self._stamp = ""
        self._clock_jump = 0.0  # s by which time stamps of the bus are wrong
        self.lines = {plan.node: FaultyLine(plan.node, self._emit, self._emit_error) for plan in plans}
        self.nodes = {plan.node: SimulatedNode(plan, self.lines[plan.node].emit, rate_hz) for plan in plans}

    def _emit(self, cob_id: int, data: bytes) -> None:
        self._out.append(f"< frame {cob_id:03X} {self._stamp} {data.hex().upper()} >".encode())

    def _emit_error(self) -> None:
        self._out.append(f"< error {BIT_ERROR:08X} {self._stamp} >".encode())

    def _wake(self) -> float:
        self._stamp = f"{time.time() + self._clock_jump:.6f}"
        return time.monotonic()

    def _send(self) -> None:
        for start in range(0, len(self._out), FRAMES_PER_PACKET):
            self._hub.send(backplane.TEXT + b"".join(self._out[start : start + FRAMES_PER_PACKET]))
        self._out.clear()

    def power_on(self) -> None:
        """Boot all nodes."""
        now = self._wake()
        for node in self.nodes.values():
            node.power_on(now)
        self._send()

    def on_packet(self, packet: bytes) -> None:
        """Handle a SYNC with its state, or another frame from the bus."""
        now = self._wake()
        if packet[:1] == backplane.SYNC:
            _, values = backplane.unpack_state(packet[1:])
            for number, node in self.nodes.items():
                self.lines[number].on_sync()
                node.on_sync(values)
        elif packet[:1] == backplane.STATE:  # at power-on, before any SYNC
            _, values = backplane.unpack_state(packet[1:])
            for node in self.nodes.values():
                node.latch(values)
        else:
            head = backplane.FRAME_HEAD
            identifier, _ = head.unpack_from(packet, 1)
            data = packet[1 + head.size :]
            if identifier == 0:
                for node in self.nodes.values():
                    node.on_frame(0, data, now)
            elif identifier & 0x780 == 0x600 and identifier & 0x7F in self.nodes:
                self.nodes[identifier & 0x7F].on_frame(identifier, data, now)
        self._send()

    def on_time(self) -> float | None:
        """Send heartbeats that are due; return seconds until the next one."""
        now = self._wake()
        next_due = None
        for node in self.nodes.values():
            node.on_time(now)
            if node.heartbeat_due is not None and node.alive:
                next_due = min(node.heartbeat_due, next_due or node.heartbeat_due)
        self._send()
        return None if next_due is None else max(0.0, next_due - time.monotonic())

    # Faults

    def fault(self, order: Order) -> Any:
        """Order one of the faults of :mod:`sim_backends.faults.fault_runner` and of tests, on one node."""
        now = self._wake()
        node = self.nodes[int(order["node"])]
        kind = order["kind"]
        if kind == "kill":
            node.alive = False
        elif kind == "revive":
            node.power_on(now)
        elif kind == "reset":
            node.on_nmt(0x81, now)
        elif kind == "emergency":
            node.emergency(int(order["code"]), int(order["register"]))
        elif kind == "short":
            node.short = order["length"]
        elif kind == "freeze":
            node.frozen = bool(order["on"])
        elif kind == "silence":
            node.silent = bool(order["on"])
        elif kind == "storm":
            for _ in range(int(order["count"])):
                node.emergency(int(order["code"]), 0x81)
        elif kind == "not_a_number":
            node.not_a_number = bool(order["on"])
        elif kind == "signal":
            node.signal_faults.set(order["channel"], order["what"], float(order["size"]), bool(order["on"]))
        elif kind in KINDS:
            setattr(self.lines[node.id], kind, order["value"])
        else:
            raise ValueError(f"no fault '{kind}'")
        self._send()
        return None

    def jump(self, order: Order) -> None:
        """Make time stamps wrong by so many seconds from now on."""
        self._clock_jump = float(order["seconds"])

    def run(self, orders: Orders) -> None:
        """Serve until the parent closes its end or the hub is gone."""
        selector = selectors.DefaultSelector()
        selector.register(self._hub, selectors.EVENT_READ)
        selector.register(orders, selectors.EVENT_READ)
        due = self.on_time()
        while not orders.closed:
            events = selector.select(due)
            for key, _ in events:
                if key.fileobj is orders:
                    orders.work_off({"fault": self.fault, "clock_jump": self.jump})
                else:
                    packet = self._hub.recv(backplane.PACKET)
                    if not packet:
                        return
                    self.on_packet(packet)
            due = self.on_time()


def main() -> None:
    """Run the nodes' process."""
    orders = Orders()
    configuration = orders.configuration()
    nodes = _Nodes(
        backplane.adopt(configuration["hub"]), nodes_from_dict(configuration["nodes"]), configuration["rate_hz"]
    )
    nodes.power_on()
    report({"ready": {"nodes": sorted(nodes.nodes)}})
    nodes.run(orders)


if __name__ == "__main__":
    main()
