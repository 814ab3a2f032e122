"""Work that takes long or much, kept apart from the threads that answer reads, and bounded.

Every request that reads a file from outside, writes one in another form, or hashes much has to have a *place* before
anything of it begins. Places are few, and one principal gets only a share of them: who asks beyond that is told to come
again (429), and so is everybody when all are taken (503), instead of piling up processes and memory. The work itself
runs in *slots*, threads of its own; each starts at most one process at a time.
"""

from __future__ import annotations

import asyncio
import os
from collections import Counter
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import partial
from typing import Any, TypeVar

from server.platform.errors import BusyError, TooManyError

#: Processes that read or write files at once: a core is left to acquisition and HTTP.
SLOTS = max(1, min(4, (os.cpu_count() or 1) - 1))
#: Requests that wait or are being received, of all and of one principal.
PLACES, SHARE = 32, 16
#: Threads that write what is received, and that wait for something to end.
ASIDE = 8
Value = TypeVar("Value")


class Place:
    """A place of one request, to run its work in."""

    def __init__(self, slots: ThreadPoolExecutor, aside: ThreadPoolExecutor) -> None:
        self._slots = slots
        self._aside = aside

    async def run(self, function: Callable[..., Value], *arguments: Any) -> Value:
        """Run heavy work when a slot is free."""
        return await _within(self._slots, function, arguments)

    async def io(self, function: Callable[..., Value], *arguments: Any) -> Value:
        """Run what waits for a disk."""
        return await _within(self._aside, function, arguments)


class Heavy:
    """Places and slots.

    Parameters
    ----------
    slots : pieces of work at once
    places : requests at once, those that wait included
    share : of one principal
    """

    def __init__(self, slots: int = SLOTS, places: int = PLACES, share: int = SHARE) -> None:
        self._slots = ThreadPoolExecutor(slots, "heavy")
        self._aside = ThreadPoolExecutor(ASIDE, "aside")
        self._places = places
        self._share = share
        self._taken: Counter[str] = Counter()

    @asynccontextmanager
    async def place(self, who: str) -> AsyncIterator[Place]:
        """Have a place while the block runs.

        Parameters
        ----------
        who : id of the principal

        Raises
        ------
        TooManyError
            If ``who`` has its share already.
        BusyError
            If all places are taken.
        """
        if self._taken[who] >= self._share:
            raise TooManyError("server.your_requests_kind_under", share=self._share)
        if self._taken.total() >= self._places:
            raise BusyError("server.service_busy_files_others")
        self._taken[who] += 1
        try:
            yield Place(self._slots, self._aside)
        finally:
            self._taken[who] -= 1
            if not self._taken[who]:
                del self._taken[who]

    async def run(self, who: str, function: Callable[..., Value], *arguments: Any) -> Value:
        """Run heavy work in a place of its own; see :meth:`place`."""
        async with self.place(who) as place:
            return await place.run(function, *arguments)

    async def aside(self, function: Callable[..., Value], *arguments: Any) -> Value:
        """Run what takes nothing but waits for something, as a file that is being sealed."""
        return await _within(self._aside, function, arguments)

    def close(self) -> None:
        """Take nothing more; what runs is waited for."""
        self._slots.shutdown(cancel_futures=True)
        self._aside.shutdown(cancel_futures=True)


async def _within(executor: ThreadPoolExecutor, function: Callable[..., Value], arguments: tuple[Any, ...]) -> Value:
    """Run a function in an executor to its end, also if whoever asked has gone: its place is not free before."""
    future = asyncio.get_running_loop().run_in_executor(executor, partial(function, *arguments))
    try:
        return await asyncio.shield(future)
    except asyncio.CancelledError:
        await asyncio.wait([future])
        raise
