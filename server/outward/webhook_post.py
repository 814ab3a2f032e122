"""One signed POST to one address: the one that was looked at, whatever the name leads to meanwhile.

There is no redirect and no proxy. Signatures have the form of Standard Webhooks (standardwebhooks.com)::

    webhook-id: msg-...                      the same at each try
    webhook-timestamp: 1767225600            s since 1970, of this try
    webhook-signature: v1,BASE64             HMAC-SHA256 over "ID.TIMESTAMP.BODY"

A secret is not stored: it is made of the site's key, a file beside the store that no backup holds, and the id of its
webhook. A store that was copied, or restored elsewhere, lets nobody sign.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import http.client
import secrets
import socket
import ssl
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from daq.whole_files import write_whole
from server.platform.errors import StartError
from server.platform.receiver_places import Receiver

PREFIX = "whsec_"


class WebhookSecrets:
    """The secrets of a site.

    Parameters
    ----------
    path : file of the site's key; made when it is first needed
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def secret(self, webhook: str) -> bytes:
        """Return the secret of a webhook, 32 bytes."""
        if not self._path.exists():
            write_whole(self._path, secrets.token_bytes(32))
            self._path.chmod(0o600)
        return hmac.digest(self._path.read_bytes(), f"hilfit webhook {webhook}".encode(), "sha256")


def shown(secret: bytes) -> str:
    """Return a secret in its receiver's form."""
    return PREFIX + base64.b64encode(secret).decode()


def fingerprint(secret: bytes) -> str:
    """Return what distinguishes one secret from another, and nothing else of it."""
    return hashlib.sha256(secret).hexdigest()


def headers(secret: bytes, message: str, timestamp: int, body: bytes) -> dict[str, str]:
    """Build the headers of a try at ``timestamp`` (s since 1970)."""
    signed = b".".join([message.encode(), str(timestamp).encode(), body])
    signature = base64.b64encode(hmac.digest(secret, signed, "sha256")).decode()
    return {
        "webhook-id": message,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": f"v1,{signature}",
    }


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
