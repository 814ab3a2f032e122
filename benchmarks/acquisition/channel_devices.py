"""CANopen nodes of many machines in one process, cheap enough to run beside what is measured.

``python -m benchmarks.acquisition.channel_devices MACHINES NODES DEAD PORT`` prints a port for each machine and serves
until standard input ends. Nodes 1 to DEAD of each are not there. PORT is that of the first machine, 0 for a free one.
"""

from __future__ import annotations

import selectors
import socket
import sys
import time

from sim_backends.devices.canopen_device import SimulatedNode
from sim_backends.devices.device_plans import NodeObject, NodePlan, Signal

RATE_HZ = 50.0
BEAT_S = 0.05  # between two looks for heartbeats that are due


class _Bus:
    """One machine's nodes and the client that talks to them."""

    def __init__(self, nodes: int, dead: int, port: int) -> None:
        self.listener = socket.create_server(("127.0.0.1", port))
        self.client: socket.socket | None = None
        self.raw = False
        self._received = b""
        self._out: list[bytes] = []
        self._answer = b""  # to the next SYNC, as long as no node changes its state
        signal = Signal("c", 0, 1.0, 0.0, "float32")
        self._nodes = {}
        for number in range(dead + 1, nodes + 1):
            objects = tuple(NodeObject(0x6130, sub, signal) for sub in (1, 2))
            plan = NodePlan(number, "pressure_transducer", objects)
            self._nodes[number] = SimulatedNode(plan, self._emit, RATE_HZ)
            self._nodes[number].power_on(time.monotonic())
        self._out.clear()

    def _emit(self, cob_id: int, data: bytes) -> None:
        self._out.append(f"< frame {cob_id:03X} 0.000000 {data.hex().upper()} >".encode())

    def beat(self, now: float) -> None:
        """Send the heartbeats that are due."""
        for node in self._nodes.values():
            node.on_time(now)
        self.flush()

    def flush(self) -> None:
        """Send what the nodes have queued."""
        if self._out and self.client is not None and self.raw:
            self.client.sendall(b"".join(self._out))
        self._out.clear()

    def receive(self) -> bool:
        """Take what the client sent; False if it went."""
        assert self.client is not None
        try:
            data = self.client.recv(1 << 16)
        except ConnectionResetError:
            data = b""
        if not data:
            self.client.close()
            self.client, self.raw = None, False
            return False
        *commands, self._received = (self._received + data).split(b">")
        for command in commands:
            self._command(command.strip(b"< ").split())
        self.flush()
        return True

    def _command(self, words: list[bytes]) -> None:
        assert self.client is not None
        if words[0] != b"send":
            self.client.sendall(b"< ok >")
            self.raw = words[0] == b"rawmode"
            return
        identifier, content = int(words[1], 16), bytes(int(word, 16) for word in words[3:])
        if identifier == 0x080:
            if not self._answer:
                before = len(self._out)  # answers to what came with it
                for node in self._nodes.values():
                    node.on_sync((42.0,))
                self._answer = b"".join(self._out[before:])
            else:
                self._out.append(self._answer)
            return
        self._answer = b""
        now = time.monotonic()
        for number, node in self._nodes.items():
            if identifier in (0, 0x600 + number):
                node.on_frame(identifier, content, now)


def _serve(machines: int, nodes: int, dead: int, port: int) -> None:
    buses = [_Bus(nodes, dead, port if not number else 0) for number in range(machines)]
    selector = selectors.DefaultSelector()
    selector.register(sys.stdin, selectors.EVENT_READ)
    for bus in buses:
        selector.register(bus.listener, selectors.EVENT_READ, bus)
    print(*(bus.listener.getsockname()[1] for bus in buses), flush=True)
    beat = time.monotonic()
    while True:
        for key, _ in selector.select(max(0.0, beat - time.monotonic())):
            if key.fileobj is sys.stdin:
                return
            bus = key.data
            if key.fileobj == bus.listener:
                made, _ = bus.listener.accept()
                made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                if bus.client is not None:
                    selector.unregister(bus.client)
                    bus.client.close()
                bus.client, bus.raw = made, False
                selector.register(made, selectors.EVENT_READ, bus)
                made.sendall(b"< hi >")
            elif key.fileobj == bus.client:
                connection = bus.client
                if not bus.receive():
                    selector.unregister(connection)
        if (now := time.monotonic()) >= beat:
            beat = now + BEAT_S
            for bus in buses:
                bus.beat(now)


if __name__ == "__main__":
    _serve(*(int(word) for word in sys.argv[1:5]))
