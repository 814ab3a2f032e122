"""One client of the live stream: a short queue that a reader fills and the client's own task empties."""

from __future__ import annotations

import asyncio
import contextlib

#: Messages that a client may be behind, about three seconds; then it is dropped, and it connects again.
BEHIND = 32


class Client:
    """A client; made in its event loop, filled from any thread.

    Parameters
    ----------
    behind : messages that it may be behind
    """

    def __init__(self, behind: int = BEHIND) -> None:
        self._loop = asyncio.get_running_loop()
        self._messages: asyncio.Queue[str] = asyncio.Queue(behind)
        #: Set when the client is too slow, or the service stops: nothing more comes.
        self.dropped = asyncio.Event()

    def offer(self, message: str) -> None:
        """Queue a message, from any thread; never waits."""
        with contextlib.suppress(RuntimeError):  # its loop has ended: so has the client
            self._loop.call_soon_threadsafe(self._put, message)

    def drop(self) -> None:
        """Drop the client, from any thread."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self.dropped.set)

    def _put(self, message: str) -> None:
        try:
            self._messages.put_nowait(message)
        except asyncio.QueueFull:
            self.dropped.set()

    async def next(self) -> str:
        """Return the next message."""
        return await self._messages.get()
