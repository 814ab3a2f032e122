"""The acquisition loop: wait for the tick, trigger, collect, publish; and what it counts.

The clock and the drivers are arguments, so that a test can run it without either.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from daq.acquisition.assembly import Assembler
from daq.acquisition.frozen import FrozenDetector
from daq.acquisition.ring import RingWriter
from daq.drivers.base import Driver, DriverStatistics
from daq.frames.channels import ChannelTable
from daq.frames.clock import Clock
from daq.frames.events import EventLog
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.quality import Quality

INFO_SECONDS = 0.5
#: Upper bounds of the histogram of lateness, in ms.
LATENESS_MS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_BOUNDS = tuple(f"{bound:g}" for bound in (*LATENESS_MS, math.inf))
_QUALITIES = [quality.name.lower() for quality in Quality]
UTC_JUMP_NS = 50_000_000  # of the computer's clock against the monotonic one; what is smaller is its being steered


@dataclass
class AcquisitionStatistics:
    """Statistics of acquisition since it started.

    Attributes
    ----------
    state : ``starting``, ``running``, ``stopped`` or ``failed``
    cycles : frames published
    skipped : cycles that never happened because their time had passed (real clock)
    late : cycles that started more than a tenth of a period after their time
    slipped : cycles that started a whole period or more after their time, in lockstep with a simulation: they delay all
        that follow instead of being lost
    worst_late_ms : largest lateness in ms
    lateness : cycles by how late they started, each under the bound in ms that it did not exceed (``"inf"``: none)
    lateness_ms : sum of all lateness in ms
    utc_jumps : times that the computer's clock was set; machine time goes on unchanged
    quality : per channel, frames of each quality by name (qualities that never occurred are left out)
    buses : per bus its state, that of its devices, and counters
    events : the newest things that happened to devices and buses (:class:`daq.frames.events.Event`), oldest first
    fifo : whether the real-time scheduling class was granted
    warnings : one line each
    """

    state: str = "starting"
    cycles: int = 0
    skipped: int = 0
    late: int = 0
    slipped: int = 0
    worst_late_ms: float = 0.0
    lateness: dict[str, int] = field(default_factory=dict)
    lateness_ms: float = 0.0
    utc_jumps: int = 0
    quality: dict[str, dict[str, int]] = field(default_factory=dict)
    buses: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    fifo: bool = False
    warnings: list[str] = field(default_factory=list)

    def missing(self) -> int:
        """Count frames in which a due value was not fresh, per channel and summed."""
        return sum(n for counts in self.quality.values() for name, n in counts.items() if name not in ("fresh", "held"))


class Cycles:
    """The loop's state: what :func:`run_cycles` counts and publishes."""

    def __init__(
        self,
        machine: Machine,
        table: ChannelTable,
        drivers: Sequence[Driver],
        clock: Clock,
        events: EventLog | None = None,
    ) -> None:
        self.events = events or EventLog(clock.utc_ns, clock.monotonic_ns)
        self.lockstep = machine.simulation is not None and machine.simulation.lockstep
        # Drivers that send SYNC come first: polled devices are asked after it.
        self.drivers = sorted(drivers, key=lambda driver: not driver.leads)
        self.assembler = Assembler(
            table,
            [driver.channels for driver in self.drivers],
            machine.rate_hz,
            lockstep=self.lockstep,
            frozen=FrozenDetector(machine),
        )
        self.clock = clock
        self.table = table
        self._period_ns = 1e9 / (machine.rate_hz * (machine.simulation.speed if machine.simulation else 1.0))
        self._counted = AcquisitionStatistics(lateness=dict.fromkeys(_BOUNDS, 0))
        self._utc_offset_ns: int | None = None

    def once(self, ring: RingWriter) -> None:
        """Run one cycle: wait for its tick, trigger, collect, publish."""
        tick = self.clock.wait()
        sync_ns, utc_ns = self.clock.monotonic_ns(), self.clock.utc_ns()
        for driver in self.drivers:
            driver.trigger(tick.cycle)
        sent_ns = self.clock.monotonic_ns()
        samples = [driver.collect(tick.collect_until_ns) for driver in self.drivers]
        ring.write(self.assembler.frame(tick, sync_ns, utc_ns, samples, sent_ns))
        counted, late_ms = self._counted, tick.late_ns / 1e6
        counted.cycles += 1
        counted.skipped += tick.skipped
        if self.lockstep:
            counted.slipped += tick.late_ns >= self._period_ns
        else:
            counted.late += tick.late_ns >= 0.1 * self._period_ns
        counted.worst_late_ms = max(counted.worst_late_ms, late_ms)
        counted.lateness_ms += late_ms
        counted.lateness[_BOUNDS[bisect_left(LATENESS_MS, late_ms)]] += 1
        self._look_at_utc(utc_ns - sync_ns)

    def _look_at_utc(self, offset_ns: int) -> None:
        """Mark it when the computer's clock was set; cycles and machine time follow the monotonic one."""
        known, self._utc_offset_ns = self._utc_offset_ns, offset_ns
        if known is None or abs(offset_ns - known) <= UTC_JUMP_NS:
            return
        before = self.clock.monotonic_ns()
        offset_ns = self.clock.utc_ns() - before
        if self.clock.monotonic_ns() - before > UTC_JUMP_NS / 2 or abs(offset_ns - known) <= UTC_JUMP_NS:
            self._utc_offset_ns = known  # we were kept from running between the two clocks; the next cycle looks again
            return
        self._utc_offset_ns = offset_ns
        self._counted.utc_jumps += 1
        seconds = (offset_ns - known) / 1e9
        text = Sentence("daq.computer_clock_set", seconds=seconds)
        self.events.note("clock", "utc_jump", text)

    def statistics(self, state: str, *, fifo: bool, warnings: Sequence[str]) -> AcquisitionStatistics:
        """Return the state of everything."""
        counts = self.assembler.counts.T.tolist()
        quality = {
            name: {word: count for word, count in zip(_QUALITIES, own, strict=True) if count}
            for name, own in zip(self.table.names, counts, strict=True)
        }
        return replace(
            self._counted,
            state=state,
            lateness=dict(self._counted.lateness),
            quality=quality,
            buses=[_as_dict(driver.statistics()) for driver in self.drivers],
            events=self.events.published(),
            fifo=fifo,
            warnings=list(warnings),
        )


