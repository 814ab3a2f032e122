"""Idempotency keys: a request that came before makes nothing a second time."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from daq.messages import Sentence
from server.platform.database.schema import idempotency_keys
from server.platform.errors import ConflictError


@dataclass(frozen=True)
class IdempotencyKey:
    """What a client sent as ``Idempotency-Key``, and the hash of the request that came with it."""

    key: str
    request_sha256: str

    @classmethod
    def of(cls, key: str | None, *content: Any) -> IdempotencyKey | None:
        """Return a request's key with this content (anything that JSON can hold); None if none was sent."""
        if key is None:
            return None
        text = json.dumps(content, sort_keys=True)
        return cls(key, hashlib.sha256(text.encode()).hexdigest())

    def refuse_other(self, request_sha256: str) -> None:
        """Raise ConflictError if it came before with another request, of which this is the hash."""
        if request_sha256 != self.request_sha256:
            raise ConflictError(Sentence("server.idempotency_key_came_before"), "key_used")


def earlier(connection: sa.Connection, key: IdempotencyKey | None) -> str | None:
    """Return the id of what the same request made before; None if there was none.

    Raises
    ------
    ConflictError
        If the key came before with another request.
    """
    if key is None:
        return None
    row = connection.execute(sa.select(idempotency_keys).where(idempotency_keys.c.key == key.key)).first()
    if row is None:
        return None
    key.refuse_other(row.request_sha256)
    return str(row.subject)


def remember(connection: sa.Connection, key: IdempotencyKey | None, subject: str, now: str) -> None:
    """Note what a request made, in the transaction that makes it."""
    if key is not None:
        connection.execute(
            idempotency_keys.insert().values(
                key=key.key, request_sha256=key.request_sha256, subject=subject, created=now
            )
        )
