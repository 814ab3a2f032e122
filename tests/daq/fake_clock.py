"""A clock that steps by hand, for cycles without waiting."""

from __future__ import annotations

from daq.frames.clock import NS, Tick


class FakeClock:
    """A clock that a test turns by hand; :meth:`wait` returns at once and jumps to the next tick."""

    def __init__(self, rate_hz: float, origin_ns: int = 1_000 * NS) -> None:
        self._period = round(NS / rate_hz)
        self._rate = rate_hz
        self._now = origin_ns
        self._cycle = 0
        self._skip = 0

    def monotonic_ns(self) -> int:
        """Nanoseconds that the test has let pass."""
        return self._now

    def utc_ns(self) -> int:
        """The same, as if the epoch was the origin."""
        return self._now

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self._now += round(seconds * NS)

    def skip(self, cycles: int) -> None:
        """Let the next ticks be missed."""
        self._skip += cycles

    def start(self) -> None:
        """Count from 0."""
        self._cycle = 0

    def wait(self) -> Tick:
        """The next tick, at once."""
        skipped, self._skip = self._skip, 0
        cycle = self._cycle + skipped
        self._cycle = cycle + 1
        self._now += self._period * (1 + skipped)
        return Tick(cycle, cycle / self._rate, 0, skipped, self._now + self._period * 9 // 10)
