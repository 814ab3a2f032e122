"""When a frame was on the bus, on our own clock: from the interface's time stamp, whatever its clock is.

A thread that was kept from running takes frames late, all at once. Their time stamps, made by the kernel or a gateway,
know better, but belong to a clock that is slewed, is set, and is a little fast or slow: the kernel's of SocketCAN are
``CLOCK_REALTIME``, and no interface of python-can offers ``CLOCK_MONOTONIC``. With ``taken`` on our clock and
``offset`` between the two::

    taken - stamp = offset + how long the frame waited       so  offset <= taken - stamp
    a frame came after any moment at which none was there    so  offset >= moment - stamp

A clock that is set contradicts one of the two lines with its first frame. Where they are close to each other
(:data:`TIGHT_NS`) a frame proves the offset, and one that is close to what is known confirms it; the estimate is the
smallest of those of :data:`WINDOW_NS`, since a gateway may hand on a frame late. What is neither waited, however long.
Without a proof or a confirmation for :data:`STALE_NS`, times are not sure, and whoever receives looks more often, until
there is one. Frames of one interface never overtake each other.
"""

from __future__ import annotations

import math
from collections import deque

from daq.frames.clock import NS

TRANSIT_NS = 20_000_000  # that a gateway may take to hand on a frame: by so much one of the lines is to be contradicted
TIGHT_NS, NEAR_NS = 500_000, 300_000  # that a frame may have waited to prove an offset, and to confirm it
WINDOW_NS, STALE_NS = NS // 5, 2 * NS // 5  # in which a clock that is off by 1000 ppm is off by as little


class ArrivalTimes:
    """Receive times of frames of one interface.

    Attributes
    ----------
    watched : whether somebody says when no frame waited; else each is taken for one that came just now
    sure_ns : frames that came before it have times that may be wrong by more than a millisecond; infinite: all have
    uncertain : whether a proof is wanted
    restarts : clocks that were set
    """

    def __init__(self) -> None:
        self._offset = math.inf
        self._came = self._empty = self._known = 0
        self._least: deque[tuple[float, int]] = deque()  # offsets and moments of the window, each above the one before
        self.watched = self.uncertain = False
        self.sure_ns = 0.0
        self.restarts = 0

    @property
    def received_ns(self) -> int:
        """Moment up to which every frame was taken: the last that came, or at which none waited."""
        return max(self._came, self._empty)

    def nothing_at(self, now_ns: int) -> None:
        """Note that no frame waited at monotonic ``now_ns``."""
        self._empty = now_ns

    def of(self, stamp_s: float, taken_ns: int) -> int:
        """Return the monotonic ns of a frame's arrival; ``taken_ns`` where the interface gives no stamp (0)."""
        if not stamp_s > 0:
            return taken_ns
        stamp = stamp_s * NS
        offset = taken_ns - stamp
        if self._offset < math.inf and not self._empty - TRANSIT_NS <= stamp + self._offset <= taken_ns + TRANSIT_NS:
            self.restarts += 1
            self._offset, self._known = math.inf, 0
            self._least.clear()
        proven = not self.watched or taken_ns - self._empty <= TIGHT_NS
        if proven or (self._known and offset <= self._offset + NEAR_NS):
            self._known = taken_ns
            while self._least and self._least[-1][0] >= offset:
                self._least.pop()
            self._least.append((offset, taken_ns))
            while self._least[0][1] < taken_ns - WINDOW_NS:
                self._least.popleft()
            self._offset = self._least[0][0]
        else:
            self._offset = min(self._offset, offset)
        self._came = min(taken_ns, max(self._came, round(stamp + self._offset)))
        if self.watched:
            unknown_ns = taken_ns - self._known if self._known else math.inf
            self.uncertain = unknown_ns > STALE_NS / 2
            if unknown_ns > STALE_NS:
                self.sure_ns = math.inf
            elif self.sure_ns == math.inf:
                self.sure_ns = self._came
        return self._came
