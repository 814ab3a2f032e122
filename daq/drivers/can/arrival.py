"""When a frame was on the bus, on our own clock: from the interface's time stamp, whatever its clock is.

A thread that was kept from running takes frames late, all at once. Their time stamps, made by the kernel or a gateway,
know better, but belong to another clock. The difference ``taken - stamp`` is the offset of the clocks plus how long the
frame waited; its smallest value is the offset (plus the least latency), and what is above it is waiting.
"""

from __future__ import annotations

from daq.frames.clock import NS

DRIFT = 2e-4  # the smallest difference is let grow by this: quartz clocks differ by up to 100 ppm each
SET_S = 1.0  # a difference that jumps by more than this is a clock that was set: learn it anew


class ArrivalTimes:
    """Receive times of frames of one interface."""

    def __init__(self) -> None:
        self._least: float | None = None
        self._at = 0

    def of(self, stamp_s: float, taken_ns: int) -> int:
        """Monotonic ns at which the frame came; ``taken_ns`` itself where the interface gives no stamp (0)."""
        if not stamp_s > 0:
            return taken_ns
        difference = taken_ns - stamp_s * NS
        least = self._least
        if least is not None:
            least += DRIFT * (taken_ns - self._at)
        if least is None or difference < least or difference - least > SET_S * NS:
            least = difference
        self._least, self._at = least, taken_ns
        return taken_ns - round(difference - least)
