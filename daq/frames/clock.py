"""Pace of the cycle: the wall's clock or another master's SYNC for a machine, lockstep for a simulation."""

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
        """Return nanoseconds of a clock that never jumps."""

    def utc_ns(self) -> int:
        """Return nanoseconds since 1970."""

    def start(self) -> None:
        """Set the first tick one period from now."""

    def wait(self) -> Tick:
        """Sleep until the next tick."""


#: Tells when the next SYNC came (monotonic ns); None if it has not by the deadline (ns) that it is given.
NextSync = Callable[[int], int | None]


class _SystemClocks:
    """The clocks of this computer."""

    def monotonic_ns(self) -> int:
        """Return nanoseconds of the monotonic clock."""
        return time.monotonic_ns()

    def utc_ns(self) -> int:
        """Return nanoseconds since 1970 by the system's clock."""
        return time.time_ns()

    def until(self, deadline_ns: int) -> int:
        """Sleep until then; what time it is afterwards."""
        while (now := time.monotonic_ns()) < deadline_ns:
            time.sleep((deadline_ns - now) / NS)
        return now


class RealClock(_SystemClocks):
    """The wall's time: absolute deadlines of our own, or another master's SYNC once one is followed.

    A tick whose successor is already due is skipped and its number with it, so that a stall never causes a burst and
    machine time stays the wall's time. Of a master that is followed, cycles are numbered by its SYNCs, so that machine
    time is its own. A SYNC that comes more often than the cycle leads only where a period is over; one that comes at
    other moments leads nothing (the driver says so). Where it does not come our own clock goes on; when it comes again,
    the ticks follow it from the next one on.

    Parameters
    ----------
    speed : machine seconds per second
    following : what tells the next SYNC; None as long as there is none to follow
    """

    TOLERANCE = 0.2  # of a period that a SYNC may come too early or too late

    def __init__(
        self, rate_hz: float, speed: float = 1.0, following: Callable[[], NextSync | None] = lambda: None
    ) -> None:
        self._period = round(NS / (rate_hz * speed))
        self._rate = rate_hz
        self._following = following
        self._last = 0  # moment of the last tick, or of the SYNC that periods count from
        self._cycle = -1
        self._free = True  # whether the last tick was by our own clock

    def start(self) -> None:
        """Set tick 0 at the next SYNC, or one period from now."""
        self._last, self._cycle, self._free = self.monotonic_ns(), -1, True

    def wait(self) -> Tick:
        """Wait until the next tick that is not over yet: of a SYNC half a period more than it may take."""
        while True:
            next_sync = self._following()
            if next_sync is None:
                now, at = self.until(self._last + self._period), None
            else:
                at = next_sync(self._last + (self._period if self._free else self._period * 3 // 2))
                now = self.monotonic_ns()
            if at is None:
                self._free = True
                steps = max(1, (now - self._last) // self._period)
                return self._tick(self._last + steps * self._period, steps, now)
            elapsed = (at - self._last) / self._period
            if round(elapsed) >= 1 and abs(elapsed - round(elapsed)) <= self.TOLERANCE:
                self._free = False
                return self._tick(at, round(elapsed), now)
            if self._free:  # it is here, or here again, at another moment: periods count from it
                self._free, self._last = False, at

    def _tick(self, at: int, steps: int, now: int) -> Tick:
        steps = steps if self._cycle >= 0 else 1
        self._cycle += steps
        self._last = at
        # The last tenth of the period is kept for publishing the frame and for waking up in time.
        return Tick(self._cycle, self._cycle / self._rate, now - at, steps - 1, at + self._period * 9 // 10, at)


class LockstepClock(_SystemClocks):
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

    def start(self) -> None:
        """Set tick 0 one wall period from now."""
        self._at = time.monotonic_ns() + self._period
        self._cycle = 0

    def wait(self) -> Tick:
        """Sleep until the next tick, or not at all when it is overdue."""
        now = self.until(self._at)
        late = now - self._at
        cycle, self._cycle = self._cycle, self._cycle + 1
        # Within one period of lateness the pace is kept (waking up late is no slip); beyond, all later ticks slip.
        self._at = self._at + self._period if late < self._period else now + self._period
        return Tick(cycle, cycle / self._rate, late, 0, now + max(self._period, round(self._patience_s * NS)))


def clock_for(machine: Machine, following: Callable[[], NextSync | None] = lambda: None) -> Clock:
    """Make a machine's acquisition clock: the wall's (``following`` as there), or lockstep with a simulation."""
    simulation = machine.simulation
    if simulation is not None and simulation.lockstep:
        return LockstepClock(machine.rate_hz, simulation.speed, simulation.patience_s)
    return RealClock(machine.rate_hz, 1.0 if simulation is None else simulation.speed, following)
