"""A minimal socketcand server for tests: raw mode, one client at a time, bridged to a virtual bus, or to the kernel's.

The protocol is that of the socketcand project's documentation: ``< hi >``, ``< open bus >``, ``< rawmode >``,
``< send id length bytes >``, ``< frame id seconds bytes >``.
"""

from __future__ import annotations

import contextlib
import re
import socket
import threading

import can


class TestHub:
    """Listens on a port of the loopback interface; ``drop`` cuts the client off, ``close`` stops listening too."""

    __test__ = False  # not a test, whatever its name begins with

    def __init__(self, channel: str, port: int = 0, interface: str = "virtual") -> None:
        self._server = socket.create_server(("127.0.0.1", port))
        self.port = self._server.getsockname()[1]
        self.clients = 0
        self._bus = can.Bus(interface=interface, channel=channel)
        self._client: socket.socket | None = None
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._accept, self._to_client)]
        for thread in self._threads:
            thread.start()

    def drop(self) -> None:
        """Cut the client off."""
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._stop.set()
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self.drop()
        for thread in self._threads:
            thread.join(5)
        self._bus.shutdown()

    def _accept(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            with client, contextlib.suppress(OSError):
                self._serve(client)
            self._client = None

    def _serve(self, client: socket.socket) -> None:
        client.sendall(b"< hi >")
        text = ""
        while data := client.recv(4096):
            text += data.decode("ascii")
            while (end := text.find(">")) >= 0:
                command, text = text[: end + 1], text[end + 1 :]
                if re.match(r"< (open \w+|rawmode) >", command.strip()):
                    client.sendall(b"< ok >")
                    if "rawmode" in command:
                        self.clients += 1
                        self._client = client
                else:
                    _, kind, cob_id, _, *values, _ = command.split()
                    assert kind == "send"
                    data_bytes = bytes(int(value, 16) for value in values)
                    self._bus.send(can.Message(arbitration_id=int(cob_id, 16), data=data_bytes, is_extended_id=False))

    def _to_client(self) -> None:
        while not self._stop.is_set():
            message = self._bus.recv(0.05)
            client = self._client
            if message is not None and client is not None:
                line = f"< frame {message.arbitration_id:03X} {message.timestamp:.6f} {bytes(message.data).hex()} >"
                with contextlib.suppress(OSError):
                    # In two parts, as TCP may deliver it.
                    client.sendall(line[:10].encode())
                    client.sendall(line[10:].encode())
