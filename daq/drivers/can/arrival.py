"""When a frame was on the bus, on our own clock: from the interface's time stamp, whatever its clock is.

A thread that was kept from running takes frames late, all at once. Their time stamps, made by the kernel or a gateway,
know better, but belong to a clock that is slewed, is set, and is a little fast or slow: the kernel's of SocketCAN are
``CLOCK_REALTIME``, and no interface of python-can offers ``CLOCK_MONOTONIC``. With ``taken`` on our clock and
``offset`` between the two::

    taken - stamp = offset + how long the frame waited       so  offset <= taken - stamp
    a frame came after any moment at which none was there    so  offset >= moment - stamp

The estimate is the smallest ``taken - stamp``, allowed to grow by :data:`DRIFT`. A clock that is set forwards makes it
smaller; one that is set back contradicts the second line with its first frame, and the estimate starts anew. What is
contradicted neither way is waiting, however long, unless every frame of a second waited: then so little was that it is
the clock as well. Frames of one interface never overtake each other.
"""

from __future__ import annotations

import math

from daq.frames.clock import NS

DRIFT, UNKNOWN_DRIFT = 2e-4, 2e-3  # growth beside the rate, while it is known and while it is not: 1000 ppm and a slew
TRANSIT_NS = 20_000_000  # that a gateway may take to hand on a frame: by so much the second line is to be contradicted
WINDOW_NS, WINDOW = NS, 20  # time and frames in which one comes without waiting
_NONE = (math.inf, 0.0, 0)


class ArrivalTimes:
    """Receive times of frames of one interface."""

    def __init__(self) -> None:
        self._offset: float | None = None
        self._taken = self._came = self._empty = 0
        self._rate = 0.0  # of the offset, ns per ns
        self._windows = self._count = self._ends = 0  # windows so far; of the one that lasts: frames, when it ends
        self._least = _NONE  # of it: the shortest wait, with its difference and moment
        self._before = _NONE  # of the one before
        self.restarts = 0  # clocks that were set

    def nothing_at(self, now_ns: int) -> None:
        """No frame waited at monotonic ``now_ns``."""
        self._empty = now_ns

    def of(self, stamp_s: float, taken_ns: int) -> int:
        """Monotonic ns at which the frame came; ``taken_ns`` itself where the interface gives no stamp (0)."""
        if not stamp_s > 0:
            return taken_ns
        stamp = stamp_s * NS
        offset = taken_ns - stamp
        if self._offset is not None:
            growth = self._rate + (DRIFT if self._windows > 1 else UNKNOWN_DRIFT)
            grown = self._offset + growth * (taken_ns - self._taken)
            if stamp + grown >= self._empty - TRANSIT_NS:
                self._count += 1
                if offset - grown < self._least[0]:
                    self._least = (offset - grown, offset, taken_ns)
                if taken_ns >= self._ends and self._count >= WINDOW:
                    grown += self._close(taken_ns)
                if grown < offset:
                    offset = grown
            else:
                self.restarts += 1
                self._windows = self._count = 0
                self._least, self._ends = _NONE, taken_ns + WINDOW_NS
        self._offset, self._taken = offset, taken_ns
        self._came = min(taken_ns, max(self._came, round(stamp + offset)))
        return self._came

    def _close(self, now_ns: int) -> float:
        """End a window: what even the shortest of its waits had of the offset; two of them tell its rate as well."""
        least, before = self._least, self._before
        if self._windows:
            slope = (least[1] - before[1]) / max(1, least[2] - before[2])
            if abs(slope) <= UNKNOWN_DRIFT:  # else the clock was set meanwhile
                self._rate += 0.5 * (slope - self._rate)  # not in full: one of the two may have waited throughout
        self._before, self._least, self._windows, self._count = least, _NONE, self._windows + 1, 0
        self._ends = now_ns + WINDOW_NS
        return max(0.0, least[0])
