"""``python -m benchmarks.storm.clock ORDER.json [WORKER]``: a host of the storm whose wall clock the storm can set.

The seconds by which it is wrong are in a file that all hosts map, so a jump comes to all of them at the same instant,
in the middle of whatever they do. The computer's own clock is left alone. Programs of C have the true time: databases,
and children of the hosts.
"""

from __future__ import annotations

import mmap
import struct
import sys
import time
from pathlib import Path

_SECONDS = struct.Struct("d")


class SetClock:
    """Seconds by which the hosts' wall clock is wrong, in a file that they share."""

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            path.write_bytes(_SECONDS.pack(0.0))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _SECONDS.size)

    @property
    def seconds(self) -> float:
        """By which it is wrong now."""
        return float(_SECONDS.unpack(self._map[:])[0])

    @seconds.setter
    def seconds(self, value: float) -> None:
        self._map[:] = _SECONDS.pack(value)


def _follow(clock: SetClock) -> None:
    """Let this process read the wrong time. Call it before anything is loaded that keeps ``time.time``."""
    true, true_ns = time.time, time.time_ns
    time.time = lambda: true() + clock.seconds
    time.time_ns = lambda: true_ns() + round(clock.seconds * 1e9)


def clock_file(order: Path) -> Path:
    """Return the file of the hosts that have this order."""
    return order.with_name("clock")


if __name__ == "__main__":
    given = SetClock(clock_file(Path(sys.argv[1])))
    _follow(given)
    from benchmarks.storm.host import main

    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None, lambda: given.seconds)
