"""Secrets and signatures of webhooks, in the form of Standard Webhooks (standardwebhooks.com).

::

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
import secrets
from pathlib import Path

from daq.whole_files import write_whole

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
