"""Idempotency keys: a request that came before makes nothing a second time.

What makes lasting work keeps its ``Idempotency-Key`` in the store. The secret of an API key or a pairing code is stored
only as a hash, so the answer that shows it is kept in memory (:class:`Replays`), for as long as a pairing code lives:
long enough for a client on a bad link to ask again, and gone with the process.
"""

from __future__ import annotations

import hashlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import sqlalchemy as sa

from server.platform.database.schema import idempotency_keys
from server.platform.errors import ConflictError


@dataclass(frozen=True)
class IdempotencyKey:
    """A client's ``Idempotency-Key``, and the hash of the request that came with it."""

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
            raise ConflictError("server.idempotency_key_came_before").about("key_used")


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


LIFETIME_S = 900.0
#: Most answers that are kept; the oldest goes first.
MOST = 200
Value = TypeVar("Value")


class Replays:
    """Answers of the last quarter of an hour, by who asked and with which key.

    Parameters
    ----------
    clock : s, monotonic
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._kept: dict[tuple[str, str, str], tuple[float, str, Any]] = {}

    def once(self, who: str, what: str, key: str | None, content: Any, make: Callable[[], Value]) -> Value:
        """Return what ``make`` returns; if ``who`` sent ``key`` for ``what`` before, what it returned then.

        Parameters
        ----------
        content : of the request, anything that JSON can hold

        Raises
        ------
        ConflictError
            If the key came before with another content.
        """
        sent = IdempotencyKey.of(key, content)
        if sent is None:
            return make()
        with self._lock:  # the second of two that come at once waits for the first
            now = self._clock()
            self._kept = {name: entry for name, entry in self._kept.items() if now - entry[0] < LIFETIME_S}
            known = self._kept.get((who, what, sent.key))
            if known is not None:
                sent.refuse_other(known[1])
                return known[2]  # type: ignore[no-any-return]
            value = make()
            self._kept[who, what, sent.key] = now, sent.request_sha256, value
            if len(self._kept) > MOST:
                del self._kept[next(iter(self._kept))]
            return value
