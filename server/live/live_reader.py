"""From a machine's ring buffer to all clients that look at it: one thread, one encoding, no waiting for anybody."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import structlog

from daq.acquisition.ring import RingReader
from daq.arrays import RowArray
from daq.errors import AcquisitionError
from server.live import live_messages as messages
from server.machines.acquisition import Acquisition
from server.platform.errors import ServiceError

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


#: Seconds between two messages with samples, and between two heartbeats.
PERIOD_S, HEARTBEAT_S = 0.1, 2.0
_log = structlog.stdlib.get_logger(__name__)


class _Stream:
    """State of one machine's thread: the clients, the ring that it reads, the sequence number."""

    def __init__(self, machine: str, source: Acquisition, clock: Callable[[], float]) -> None:
        self._machine = machine
        self._source = source
        self._clock = clock
        self._lock = threading.Lock()
        self._new: list[Client] = []
        self._clients: list[Client] = []
        self._seq = 0
        self._ring: RingReader | None = None
        self._channels: messages.Channels | None = None
        self._next_heartbeat = clock() + HEARTBEAT_S

    def add(self, client: Client) -> None:
        """Send ``client`` a snapshot at the next step, then everything."""
        with self._lock:
            self._new.append(client)

    def remove(self, client: Client) -> int:
        """Forget ``client``; how many are left."""
        with self._lock:
            self._new = [other for other in self._new if other is not client]
            self._clients = [other for other in self._clients if other is not client]
            return len(self._new) + len(self._clients)

    def drop_all(self) -> None:
        """Drop all, as the service stops."""
        with self._lock:
            for client in self._new + self._clients:
                client.drop()

    def step(self) -> None:
        """Send what came since the last step."""
        ring, changed = self._attach()
        if changed:
            self._send(lambda seq: messages.snapshot(seq, self._state(), self._channels, self._newest()))
        elif ring is not None and self._channels is not None:
            read = ring.read()
            if len(read.rows):
                channels = self._channels
                self._send(lambda seq: messages.frames(seq, channels, read.rows, read.missed))
        self._welcome()
        now = self._clock()
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_S
            self._send(lambda seq: messages.heartbeat(seq, self._state()))

    def close(self) -> None:
        """Release the ring."""
        if self._ring is not None:
            self._ring.close()
            self._ring = None

    def _attach(self) -> tuple[RingReader | None, bool]:
        """Attach to the ring of the acquisition that runs now; return whether it is another one than before."""
        try:
            machine, feed = self._source.feed(self._machine)
        except (ServiceError, AcquisitionError):
            had = self._ring is not None
            self.close()
            return None, had
        if self._ring is not None and self._ring.name == feed.ring_name:
            return self._ring, False
        self.close()
        try:
            self._ring = RingReader(feed.ring_name)
        except AcquisitionError:  # it ended between the two looks
            return None, False
        self._channels = messages.Channels.of(machine)
        return self._ring, True

    def _newest(self) -> RowArray | None:
        return None if self._ring is None else self._ring.latest()

    def _state(self) -> str:
        return self._source.state(self._machine)

    def _send(self, make: Callable[[int], str]) -> None:
        """Put a number on a message and send it to all clients that had a snapshot."""
        self._seq += 1
        with self._lock:
            clients = tuple(self._clients)
        if clients:
            message = make(self._seq)
            for client in clients:
                client.offer(message)

    def _welcome(self) -> None:
        """Bring those who came since the last step to where the others are."""
        with self._lock:
            new, self._new = self._new, []
            self._clients += new
        if new:
            message = messages.snapshot(self._seq, self._state(), self._channels, self._newest())
            for client in new:
                client.offer(message)


class Hub:
    """All streams; a machine's thread lives while somebody looks at the machine.

    Parameters
    ----------
    source : where the acquisitions are
    closed : whether the service is stopping
    clock : s, monotonic
    """

    def __init__(
        self, source: Acquisition, closed: Callable[[], bool], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._source = source
        self._closed = closed
        self._clock = clock
        self._lock = threading.Lock()
        self._streams: dict[str, tuple[_Stream, threading.Event]] = {}

    @contextmanager
    def client(self, machine: str, client: Client) -> Iterator[None]:
        """Send the signals of ``machine`` to ``client`` while the block runs."""
        with self._lock:
            stream, stop = self._streams.get(machine) or self._start(machine)
            stream.add(client)
        try:
            yield
        finally:
            with self._lock:
                if stream.remove(client) == 0:
                    stop.set()
                    self._forget(machine, stream)

    def machines(self) -> tuple[str, ...]:
        """List machines that somebody looks at."""
        with self._lock:
            return tuple(self._streams)

    def _start(self, machine: str) -> tuple[_Stream, threading.Event]:
        stream, stop = _Stream(machine, self._source, self._clock), threading.Event()
        self._streams[machine] = stream, stop
        threading.Thread(target=self._run, args=(machine, stream, stop), name=f"live-{machine}", daemon=True).start()
        return stream, stop

    def _run(self, machine: str, stream: _Stream, stop: threading.Event) -> None:
        try:
            while True:
                stream.step()
                if self._closed() or stop.wait(PERIOD_S):
                    break
        except Exception as error:  # clients connect again; silence would look like a machine that stands still
            _log.error("live_failed", machine=machine, exc_info=error)
        finally:
            with self._lock:
                self._forget(machine, stream)
            stream.drop_all()
            stream.close()

    def _forget(self, machine: str, stream: _Stream) -> None:
        """Let the next client start a stream of its own; under the lock."""
        if self._streams.get(machine, (None,))[0] is stream:
            del self._streams[machine]
