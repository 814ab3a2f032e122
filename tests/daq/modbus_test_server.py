"""A Modbus TCP server for tests that can misbehave; written from the specification, shares no code with pymodbus."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from dataclasses import dataclass, field

READ_IDENTITY = bytes((0x2B, 0x0E, 1, 0))  # all basic objects, from the first one


@dataclass
class FakeModbus:
    """Units with holding registers; ``silent`` ones do not answer, ``exceptions`` maps a unit to its exception code."""

    units: dict[int, dict[int, int]]
    silent: set[int] = field(default_factory=set)
    exceptions: dict[int, int] = field(default_factory=dict)
    short: set[int] = field(default_factory=set)  # units that answer with one register less
    delay_s: float = 0.0  # before every answer
    function: int | None = None  # instead of the one that was asked for
    one_at_a_time: bool = False  # refuses a second connection
    gates: dict[int, threading.Semaphore] = field(default_factory=dict)  # of a unit: lets its answers through
    identities: dict[int, dict[int, bytes]] = field(default_factory=dict)  # by unit; the others know no function 43
    fixed_port: int = 0

    def __post_init__(self) -> None:
        self.requests: list[tuple[int, int, int, int]] = []  # unit, function, address, count
        self.asked_identity: list[int] = []  # units
        self.asked = threading.Condition()
        self.refused = 0
        self._socket = socket.create_server(("127.0.0.1", self.fixed_port))
        self.port = self._socket.getsockname()[1]
        self._connections: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def close(self) -> None:
        with contextlib.suppress(OSError):  # a test closed it already
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        for connection in self._connections:
            with contextlib.suppress(OSError):  # the client closed it first
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()
        for thread in self._threads:
            thread.join(5)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            if self.one_at_a_time and any(c.fileno() >= 0 for c in self._connections):
                connection.close()
                self.refused += 1
                continue
            self._connections.append(connection)
            thread = threading.Thread(target=self._serve, args=(connection,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        try:
            while header := connection.recv(7, socket.MSG_WAITALL):
                transaction, _, length, unit = struct.unpack(">HHHB", header)
                request = connection.recv(length - 1, socket.MSG_WAITALL)
                if request == READ_IDENTITY:
                    body = self._identity(unit)
                    if body is not None:
                        connection.sendall(struct.pack(">HHHB", transaction, 0, 1 + len(body), unit) + body)
                    continue
                function, address, count = struct.unpack(">BHH", request)
                with self.asked:
                    self.requests.append((unit, function, address, count))
                    self.asked.notify_all()
                body = self._answer(unit, function, address, count)
                time.sleep(self.delay_s)
                if unit in self.gates:
                    self.gates[unit].acquire()
                if body is not None:
                    connection.sendall(struct.pack(">HHHB", transaction, 0, 1 + len(body), unit) + body)
        except (OSError, struct.error):
            return
        finally:
            connection.close()

    def _identity(self, unit: int) -> bytes | None:
        """Application protocol V1.1b3, 6.21: conformity basic, nothing more to follow, then number, length, text."""
        self.asked_identity.append(unit)
        if unit in self.silent:
            return None
        if unit not in self.identities:
            return bytes((0x2B | 0x80, 1))  # illegal function
        objects = self.identities[unit]
        told = b"".join(bytes((number, len(text))) + text for number, text in objects.items())
        return READ_IDENTITY[:3] + bytes((1, 0, 0, len(objects))) + told

    def _answer(self, unit: int, function: int, address: int, count: int) -> bytes | None:
        if unit in self.silent:
            return None
        if unit in self.exceptions:
            return bytes((function | 0x80, self.exceptions[unit]))
        if unit not in self.units:
            return bytes((function | 0x80, 11))
        registers = self.units[unit]
        if any(address + i not in registers for i in range(count)):
            return bytes((function | 0x80, 2))
        words = [registers[address + i] for i in range(count)][: count - (unit in self.short)]
        return struct.pack(f">BB{len(words)}H", self.function or function, 2 * len(words), *words)


def float_registers(values: dict[int, float]) -> dict[int, int]:
    """Holding registers with float32 values, most significant word first."""
    registers = {}
    for address, value in values.items():
        registers[address], registers[address + 1] = struct.unpack(">HH", struct.pack(">f", value))
    return registers


def bench_registers() -> dict[int, dict[int, int]]:
    """Registers of the units of the bench machine: head 50 bar, angle 0.3 rad; rod 20.5 bar."""
    return {1: float_registers({2: 50.0, 4: 0.0, 6: 0.3}), 2: {4: 215}}
