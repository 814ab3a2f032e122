"""A Modbus RTU slave for tests on a pseudo-terminal; the CRC is computed bit by bit, as the specification draws it."""

from __future__ import annotations

import os
import pty
import select
import struct
import threading
import tty
from dataclasses import dataclass, field


def crc(data: bytes) -> bytes:
    """CRC-16 of Modbus over serial line V1.02, 6.2.2."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return struct.pack("<H", value)


@dataclass
class FakeSerialModbus:
    """Units with holding registers on one line."""

    units: dict[int, dict[int, int]]
    silent: set[int] = field(default_factory=set)
    hold: int = 0  # answers that are kept back: each is sent when the next request comes, before its own answer

    def __post_init__(self) -> None:
        self._master, self._slave = pty.openpty()  # the slave side stays open: a reader never sees the line end
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self.requests: list[int] = []
        self.held: list[bytes] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def _run(self) -> None:
        buffer = b""
        while not self._stop.is_set():
            if not select.select([self._master], [], [], 0.02)[0]:
                buffer = b""  # silence on the line ends a frame
                continue
            buffer += os.read(self._master, 256)
            while len(buffer) >= 8:
                request, buffer = buffer[:8], buffer[8:]
                self._answer(request)

    def _answer(self, request: bytes) -> None:
        unit, function, address, count = struct.unpack_from(">BBHH", request)
        self.requests.append(unit)
        if crc(request[:6]) != request[6:] or unit in self.silent or unit not in self.units:
            return
        if all(address + i in self.units[unit] for i in range(count)):
            words = [self.units[unit][address + i] for i in range(count)]
            body = struct.pack(f">BBB{count}H", unit, function, 2 * count, *words)
        else:
            body = bytes((unit, function | 0x80, 2))
        self.let_go()
        if self.hold:
            self.hold -= 1
            self.held.append(body + crc(body))
        else:
            os.write(self._master, body + crc(body))

    def let_go(self) -> None:
        """Send what is kept back."""
        while self.held:
            os.write(self._master, self.held.pop(0))
