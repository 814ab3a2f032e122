"""Answers that are given again when a request comes again: secrets, which the store does not have.

What makes lasting work keeps its ``Idempotency-Key`` in the store (:mod:`server.platform.database.idempotency`). The
secret of an API key or a pairing code is stored only as a hash, so the answer that shows it is kept here, for as long
as a pairing code lives: long enough for a client on a bad link to ask again, and gone with the process.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from server.platform.database.idempotency import IdempotencyKey

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
