"""Revision counters for everybody who follows them: one read of the store for all."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import KW_ONLY, dataclass

from server.platform.changes import Changes

#: Seconds after which the store is read though nobody here changed it: a worker on another host may have.
POLL_S = 2.0
#: Seconds between two signs of life.
HEARTBEAT_S = 10.0
Reader = Callable[[], Awaitable[Mapping[str, int]]]


@dataclass(eq=False)
class Revisions:
    """The newest revision counters.

    Attributes
    ----------
    changes : what wakes those who wait
    read : reads the counters from the store
    own : the counters that this process wrote last; then the store need not be read for its own writes
    """

    changes: Changes
    read: Reader
    _: KW_ONLY
    clock: Callable[[], float] = time.monotonic
    poll_s: float = POLL_S
    heartbeat_s: float = HEARTBEAT_S
    own: Callable[[], Mapping[str, int]] | None = None

    def __post_init__(self) -> None:
        self._lock = asyncio.Lock()
        self._seen = -1
        self._until = -1.0
        self._counters: Mapping[str, int] = {}

    async def current(self) -> Mapping[str, int]:
        """Return the counters: new as every write of this process, within ``poll_s`` for those of others."""
        # While somebody reads, nobody else waits for the store: a writer may hold it for as long as a disk takes.
        if self.own is None or not self._counters or not self._lock.locked():
            await self._refresh()
        own = {} if self.own is None else self.own()
        if any(number > self._counters.get(name, 0) for name, number in own.items()):
            self._counters = {**self._counters, **own}
        return self._counters

    async def _refresh(self) -> None:
        """Read the store if what is known of it may be too old."""
        async with self._lock:
            number = self.changes.number
            notified = self.own is None and number != self._seen
            if notified or self.clock() >= self._until:
                self._counters = await self.read()
                self._seen, self._until = number, self.clock() + self.poll_s

    async def follow(self) -> AsyncIterator[tuple[str, int] | None]:
        """Yield every counter as it is, then each whenever it moves; None now and then, as a sign of life.

        Ends when the service stops.
        """
        known: dict[str, int] = {}
        spoke = self.clock()
        while not self.changes.closed:
            number = self.changes.number
            for resource, revision in (await self.current()).items():
                if known.get(resource) != revision:
                    known[resource] = revision
                    spoke = self.clock()
                    yield resource, revision
            if self.clock() - spoke >= self.heartbeat_s:
                spoke = self.clock()
                yield None
            await self.changes.wait(number, self.poll_s)
