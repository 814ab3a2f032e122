"""TPDOs as they arrive, each credited to the SYNC that it answers.

A TPDO does not say which SYNC it answers, and one that is a whole period late arrives when the next one is due: by its
time alone it looks fresh. But a node sends each synchronous TPDO once per SYNC, and a bus keeps the order of one
identifier. So every SYNC that a node is to answer waits in a queue of each of its TPDOs, and what arrives is
credited to the oldest one (:class:`Tpdo`). A frame that is lost makes the next ones look late, never fresh; the driver
then starts the node anew (pre-operational and back), after which queue and node agree again.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import NamedTuple

from daq.drivers.canopen.mapping import Mapping

UNANSWERED = 50  # SYNCs that a TPDO may be behind; beyond, the oldest one is given up and the count is ambiguous


class Cycle:
    """The cycle that is under way, shared by the receive thread and the one that collects."""

    def __init__(self) -> None:
        self.number = 0
        self.sync_ns = 0
        self._lock = threading.Lock()
        self._pending: set[int] = set()
        self._whole = threading.Lock()  # held while something is pending; an Event takes three times as long

    def begin(self, number: int, sync_ns: int, expected: set[int]) -> None:
        """Start cycle ``number`` in which TPDOs of the COB-IDs ``expected`` are waited for."""
        with self._lock:
            self.number, self.sync_ns, self._pending = number, sync_ns, expected
            self._whole.acquire(blocking=False)
            if not expected:
                self._whole.release()

    def arrived(self, cob_id: int, number: int) -> None:
        """Take a TPDO of cycle ``number``."""
        with self._lock:
            if number == self.number and self._pending:
                self._pending.discard(cob_id)
                if not self._pending:
                    self._whole.release()

    def whole(self, seconds: float) -> bool:
        """Wait until all that is expected came; whether it did. For one thread at a time."""
        if not self._whole.acquire(timeout=max(0.0, seconds)):
            return False
        self._whole.release()
        return True


class Arrival(NamedTuple):
    """A TPDO's data, when it was on the bus, and the SYNC that it is credited to."""

    data: bytes
    at_ns: int
    cycle: int
    sync_ns: int
    ordinal: int  # of its TPDO, counted from 1
    during: int  # the cycle that was under way when it came


class Tpdo:
    """The last frame of one TPDO; :meth:`receive` runs in the receive thread.

    Attributes
    ----------
    latest : the newest one that a SYNC asked for
    count : how many of them came; the cycle has looked at those up to ``taken``
    surplus : frames that no SYNC asked for
    ambiguous : whether an unanswered SYNC was given up, so that the count may be wrong until the node is started anew
    """

    def __init__(self, mapping: Mapping, of: Cycle) -> None:
        self.mapping = mapping
        self.latest: Arrival | None = None
        self.count = 0
        self.taken = 0
        self.surplus = 0
        self.surplus_seen = 0
        self.wrong = 0
        self.wrong_length = 0
        self.ambiguous = False
        self.arrived_ns = 0
        self._of = of
        self._unanswered: deque[tuple[int, int]] = deque()

    def asked(self, number: int, sync_ns: int) -> None:
        """Expect the node's answers to a SYNC about to be sent."""
        if len(self._unanswered) >= UNANSWERED:
            self._unanswered.popleft()
            self.ambiguous = True
        self._unanswered.append((number, sync_ns))

    def give_up(self) -> None:
        """Take what is still due for lost; should it come all the same, it must not pass for fresh."""
        if self._unanswered:
            self._unanswered.clear()
            self.ambiguous = True

    def receive(self, data: bytearray, now_ns: int) -> None:
        """Keep the bytes and the time, if the length is right; canopen itself accepts a short PDO without a word."""
        if len(data) != self.mapping.length:
            self.wrong_length = len(data)
            self.wrong += 1
            return
        self.arrived_ns = now_ns
        try:
            number, sync_ns = self._unanswered.popleft()
        except IndexError:
            self.surplus += 1
            return
        self.count += 1
        self.latest = Arrival(bytes(data), now_ns, number, sync_ns, self.count, self._of.number)
        self._of.arrived(self.mapping.cob_id, number)

    def forget(self) -> None:
        """Forget what came and what was asked."""
        self._unanswered.clear()
        self.latest = None
        self.count = self.taken = 0
        self.surplus_seen = self.surplus
        self.wrong_length = 0
        self.ambiguous = False
