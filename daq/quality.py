"""What a value in a frame or a recording is worth."""

from __future__ import annotations

from enum import IntEnum


class Quality(IntEnum):
    """Quality of one channel in one cycle.

    A value is a measurement of the cycle it stands in when its quality is :attr:`FRESH` or :attr:`OUT_OF_RANGE`
    (and, in the second case, it is finite). Everything else is kept for people to look at, never for fitting.
    """

    FRESH = 0  # sampled at this cycle's SYNC and here in time
    STALE = 1  # nothing came this cycle: the last known value, with its age
    MISSING = 2  # nothing came, and nothing recent is known: NaN
    LATE = 3  # what came in this cycle was sampled at the SYNC before
    OUT_OF_RANGE = 4  # at or beyond the channel's range, or a sentinel, NaN or infinity (then NaN)
    EMERGENCY = 5  # the device reports an error of its own (EMCY, exception code)
    BUS_ERROR = 6  # the bus is down


#: Qualities whose value was measured in the cycle it stands in.
MEASURED = (Quality.FRESH, Quality.OUT_OF_RANGE)
