"""Quality of a value in a frame or a recording."""

from __future__ import annotations

from enum import IntEnum


class Quality(IntEnum):
    """Quality of one channel in one cycle.

    A value is a measurement of the cycle it stands in when its quality is :attr:`FRESH` or :attr:`OUT_OF_RANGE`.
    Everything else is kept for people to look at, never for fitting. Recordings made before there was :attr:`INVALID`
    have :attr:`OUT_OF_RANGE` and NaN instead.
    """

    FRESH = 0  # sampled at this cycle's SYNC and here in time
    STALE = 1  # nothing came this cycle: the last known value, with its age
    MISSING = 2  # nothing came, and nothing recent is known: NaN
    LATE = 3  # sampled at an earlier SYNC, or came later than half a period after its own, or nobody knows when
    OUT_OF_RANGE = 4  # at or beyond the channel's range
    EMERGENCY = 5  # the device reports an error of its own (EMCY, exception code)
    BUS_ERROR = 6  # the bus is down
    INVALID = 7  # what came is no measurement: NaN, infinity, a sentinel, or two devices answer as one; then NaN
    FROZEN = 8  # has not changed for much longer than this channel ever stays the same
    HELD = 9  # nothing was due: a device with a rate of its own; its last value, with its age


#: Qualities whose value was measured in the cycle it stands in.
MEASURED = (Quality.FRESH, Quality.OUT_OF_RANGE)
