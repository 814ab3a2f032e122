"""The CAN bus of a simulated machine: a small TCP hub that speaks the socketcand protocol.

Clients are python-can's stock ``socketcand`` interface (raw mode): they connect, say ``< open can0 >`` and
``< rawmode >``, then send ``< send 123 2 11 22 >`` and receive ``< frame 123 1699.123456 1122 >``. Every frame goes to
all other clients and to the simulated nodes.

Time is lockstep. SYNC (COB-ID 0x080) first makes the plant advance by one period and hand its state over, then the
nodes get SYNC and that state in one packet. A Modbus device asks with a barrier for the state: the hub first works
off everything that clients have sent before, so a request that was sent after a SYNC is answered with the state
latched at that SYNC.

A client that has nobody to wait for sends its SYNCs at their times, whether a busy computer runs the plant as often or
not. Worked off one after the other they would keep the hub from everything else, for ever: nodes would wait for it to
take their frames, so nobody would answer, so nobody would be waited for. Of SYNCs that wait only the newest few count.

What this bus does not have: bit rate, arbitration, error counters, remote frames.
"""

from __future__ import annotations

import random
import selectors
import socket
import time
from collections import deque
from typing import Any

from sim_backends import backplane
from sim_backends.child import Order, Orders, report

SYNC_ID = 0x080
BUS_OFF = 0x040  # class of an error frame (linux/can/error.h)
QUIET = 0.1  # s after rawmode in which a client gets no frames, unless it sends: its handshake expects bare answers
SYNCS_WAITING = 8  # at most; older ones are lost, as frames are on a bus that is too slow
PACKETS = 2 * SYNCS_WAITING  # of the nodes that are taken at once: they answer each SYNC with one, and send more
PASSES = 4  # in which a barrier works off what came before it; a client that sends on does not keep the hub for ever
STALLED = 64 << 20  # bytes that wait for a client that does not read
PLANT_PATIENCE = 120.0  # s for an answer to STEP on a busy computer; a plant that died is seen at once


