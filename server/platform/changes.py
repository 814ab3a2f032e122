"""Wakes whoever waits for the store to change, from any thread into any event loop."""

from __future__ import annotations

import asyncio
import threading


class Changes:
    """A counter of changes that coroutines can wait on.

    A waiter passes the number that it has seen, so a change between its reading of the store and its waiting
    is never lost.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._number = 0
        self._closed = False
        self._waiters: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    @property
    def number(self) -> int:
        """Number of changes so far in this process."""
        with self._lock:
            return self._number

    @property
    def closed(self) -> bool:
        """True when the service is stopping: streams should end."""
        with self._lock:
            return self._closed

    def notify(self) -> None:
        """Count one change and wake everybody."""
        with self._lock:
            self._number += 1
            self._wake()

    def close(self) -> None:
        """Wake everybody for good."""
        with self._lock:
            self._closed = True
            self._wake()

    def _wake(self) -> None:
        waiters, self._waiters = self._waiters, set()
        for loop, event in waiters:
            # A loop that closed meanwhile has nobody left to wake.
            if not loop.is_closed():
                loop.call_soon_threadsafe(event.set)

    async def wait(self, seen: int, timeout: float) -> bool:
        """Wait until there was a change after number ``seen``.

        Returns
        -------
        False after ``timeout`` seconds without a change, else True (also when closed).
        """
        event = asyncio.Event()
        entry = (asyncio.get_running_loop(), event)
        with self._lock:
            if self._number != seen or self._closed:
                return True
            self._waiters.add(entry)
        try:
            await asyncio.wait_for(event.wait(), timeout)
        except TimeoutError:
            return False
        finally:
            with self._lock:
                self._waiters.discard(entry)
        return True
