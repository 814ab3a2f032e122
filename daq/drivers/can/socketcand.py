"""A client of socketcand's raw mode (its ``doc/protocol.md``), which takes all frames that came at once::

    server  < hi >             < ok >         < ok >          < frame 181 23.424242 11223344 >   < error ... >
    client        < open can0 >      < rawmode >    < send 123 2 11 22 >

python-can's own looks for each frame alone, in text that it copies every time: at 1000 frames a second a hundredth of a
core. It takes a gateway that went away for one that says nothing, and a frame behind the last word of the handshake
for a wrong answer (`docs/decisions/0080`).
"""

from __future__ import annotations

import re
import select
import socket
import time
from collections import deque

import can

from daq.messages import Sentence

HANDSHAKE_S = 2.0
_MESSAGE = re.compile(rb"< ?(frame|error) ([0-9A-Fa-f]{1,8}) (\d+\.\d+) ((?:[0-9A-Fa-f]{2} ?)*) *>")
_LONGEST = 4096  # bytes of a message that does not end


class SocketcandBus(can.BusABC):  # type: ignore[misc]  # python-can gives it as Any
    """A bus behind a gateway.

    Raises
    ------
    OSError
        If nothing listens there, or it does not speak the protocol.
    """

    def __init__(self, channel: str, host: str, port: int, tcp_tune: bool = True) -> None:
        self._messages: deque[can.Message] = deque()
        self._rest = b""
        self._tuned = tcp_tune  # neither its algorithm nor ours may let small packets wait for others
        self._socket = socket.create_connection((host, port), HANDSHAKE_S)
        try:
            if tcp_tune:
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # One that lost its power closes nothing: asked twice, a second apart.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT):
                self._socket.setsockopt(socket.IPPROTO_TCP, option, 1)
            self._expect(b"< hi >")
            for command in (f"< open {channel} >", "< rawmode >"):
                self._socket.sendall(command.encode())
                self._expect(b"< ok >")
            self._socket.settimeout(None)
        except (OSError, can.CanError):
            self._socket.close()
            raise
        self._take()
        super().__init__(channel)

    def _expect(self, answer: bytes) -> None:
        until = time.monotonic() + HANDSHAKE_S
        while answer not in self._rest:
            if time.monotonic() > until or len(self._rest) > _LONGEST:
                raise OSError(
                    Sentence("daq.answers_no_socketcand_server", answer=self._rest[:40].decode("ascii", "replace"))
                )
            self._fill()
        self._rest = self._rest.partition(answer)[2]

    def _fill(self) -> None:
        data = self._socket.recv(1 << 16)
        if not data:
            raise can.CanOperationError("the gateway closed the connection")
        if self._tuned:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        self._rest += data

    def _take(self) -> None:
        """Take frames that are whole."""
        whole, end, self._rest = self._rest.rpartition(b">")
        self._messages.extend(_message(*found) for found in _MESSAGE.findall(whole + end))
        if len(self._rest) > _LONGEST:
            raise can.CanOperationError("the gateway sends no frames of socketcand's")

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Receive the next frame; None if none comes within ``timeout`` s.

        Raises
        ------
        can.CanOperationError
            If the gateway is gone.
        """
        while not self._messages and select.select([self._socket], [], [], timeout)[0]:  # it may be a part of a frame
            try:
                self._fill()
            except OSError as error:
                raise can.CanOperationError(str(error)) from error
            self._take()
        return self._messages.popleft() if self._messages else None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame."""
        identifier = f"{msg.arbitration_id:08X}" if msg.is_extended_id else f"{msg.arbitration_id:03X}"
        self._socket.sendall(f"< send {identifier} {msg.dlc:X} {msg.data.hex(' ')} >".encode())

    def shutdown(self) -> None:
        """Close the connection."""
        super().shutdown()
        self._socket.close()


def _message(kind: bytes, identifier: bytes, stamp: bytes, data: bytes) -> can.Message:
    number, extended = int(identifier, 16), len(identifier) > 3
    if kind == b"error":  # socketcand sends no details of it
        return can.Message(float(stamp), number & 0x1FFF_FFFF, True, is_error_frame=True, data=bytes(1))
    return can.Message(float(stamp), number, extended, data=bytearray.fromhex(data.decode()))