class _Client:
    """One socketcand connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.received = b""
        self.waiting = bytearray()
        self.raw = False
        self.quiet_until = 0.0


class Hub:
    """The hub's loop.

    Parameters
    ----------
    channel : str
        Name of the bus, as clients open it.
    plant, nodes, modbus : socket.socket
        Backplane ends.
    """

    def __init__(self, channel: str, plant: socket.socket, nodes: socket.socket, modbus: socket.socket) -> None:
        self._channel = channel
        self._plant, self._nodes, self._modbus = plant, nodes, modbus
        for end in (nodes, modbus):
            end.setblocking(False)
        self._backlog: dict[socket.socket, deque[bytes]] = {nodes: deque(), modbus: deque()}
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._clients: dict[socket.socket, _Client] = {}
        self._everything = selectors.DefaultSelector()
        self._arrivals = selectors.DefaultSelector()  # clients only: what a barrier has to work off
        watch = self._everything.register
        watch(self._listener, selectors.EVENT_READ, self._accept)
        watch(self._nodes, selectors.EVENT_READ, self._from_nodes)
        watch(self._modbus, selectors.EVENT_READ, self._from_modbus)
        self._bus_off = False
        self._half_open = False  # the gateway is gone, and its connections do not know it
        self._slow = 0.0  # s that each of two parts of a packet from the nodes takes
        self._jitter = 0.0  # s by which SYNC comes too late at most
        self._clock_jump = 0.0  # s by which time stamps are wrong
        self._random = random.Random(0)
        self.counts = {"sync": 0, "lost_sync": 0, "frames": 0, "clients": 0, "barriers": 0}
        self._state = self._from_plant()  # at power-on, as long as the parent lets the plant take
        self._plant.settimeout(PLANT_PATIENCE)

    @property
    def port(self) -> int:
        """TCP port that clients connect to."""
        return int(self._listener.getsockname()[1])

    def _from_plant(self) -> bytes:
        packet = self._plant.recv(backplane.PACKET)
        if not packet:
            raise SystemExit("hub: the plant is gone")
        return packet[1:]

    def run(self, orders: Orders) -> None:
        """Serve until the parent closes its end."""
        self._packet(self._nodes, backplane.STATE + self._state)
        handlers = {
            "counts": lambda order: self.counts,
            "drop_clients": self._drop_clients,
            "error_frame": self._error_frame,
            "inject": self._inject,
            "bus_off": self._set_bus_off,
            "half_open": self._set_half_open,
            "slow": self._set_slow,
            "jitter": self._set_jitter,
            "clock_jump": self._jump,
        }
        self._everything.register(orders, selectors.EVENT_READ, lambda: orders.work_off(handlers))
        while not orders.closed:
            self.look()

    def look(self) -> None:
        """Wait until something is there, then serve everybody who has something once."""
        for key, events in self._everything.select():
            if isinstance(key.data, _Client):
                if events & selectors.EVENT_WRITE:
                    self._flush(key.data)
                if events & selectors.EVENT_READ:
                    self._from_client(key.data)
            elif events & selectors.EVENT_WRITE and isinstance(key.fileobj, socket.socket):
                self._catch_up(key.fileobj)
            else:
                key.data()

    def close(self) -> None:
        """Close all connections, and the port."""
        for client in list(self._clients.values()):
            self._drop(client)
        for selector in (self._everything, self._arrivals):
            selector.close()
        self._listener.close()

    # Clients

    def _accept(self) -> None:
        if self._half_open:
            return  # it stays in the listener's queue, connected and unheard
        try:
            connection, _ = self._listener.accept()
        except BlockingIOError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection)
        self._clients[connection] = client
        self._everything.register(connection, selectors.EVENT_READ, client)
        self._arrivals.register(connection, selectors.EVENT_READ, client)
        self.counts["clients"] += 1
        self._send(client, b"< hi >")

    def _drop(self, client: _Client) -> None:
        if self._clients.pop(client.socket, None) is not None:
            if not self._half_open:
                self._everything.unregister(client.socket)
                self._arrivals.unregister(client.socket)
            client.socket.close()

    def _send(self, client: _Client, text: bytes) -> None:
        if client.waiting:
            client.waiting += text
            if len(client.waiting) > STALLED:
                self._drop(client)
            return
        try:
            sent = client.socket.send(text)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop(client)
            return
        if sent < len(text):
            client.waiting += text[sent:]
            self._everything.modify(client.socket, selectors.EVENT_READ | selectors.EVENT_WRITE, client)

    def _flush(self, client: _Client) -> None:
        try:
            sent = client.socket.send(client.waiting[: 1 << 18])
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)
            return
        del client.waiting[:sent]
        if not client.waiting:
            self._everything.modify(client.socket, selectors.EVENT_READ, client)

    def _from_client(self, client: _Client) -> None:
        if client.socket not in self._clients or self._half_open:
            return
        try:
            data = client.socket.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        *commands, client.received = (client.received + data).split(b">")
        lines = [command.strip(b"< \r\n").split() for command in commands]
        surplus = sum(map(_is_sync, lines)) - SYNCS_WAITING
        for words in lines:
            if surplus > 0 and _is_sync(words):
                surplus -= 1
                self.counts["lost_sync"] += 1
                continue
            self._command(client, words)
        if len(client.received) > 4096:  # no command is that long: not a socketcand client
            self._drop(client)

    def _command(self, client: _Client, words: list[bytes]) -> None:
        if words[:1] == [b"send"] and client.raw:
            frame = _parse(words)
            if frame is None:
                self._send(client, b"< error could not parse send >")
            else:
                client.quiet_until = 0.0
                self._on_bus(client, *frame)
        elif words == [b"open", self._channel.encode()]:
            self._send(client, b"< ok >")
        elif words == [b"rawmode"]:
            self._send(client, b"< ok >")
            client.raw, client.quiet_until = True, time.monotonic() + QUIET
        elif words == [b"echo"]:
            self._send(client, b"< echo >")
        elif words[:1] == [b"open"]:
            self._send(client, b"< error could not open bus >")
        else:
            self._send(client, b"< error unknown command >")

    # Frames

    def _stamp(self) -> str:
        return f"{time.time() + self._clock_jump:.6f}"

    def _on_bus(self, sender: _Client | None, identifier: int, extended: bool, data: bytes) -> None:
        if self._bus_off:
            self._send_error(BUS_OFF)
            return
        self.counts["frames"] += 1
        sync = identifier == SYNC_ID and not extended
        if sync:
            if self._jitter:
                time.sleep(self._random.uniform(0.0, self._jitter))
            self._plant.send(backplane.STEP)
            self._state = self._from_plant()
            self.counts["sync"] += 1
        name = f"{identifier:08X}" if extended else f"{identifier:03X}"
        self._broadcast(f"< frame {name} {self._stamp()} {data.hex().upper()} >".encode(), sender)
        if sync:
            self._packet(self._nodes, backplane.SYNC + self._state)
        else:
            head = backplane.FRAME_HEAD.pack(identifier | (extended << 31), len(data))
            self._packet(self._nodes, backplane.FRAME + head + data)

    def _send_error(self, identifier: int) -> None:
        self._broadcast(f"< error {identifier:08X} {self._stamp()} >".encode(), None)

    def _broadcast(self, text: bytes, sender: _Client | None) -> None:
        if self._half_open:
            return
        for client in list(self._clients.values()):
            if client is sender or not client.raw:
                continue
            if client.quiet_until and client.quiet_until > time.monotonic():
                continue
            client.quiet_until = 0.0
            self._send(client, text)

    # Devices

    def _packet(self, end: socket.socket, packet: bytes) -> None:
        """Send to a device process; never block, because that process may be waiting for the hub."""
        backlog = self._backlog[end]
        if not backlog:
            try:
                end.send(packet)
                return
            except BlockingIOError:
                self._everything.modify(
                    end, selectors.EVENT_READ | selectors.EVENT_WRITE, self._everything.get_key(end).data
                )
        backlog.append(packet)

    def _catch_up(self, end: socket.socket) -> None:
        backlog = self._backlog[end]
        while backlog:
            try:
                end.send(backlog[0])
            except BlockingIOError:
                return
            backlog.popleft()
        self._everything.modify(end, selectors.EVENT_READ, self._everything.get_key(end).data)

    def _from_nodes(self) -> None:
        """Read what the nodes have sent, more of it than one look at the clients can make them send."""
        for _ in range(PACKETS):
            try:
                packet = self._nodes.recv(backplane.PACKET)
            except BlockingIOError:
                return
            if not packet:
                raise SystemExit("hub: the nodes are gone")
            self._frames_of_nodes(packet)

    def _frames_of_nodes(self, packet: bytes) -> None:
        if self._bus_off:
            return
        text = packet[1:]
        if self._slow:  # a gateway that is busy hands frames on late, and cut somewhere
            time.sleep(self._slow)
            self._broadcast(text[: len(text) // 2], None)
            time.sleep(self._slow)
            text = text[len(text) // 2 :]
        self._broadcast(text, None)

    def _from_modbus(self) -> None:
        packet = self._modbus.recv(backplane.PACKET)
        if not packet:
            raise SystemExit("hub: the Modbus devices are gone")
        self.counts["barriers"] += 1
        self._accept()
        for _ in range(PASSES):
            arrived = self._arrivals.select(0)
            for key, _ in arrived:
                self._from_client(key.data)
            if not arrived:
                break
        self._packet(self._modbus, backplane.STATE + self._state)

    # Faults

    def _drop_clients(self, order: Order) -> int:
        """Close all connections, as a gateway that reboots does."""
        clients = list(self._clients.values())
        for client in clients:
            self._drop(client)
        return len(clients)

    def _error_frame(self, order: Order) -> None:
        """Make an error frame, as a disturbed cable gives; its identifier names the error (linux/can/error.h)."""
        self._send_error(int(order["identifier"]))

    def _inject(self, order: Order) -> None:
        """Inject a frame of a stranger, to the clients only."""
        name = f"{int(order['identifier']):0{8 if order['extended'] else 3}X}"
        self._broadcast(f"< frame {name} {self._stamp()} {order['data']} >".encode(), None)

    def _set_bus_off(self, order: Order) -> None:
        """Set the controller bus-off, and again after each restart as long as this lasts."""
        self._bus_off = bool(order["on"])
        if self._bus_off:
            self._send_error(BUS_OFF)

    def _set_half_open(self, order: Order) -> None:
        """Cut the gateway's power; its connections remain; when it is back it knows none of them."""
        if self._half_open == bool(order["on"]):
            return
        if not self._half_open:
            for client in self._clients.values():
                self._everything.unregister(client.socket)
                self._arrivals.unregister(client.socket)
            self._everything.unregister(self._listener)
            self._half_open = True
            return
        self._drop_clients(order)
        self._half_open = False
        self._everything.register(self._listener, selectors.EVENT_READ, self._accept)

    def _set_slow(self, order: Order) -> None:
        self._slow = float(order["seconds"]) / 2

    def _set_jitter(self, order: Order) -> None:
        self._jitter = float(order["seconds"])

    def _jump(self, order: Order) -> None:
        self._clock_jump = float(order["seconds"])


def _is_sync(words: list[bytes]) -> bool:
    return words[:1] == [b"send"] and (frame := _parse(words)) is not None and frame[:2] == (SYNC_ID, False)


def _parse(words: list[bytes]) -> tuple[int, bool, bytes] | None:
    try:
        identifier, length = int(words[1], 16), int(words[2], 16)
        data = bytes(int(word, 16) for word in words[3:])
    except (IndexError, ValueError):
        return None
    extended = len(words[1]) > 3
    if len(data) != length or length > 8 or identifier > (0x1FFFFFFF if extended else 0x7FF):
        return None
    return identifier, extended, data


def main() -> None:
    """Run the hub's process."""
    orders = Orders()
    configuration: dict[str, Any] = orders.configuration()
    ends = [backplane.adopt(configuration[name]) for name in ("plant", "nodes", "modbus")]
    hub = Hub(configuration["channel"], *ends)
    report({"ready": {"port": hub.port}})
    hub.run(orders)


if __name__ == "__main__":
    main()
