"""What paces the cycle: the wall's clock for a machine, lockstep for a simulation."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from daq.machine.machine_file import Machine

NS = 1_000_000_000


@dataclass(frozen=True)
class Tick:
    """The start of one cycle.

    Attributes
    ----------
    cycle : its number; numbers that were skipped are cycles that never happened
    time : s of machine time
    late_ns : how long after its time it started
    skipped : ticks that were left out before it (their time had passed)
    collect_until_ns : monotonic ns until which answers of this cycle are waited for
    at_ns : monotonic ns of the moment that ``time`` stands for; None: it began in time
    """

    cycle: int
    time: float
    late_ns: int
    skipped: int
    collect_until_ns: int
    at_ns: int | None = None


class Clock(Protocol):
    """Paces the cycle and tells the time; the only place that sleeps or looks at a clock."""

    def monotonic_ns(self) -> int:
        """Nanoseconds of a clock that never jumps."""

    def utc_ns(self) -> int:
        """Nanoseconds since 1970."""

    def start(self) -> None:
        """The first tick is one period from now."""

    def wait(self) -> Tick:
        """Sleep until the next tick."""


class RealClock:
    """Absolute deadlines: tick ``k`` is at ``start + k / rate``, whatever happened before.

    A tick whose successor is already due is skipped and its number with it, so that a stall never causes a burst and
    machine time stays the wall's time.
    """

    def __init__(self, rate_hz: float, speed: float = 1.0) -> None:
        self._period = round(NS / (rate_hz * speed))
        self._rate = rate_hz
        self._origin = 0
        self._next = 0

    def monotonic_ns(self) -> int:
        """Nanoseconds of the monotonic clock."""
        return time.monotonic_ns()

    def utc_ns(self) -> int:
        """Nanoseconds since 1970 by the system's clock."""
        return time.time_ns()

    def start(self) -> None:
        """Tick 0 is one period from now."""
        self._origin = time.monotonic_ns() + self._period
        self._next = 0

    def wait(self) -> Tick:
        """Sleep until the next tick that is not over yet."""
        now = time.monotonic_ns()
        due = max(self._next, (now - self._origin) // self._period)
        skipped = due - self._next
        at = self._origin + due * self._period
        while (now := time.monotonic_ns()) < at:
            time.sleep((at - now) / NS)
        self._next = due + 1
        # The last tenth of the period is kept for publishing the frame and for waking up in time.
        return Tick(due, due / self._rate, now - at, skipped, at + self._period * 9 // 10, at)


class LockstepClock:
    """Machine time advances one period per SYNC and by nothing else.

    The wall's period is ``1 / (rate * speed)``. A cycle that takes longer makes the next tick slip, and all that
    follow: nothing is skipped, because to the simulated machine no time has passed. Answers are waited for so long as
    ``patience_s``, which is longer than a busy computer keeps a device from running; a simulated device that is really
    dead stops being waited for after a few cycles.
    """

    def __init__(self, rate_hz: float, speed: float, patience_s: float = 2.0) -> None:
        self._patience_s = patience_s
        self._period = round(NS / (rate_hz * speed))
        self._rate = rate_hz
        self._at = 0
        self._cycle = 0

    def monotonic_ns(self) -> int:
        """Nanoseconds of the monotonic clock."""
        return time.monotonic_ns()

    def utc_ns(self) -> int:
        """Nanoseconds since 1970 by the system's clock."""
        return time.time_ns()

    def start(self) -> None:
        """Tick 0 is one wall period from now."""
        self._at = time.monotonic_ns() + self._period
        self._cycle = 0

    def wait(self) -> Tick:
        """Sleep until the next tick, or not at all when it is overdue."""
        while (now := time.monotonic_ns()) < self._at:
            time.sleep((self._at - now) / NS)
        late = now - self._at
        cycle, self._cycle = self._cycle, self._cycle + 1
        # Within one period of lateness the pace is kept (waking up late is no slip); beyond, all later ticks slip.
        self._at = self._at + self._period if late < self._period else now + self._period
        return Tick(cycle, cycle / self._rate, late, 0, now + max(self._period, round(self._patience_s * NS)))


class SyncClock:
    """Led by a SYNC that is not ours: a tick whenever it comes, by our own clock where it does not.

    Cycles are numbered by the SYNCs, so that machine time is the other master's. A SYNC that comes more often than the
    cycle leads only where a period is over; one that comes at other moments leads nothing (the driver says so).
    When it comes again after it was lost, the ticks follow it from the next one on.

    Parameters
    ----------
    period_s : wall seconds per cycle
    next_sync : when the next SYNC came (monotonic ns); None if it has not by the deadline (ns) that it is given
    monotonic_ns : the clock of these moments
    """

    TOLERANCE = 0.2  # of a period that a SYNC may come too early or too late

    def __init__(
        self,
        rate_hz: float,
        period_s: float,
        next_sync: Callable[[int], int | None],
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._rate = rate_hz
        self._period = round(period_s * NS)
        self._next_sync = next_sync
        self._now = monotonic_ns
        self._last = 0
        self._cycle = -1
        self._free = True  # whether the last tick was by our own clock

    def monotonic_ns(self) -> int:
        """Nanoseconds of the monotonic clock."""
        return self._now()

    def utc_ns(self) -> int:
        """Nanoseconds since 1970 by the system's clock."""
        return time.time_ns()

    def start(self) -> None:
        """The first tick is the next SYNC, or one period from now."""
        self._last, self._cycle, self._free = self._now(), -1, True

    def go_on(self, cycle: int, at_ns: int) -> None:
        """Follow from here on: cycle ``cycle`` was at ``at_ns``, by another clock."""
        self._last, self._cycle, self._free = at_ns, cycle, True

    def wait(self) -> Tick:
        """Wait for the SYNC that is due; half a period more than that, then go on without."""
        while True:
            at = self._next_sync(self._last + (self._period if self._free else self._period * 3 // 2))
            if at is None:
                self._free = True
                steps = max(1, (self._now() - self._last) // self._period)
                return self._tick(self._last + steps * self._period, steps)
            elapsed = (at - self._last) / self._period
            if round(elapsed) >= 1 and abs(elapsed - round(elapsed)) <= self.TOLERANCE:
                self._free = False
                return self._tick(at, round(elapsed))
            if self._free:  # it is here again, at another moment: periods count from it
                self._free, self._last = False, at

    def _tick(self, at: int, steps: int) -> Tick:
        steps = steps if self._cycle >= 0 else 1
        self._cycle += steps
        self._last = at
        late_ns, until_ns = self._now() - at, at + self._period * 9 // 10
        return Tick(self._cycle, self._cycle / self._rate, late_ns, steps - 1, until_ns, at)


class FollowingClock:
    """Our own clock, until another master's SYNC leads the cycle; then that one, for good.

    Parameters
    ----------
    own : our own
    following : what tells the next SYNC (as :class:`SyncClock` takes it), once there is one to follow
    """

    def __init__(
        self,
        own: RealClock,
        rate_hz: float,
        period_s: float,
        following: Callable[[], Callable[[int], int | None] | None],
    ) -> None:
        self._clock: RealClock | SyncClock = own
        self._rate, self._period_s = rate_hz, period_s
        self._following = following
        self._last: Tick | None = None
        self.monotonic_ns, self.utc_ns = own.monotonic_ns, own.utc_ns

    def start(self) -> None:
        """As the clock that leads does."""
        self._clock.start()

    def wait(self) -> Tick:
        """The next tick; cycles are counted on from one clock to the other."""
        if isinstance(self._clock, RealClock) and (next_sync := self._following()) is not None:
            self._clock = SyncClock(self._rate, self._period_s, next_sync, self.monotonic_ns)
            self._clock.start()
            if self._last is not None and self._last.at_ns is not None:
                self._clock.go_on(self._last.cycle, self._last.at_ns)
        self._last = self._clock.wait()
        return self._last


def clock_for(machine: Machine) -> Clock:
    """The clock that a machine is acquired with: the wall's, unless the file describes a simulation."""
    simulation = machine.simulation
    if simulation is None:
        return RealClock(machine.rate_hz)
    if simulation.lockstep:
        return LockstepClock(machine.rate_hz, simulation.speed, simulation.patience_s)
    return RealClock(machine.rate_hz, simulation.speed)
