"""A minimal CANopen sensor for tests: boot-up, NMT states, heartbeat, expedited SDO, TPDOs on SYNC, EMCY, and faults.

It is written from CiA 301 and shares no code with the driver. It lives in a thread, on python-can's virtual bus
where no other interface is named.
"""

from __future__ import annotations

import queue
import struct
import threading
import time
from collections import deque
from dataclasses import dataclass, field

import can

OPERATIONAL, PRE_OPERATIONAL, STOPPED = 0x05, 0x7F, 0x04


def defaults(node: int) -> dict[tuple[int, int], bytes]:
    """Communication profile of a sensor with four TPDOs, the first two of them on and event-driven."""
    objects = {
        (0x1000, 0): struct.pack("<I", 0x0008_0194),
        (0x1001, 0): b"\0",
        (0x1017, 0): struct.pack("<H", 0),
        (0x1018, 1): struct.pack("<I", 0x2A),
        (0x1018, 2): struct.pack("<I", 0x07),
    }
    for pdo in range(4):
        off = 0 if pdo < 2 else 0x8000_0000
        objects[0x1800 + pdo, 1] = struct.pack("<I", off | 0x180 + 0x100 * pdo + node)
        objects[0x1800 + pdo, 2] = b"\xff"
        objects[0x1A00 + pdo, 0] = b"\0"
        for entry in range(1, 9):
            objects[0x1A00 + pdo, entry] = struct.pack("<I", 0)
    return objects


@dataclass
class FakeNode:
    """A node whose ``values`` (object to bytes) a test sets; ``log`` holds every SDO write in order."""

    channel: str
    node: int
    values: dict[tuple[int, int], bytes]
    interface: str = "virtual"
    silent: bool = False  # on the bus, but sends nothing at all
    truncate: int = 0  # bytes cut off every TPDO
    frozen: dict[tuple[int, int], bytes] = field(default_factory=dict)  # objects that keep their value
    refused: set[tuple[int, int]] = field(default_factory=set)
    boots_by_itself: bool = True
    holding: bool = False  # keeps its TPDOs back until they are let go one by one
    lag: int = 0  # SYNCs by which its TPDOs come too late
    lose: int = 0  # TPDOs that get lost
    heartbeats: bool = True
    numbered: tuple[int, int] | None = None  # an object that counts the SYNCs, as uint32
    babble: bytes | None = None  # instead of every SDO answer

    def __post_init__(self) -> None:
        self.log: list[tuple[int, int, bytes]] = []
        self.commands: list[int] = []
        self.syncs = 0
        self.held: queue.Queue[tuple[int, bytes]] = queue.Queue()
        self.delayed: deque[tuple[int, int, bytes]] = deque()  # to be sent at which SYNC
        self.state = PRE_OPERATIONAL
        self.operational = threading.Event()
        self.bus = can.Bus(interface=self.interface, channel=self.channel)
        self._reset()
        self._next_heartbeat = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        if self.boots_by_itself:
            self.boot()

    def _reset(self) -> None:
        self.objects = {**defaults(self.node), **self.values}
        self.state = PRE_OPERATIONAL
        self.operational.clear()

    def set(self, index: int, subindex: int, data: bytes) -> None:
        """Change a measured value."""
        self.objects[index, subindex] = data

    def boot(self) -> None:
        """Lose the mapping and say so, as after a power cut."""
        self._reset()
        self._send(0x700 + self.node, b"\0")

    def emergency(self, code: int) -> None:
        """Send EMCY."""
        self._send(0x080 + self.node, struct.pack("<HB5x", code, 1 if code else 0))

    def let_go(self) -> None:
        """Send the TPDO that was held back first."""
        self._send(*self.held.get(timeout=10))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.bus.shutdown()

    def _send(self, cob_id: int, data: bytes) -> None:
        if not self.silent:
            self.bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._once()
            except can.CanOperationError:  # the interface is down: a node waits until it is up again
                time.sleep(0.01)

    def _once(self) -> None:
        message = self.bus.recv(0.01)
        period = struct.unpack("<H", self.objects[0x1017, 0])[0] / 1000
        if period and time.monotonic() >= self._next_heartbeat:
            self._next_heartbeat = time.monotonic() + period
            if self.heartbeats:
                self._send(0x700 + self.node, bytes((self.state,)))
        if message is not None and not message.is_error_frame:
            self._handle(message.arbitration_id, bytes(message.data))

    def _handle(self, cob_id: int, data: bytes) -> None:
        if cob_id == 0 and len(data) == 2 and data[1] in (0, self.node):
            self.commands.append(data[0])
            self.state = {1: OPERATIONAL, 2: STOPPED, 0x80: PRE_OPERATIONAL}[data[0]]
            (self.operational.set if self.state == OPERATIONAL else self.operational.clear)()
        elif cob_id == 0x80:
            self.syncs += 1
            if self.numbered is not None:
                self.objects[self.numbered] = struct.pack("<I", self.syncs)
            if self.state == OPERATIONAL:
                self._send_tpdos()
            while self.delayed and (self.delayed[0][0] <= self.syncs or not self.lag):
                _, *frame = self.delayed.popleft()
                if self.lose:
                    self.lose -= 1
                else:
                    self._send(*frame)
        elif cob_id == 0x600 + self.node and len(data) == 8 and self.state != STOPPED:
            self._sdo(data)

    def _send_tpdos(self) -> None:
        for pdo in range(4):
            cob_id = struct.unpack("<I", self.objects[0x1800 + pdo, 1])[0]
            if cob_id & 0x8000_0000 or self.objects[0x1800 + pdo, 2] != b"\x01":
                continue
            data = b""
            for entry in range(1, self.objects[0x1A00 + pdo, 0][0] + 1):
                place = struct.unpack("<I", self.objects[0x1A00 + pdo, entry])[0]
                data += self.objects[place >> 16, place >> 8 & 0xFF]
            frame = (cob_id & 0x7FF, data[: len(data) - self.truncate])
            if self.holding:
                self.held.put(frame)
                continue
            self.delayed.append((self.syncs + self.lag, *frame))

    def _sdo(self, data: bytes) -> None:
        command, index, subindex = struct.unpack_from("<BHB", data)
        key = (index, subindex)
        if command == 0x80:
            return
        if key not in self.objects or key in self.refused:
            answer = struct.pack("<BHBI", 0x80, index, subindex, 0x0602_0000)
        elif command == 0x40:
            value = self.objects[key]
            answer = struct.pack("<BHB", 0x43 | (4 - len(value)) << 2, index, subindex) + value.ljust(4, b"\0")
        else:
            value = data[4 : 8 - (command >> 2 & 3)]
            self.log.append((index, subindex, value))
            if key not in self.frozen:
                self.objects[key] = value
            answer = struct.pack("<BHBI", 0x60, index, subindex, 0)
        if self.babble is not None:
            answer = self.babble
        self._send(0x580 + self.node, answer)
