"""What a simulated Modbus unit's answers travel on: TCP connections, or a serial line that is a pseudo-terminal.

Faults of the wire are here: answers that trickle, that are garbled, connections that are only half there. pymodbus
makes and reads the frames on both.
"""

from __future__ import annotations

import asyncio
import os
import pty
import tty
from collections.abc import Callable, Sequence
from typing import Any

from pymodbus.framer import FramerType
from pymodbus.pdu.device import ModbusDeviceIdentification
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import SimDevice

BITS = 11  # of a character on the line: start, eight, parity or second stop bit, stop
PIECES = 4  # that an answer comes in when it trickles
#: What units say they are; pymodbus keeps one for a process.
IDENTITY = {"VendorName": "hilfit", "ProductCode": "HF-MB4 transmitter", "MajorMinorRevision": "1.0"}
Garble = Callable[[int], bool]  # whether the next answer of a unit is garbled


class Wire(ModbusTcpServer):
    """A Modbus TCP server whose answers can go wrong on their way.

    Parameters
    ----------
    devices : what it serves
    garble : asked before each answer
    """

    def __init__(self, devices: Sequence[SimDevice], garble: Garble, framer: FramerType = FramerType.SOCKET) -> None:
        super().__init__(
            list(devices), address=("127.0.0.1", 0), ignore_missing_devices=True, framer=framer,
            identity=ModbusDeviceIdentification(info_name=IDENTITY),  # type: ignore[no-untyped-call]
        )  # fmt: skip
        self._garble = garble
        self._serial = framer is FramerType.RTU
        self.slow = 0.0  # s that an answer takes from its first to its last byte
        self.half_open = False

    def callback_new_connection(self) -> Any:
        """Return the handler of a connection, which sends through :meth:`_send`."""
        handler: Any = super().callback_new_connection()  # type: ignore[no-untyped-call]
        send = handler.low_level_send
        handler.low_level_send = lambda data, addr=None: self._send(send, data)
        return handler

    def _send(self, send: Callable[[bytes], None], data: bytes) -> None:
        if self.half_open:
            return
        if self._garble(data[0 if self._serial else 6]):
            # On a serial line a bit of the check sum; over TCP, which has a check sum of its own, the gateway's header.
            at = len(data) - 1 if self._serial else 0
            data = data[:at] + bytes([data[at] ^ 0x40]) + data[at + 1 :]
        if not self.slow:
            send(data)
            return
        size = -(-len(data) // PIECES)
        for piece in range(PIECES):
            part = data[piece * size : (piece + 1) * size]
            if part:
                self.loop.call_later(self.slow * piece / (PIECES - 1), send, part)

    def set_half_open(self, on: bool) -> None:
        """Cut the gateway's power; its connections remain; when it is back it knows none of them."""
        self.half_open = on
        if not on:
            for handler in list(self.active_connections.values()):
                transport: Any = handler.transport
                if transport is not None:
                    transport.abort()


class SerialLine:
    """Units on a pseudo-terminal; a pty ignores the baud rate, so answers are held back for as long as they would take.

    Attributes
    ----------
    port : path that a client opens
    """

    def __init__(self, wire: Wire, baudrate: int) -> None:
        self._master, self._slave = pty.openpty()  # the slave side stays open: a reader never sees the line end
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._seconds_per_byte = BITS / baudrate
        self._loop = asyncio.get_running_loop()
        self._sent = 0.0  # loop time at which the last byte of what was written has left
        self._handler = wire.callback_new_connection()
        self._handler.connection_made(self)
        self._loop.add_reader(self._master, self._read)

    def _read(self) -> None:
        try:
            data = os.read(self._master, 512)
        except OSError:
            return
        self._handler.data_received(data)

    def write(self, data: bytes) -> None:
        """Write like an asyncio transport; called by pymodbus with an answer. What is written later leaves later."""
        self._sent = max(self._loop.time(), self._sent) + self._seconds_per_byte * len(data)
        self._loop.call_at(self._sent, self._put, data)

    def _put(self, data: bytes) -> None:
        try:
            os.write(self._master, data)
        except BlockingIOError:  # nobody reads, and the line has no buffer
            return

    def close(self) -> None:
        """Close like an asyncio transport."""
        self._loop.remove_reader(self._master)
        os.close(self._master)
        os.close(self._slave)