def _as_dict(statistics: DriverStatistics) -> dict[str, Any]:
    """Convert to JSON types; what a device does not have is left out."""
    devices = [{key: value for key, value in vars(d).items() if value or key == "detail"} for d in statistics.devices]
    for device in devices:
        if "latency_ms" in device:
            device["latency_ms"] = [round(value, 3) for value in device["latency_ms"]]
    return {**vars(statistics), "devices": devices, "counts": dict(statistics.counts)}


def _short(bus: dict[str, Any]) -> dict[str, Any]:
    """Shorten a bus to what it has without its devices' lines and identities."""
    devices = [{key: value for key, value in device.items() if key != "objects"} for device in bus["devices"]]
    return {**bus, "devices": [{**device, "detail": device["detail"][:40]} for device in devices]}


def run_cycles(
    cycles: Cycles,
    ring: RingWriter,
    stop: Callable[[], bool],
    *,
    fifo: bool = False,
    warnings: Sequence[str] = (),
) -> None:
    """Run cycles until ``stop()``; statistics go into the ring twice a second."""
    clock = cycles.clock

    def publish(state: str) -> None:
        info = vars(cycles.statistics(state, fifo=fifo, warnings=warnings))
        if not ring.set_info(info):  # hundreds of devices that all have something to say
            ring.set_info({**info, "events": info["events"][-8:], "buses": [_short(bus) for bus in info["buses"]]})

    clock.start()
    publish("running")
    next_info = clock.monotonic_ns() + round(INFO_SECONDS * 1e9)
    while not stop():
        cycles.once(ring)
        if clock.monotonic_ns() >= next_info:
            next_info = clock.monotonic_ns() + round(INFO_SECONDS * 1e9)
            publish("running")
    publish("stopped")
