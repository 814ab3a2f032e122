"""One POST to one address: the one that was looked at, whatever the name leads to meanwhile; no redirect, no proxy."""

from __future__ import annotations

import http.client
import socket
import ssl
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from server.platform.errors import StartError
from server.platform.receiver_places import Receiver

#: s that one try may take in all.
TIMEOUT_S = 10.0


class _Pinned(http.client.HTTPConnection):
    """A connection to an address in the place of its host's name."""

    def __init__(self, to: Receiver, address: str, tls: ssl.SSLContext | None, timeout_s: float) -> None:
        super().__init__(to.host, to.port, timeout=timeout_s)
        self._address = address
        self._tls = tls

    def connect(self) -> None:
        """Connect."""
        self.sock = socket.create_connection((self._address, self.port), self.timeout)
        if self._tls is not None:
            self.sock = self._tls.wrap_socket(self.sock, server_hostname=self.host)

    def cut(self) -> None:
        """End it from another thread."""
        with suppress(OSError, AttributeError):
            self.sock.shutdown(socket.SHUT_RDWR)


def receivers_tls(authorities: Path | None) -> ssl.SSLContext:
    """Load whom receivers are trusted by: ``authorities`` (PEM), or this computer's; StartError if unreadable."""
    try:
        return ssl.create_default_context(cafile=None if authorities is None else str(authorities))
    except OSError as error:
        raise StartError(
            "server.certificates_not_pem", authorities=authorities, reason=error.strerror or error
        ) from None


def post(
    to: Receiver,
    address: str,
    body: bytes,
    headers: Mapping[str, str],
    tls: ssl.SSLContext,
    timeout_s: float = TIMEOUT_S,
) -> int:
    """Post it; return the status of the answer, whose body is not read.

    Raises
    ------
    OSError, http.client.HTTPException
        If there is none within ``timeout_s``.
    """
    connection = _Pinned(to, address, tls if to.scheme == "https" else None, timeout_s)
    end = threading.Timer(timeout_s, connection.cut)  # a receiver that drips would pass every single timeout
    end.daemon = True
    end.start()
    try:
        all_headers = {"Content-Type": "application/json", "User-Agent": "hilfit", "Connection": "close", **headers}
        connection.request("POST", to.target, body, all_headers)
        return connection.getresponse().status
    finally:
        end.cancel()
        connection.close()
