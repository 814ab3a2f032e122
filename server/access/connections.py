"""Open streams of paired devices and keys: who was here when, and streams that end with the token that opened them.

A stream is authorised when it is opened, and may then run for days. It is therefore kept here by its principal, and
ended when that is revoked or expires.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True)
class Presence:
    """Last request of a principal since the start of the service: moment (UTC) and place; and its open streams."""

    seen: str | None = None
    address: str | None = None
    streams: int = 0


class Stream:
    """One open stream; made in the task that serves it."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._task = asyncio.current_task()
        #: Whether it was ended from here; then its task is cancelled once.
        self.ended = False

    def end(self) -> None:
        """End it, from any thread."""
        self._loop.call_soon_threadsafe(self._end)

    def _end(self) -> None:
        if not self.ended and self._task is not None:
            self.ended = True
            self._task.cancel()

    def end_at(self, seconds: float) -> asyncio.TimerHandle:
        """End it after so many seconds."""
        return self._loop.call_later(max(0.0, seconds), self._end)


class Connections:
    """All principals' presence."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen: dict[str, tuple[str, str]] = {}
        self._streams: dict[str, list[Stream]] = {}
        self._gone: set[str] = set()

    def note(self, principal: str, now: str, address: str) -> None:
        """Note that a principal asked for something."""
        self._seen[principal] = now, address

    def of(self, principal: str) -> Presence:
        """Return what is known of a principal."""
        seen, address = self._seen.get(principal, (None, None))
        with self._lock:
            return Presence(seen, address, len(self._streams.get(principal, ())))

    @contextmanager
    def stream(self, principal: str, stream: Stream, now: str, expires: str | None) -> Iterator[None]:
        """Keep a stream while the block runs; it is ended when the principal is, or at ``expires``."""
        with self._lock:
            self._streams.setdefault(principal, []).append(stream)
            gone = principal in self._gone  # revoked between the look at its token and now
        if gone:
            stream.end()
        timer = None
        if expires is not None:
            left = datetime.fromisoformat(expires) - datetime.fromisoformat(now)
            timer = stream.end_at(left.total_seconds())
        try:
            yield
        finally:
            if timer is not None:
                timer.cancel()
            with self._lock:
                others = [other for other in self._streams[principal] if other is not stream]
                if others:
                    self._streams[principal] = others
                else:
                    del self._streams[principal]

    def end(self, principal: str) -> None:
        """End every stream of a principal that is no more; its id never comes again."""
        with self._lock:
            self._gone.add(principal)
            self._seen.pop(principal, None)
            streams = list(self._streams.get(principal, ()))
        for stream in streams:
            stream.end()
