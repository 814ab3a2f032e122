"""How often a frame comes, and whether two devices send it: by its period and by what it holds.

A frame that one sender repeats comes once per period; one that is late is caught up with, so that after a stall several
may come at once. One that comes early is one too many, unless its sender repeats it and also sends it when a value
changes: then its timer begins anew, and the next one comes where it was not due (CiA 301, 7.5.2.37). Of two senders the
first one's timer goes on. From then on nobody can say which frame is whose. Two senders that were there from the start
look like one of twice the rate; but what every second frame holds belongs together: all values of the one half are
above all of the other half, which noise does with a probability of 2 in ``C(32, 16)``, 3e-9, and a motion not at all.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Sequence

INTERVALS = 9  # of which the median is taken for a frame's own
REGULAR = 0.1  # of the median, by which no interval of a frame with a period of its own is off
NEAR = 0.15  # of a period, by which a frame that is where it is due may be off; or so many of its largest deviations:
DEVIATIONS = 3
BEHIND = 4  # frames in a row that are late after a stall; then they were lost
HITS = 6  # frames in a row where they were due with others between them: two senders
ELSEWHERE = 2  # frames in a row where they were not due, behind others: one that also sends changes
PULL = 0.25  # of what a frame is off, by which the next one is expected otherwise
SUSPECT = 12  # frames after the last one too many in which a stream is still another's
HALF = 16  # frames of each half that are compared


class Pace:
    """Of the frames of one stream.

    Parameters
    ----------
    declared_ns : interval that its description promises, if any
    """

    def __init__(self, declared_ns: float | None = None) -> None:
        self._declared_ns = declared_ns
        self._intervals: deque[int] = deque(maxlen=INTERVALS)
        self._last: int | None = None
        self._median = 0.0
        self._period = 0.0  # of one sender, once it was regular
        self._near = 0.0  # ns that a frame may be off
        self._due = 0.0
        self._early = self._late = self._hits = self._elsewhere = self._suspect = 0
        self._sends_changes = False
        self._held: deque[tuple[float, ...]] = deque(maxlen=2 * HALF)

    @property
    def interval_ns(self) -> float:
        """Time between two frames, ns; 0 while it is not known."""
        return self._declared_ns or self._median

    @property
    def known(self) -> bool:
        """Whether enough frames came to decide it."""
        return len(self._held) == 2 * HALF

    def arrived(self, at_ns: int) -> bool:
        """Take a frame; return whether it may be another sender's."""
        last, self._last = self._last, at_ns
        if last is None:
            return False
        self._intervals.append(at_ns - last)
        self._suspect -= self._suspect > 0
        if self._period:
            early = self._look(at_ns)
            if self._suspect or (early and not self._sends_changes):
                self._intervals.clear()  # of one sender the period is, not of two
                return True
        self._median = statistics.median(self._intervals)
        off = max(abs(interval - self._median) for interval in self._intervals)
        if len(self._intervals) == INTERVALS and off <= REGULAR * self._median:
            if not self._period:
                self._due = at_ns + self._median
            self._period, self._near = self._median, max(NEAR * self._median, DEVIATIONS * off)
        return False

    def _look(self, at_ns: int) -> bool:
        """Return whether a frame came before it was due."""
        if at_ns < self._due - self._near:
            self._early += 1
            if self._suspect:
                self._suspect = SUSPECT
            return True
        in_time = at_ns <= self._due + self._near
        behind = self._early > 0
        if behind:
            self._hits = self._hits + 1 if in_time else 0
            self._elsewhere = 0 if in_time else self._elsewhere + 1
            if self._elsewhere >= ELSEWHERE:
                self._sends_changes, self._suspect = True, 0
            elif self._hits >= HITS and not self._sends_changes:
                self._suspect = SUSPECT
        self._early = 0
        self._late = 0 if in_time else self._late + 1
        lost = self._late >= BEHIND or self._sends_changes or (behind and not in_time)
        pull = 1.0 if lost else PULL if in_time else 0.0
        self._due += self._period + pull * (at_ns - self._due)
        return False

    def mixed(self, values: Sequence[float]) -> bool:
        """Take a frame's content; return whether alternate ones are another sender's."""
        held = self._held
        held.append(tuple(values))
        if len(held) < 2 * HALF:
            return False
        for channel in zip(*held, strict=False):
            ours, theirs = channel[::2], channel[1::2]
            if all(map(math.isfinite, channel)) and (max(ours) < min(theirs) or max(theirs) < min(ours)):
                return True
        return False
