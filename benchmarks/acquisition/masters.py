"""On somebody else's bus: another master that comes, clocks that are set, strangers that send what others send.

Independent nodes (:mod:`sim_backends.devices.canopen_device`) on a virtual bus, at the wall's clock. Values count the
SYNCs, so that one of another SYNC is known; every frame of ours is counted where it leaves the driver.
"""

from __future__ import annotations

import statistics
import threading
import time
import uuid
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import can
import numpy as np

from benchmarks.targets import Outcome, fact, figure
from daq.acquisition.cycles import Cycles
from daq.acquisition.ledger import FRAME, Ledger
from daq.drivers.base import DriverContext
from daq.drivers.can.port import CanAccess, CanConfig, CanPort
from daq.drivers.canopen.driver import CanopenDriver
from daq.drivers.canopen.leadership import State
from daq.frames.channels import channel_table
from daq.frames.clock import FollowingClock, RealClock
from daq.frames.events import EventLog
from daq.frames.frame import Frame
from daq.machine.machine_file import CanopenBus, CanSource, Machine
from daq.quality import Quality
from sim_backends import default_machine
from sim_backends.devices.canopen_device import SimulatedNode
from sim_backends.devices.wiring import wire

LISTEN_S = 0.3
RECOVERY_S = 2.0
PATIENCE_S = 20.0
FRESH_PERIODS = 1.6  # that a fresh value may be older than its tick, a little beyond what drivers allow
COUNTED = 900  # SYNCs after which values begin again: as many as a 12-bit encoder tells apart
STEPS_S = (0.05, -0.05, 0.3, -0.3, 1.0, -1.0, 60.0, -60.0)


class World(threading.Thread):
    """All nodes, and another controller."""

    def __init__(self, machine: Machine, channel: str) -> None:
        super().__init__(daemon=True)
        self.bus = can.Bus(interface="virtual", channel=channel, preserve_timestamps=True)
        self.jump_s = 0.0
        self.syncs = 0
        self.moments = [0]  # monotonic ns of each SYNC, beginning with power-on
        self.leads = False  # whether the other controller sends SYNC
        self.ended = threading.Event()
        self._limits = [channel.range or (-1.0, 1.0) for channel in machine.channels]
        self.nodes = {plan.node: SimulatedNode(plan, self.say, machine.rate_hz) for plan in wire(machine).nodes}
        self._lock = threading.Lock()
        self.latch()
        for node in self.nodes.values():
            node.power_on(time.monotonic())

    def say(self, identifier: int, data: bytes) -> None:
        """A frame of a node, or of the other controller; its stamp is the gateway's clock."""
        stamp = time.time() + self.jump_s
        self.bus.send(can.Message(timestamp=stamp, arbitration_id=identifier, data=data, is_extended_id=False))

    def values(self, sync: int) -> tuple[float, ...]:
        """What is measured at a SYNC, SI: within each channel's range."""
        part = 0.1 + 0.8 * (sync % COUNTED) / COUNTED
        return tuple(low + part * (high - low) for low, high in self._limits)

    def latch(self) -> None:
        """Sample."""
        for node in self.nodes.values():
            node.latch(self.values(self.syncs))

    def sync(self) -> None:
        """SYNC, whosever it is."""
        self.syncs += 1
        self.moments.append(time.monotonic_ns())
        for node in self.nodes.values():
            node.on_sync(self.values(self.syncs))

    def master(self, identifier: int, data: bytes) -> None:
        """A frame of the other controller, heard by the nodes as well."""
        with self._lock:
            self.say(identifier, data)
            self._heard(identifier, data)

    def _heard(self, identifier: int, data: bytes) -> None:
        if identifier == 0x080:
            self.sync()
            return
        for node in self.nodes.values():
            if identifier == 0 or identifier == 0x600 + node.id:
                node.on_frame(identifier, data, time.monotonic())

    def run(self) -> None:
        """Until it is ended."""
        due = time.monotonic()
        while not self.ended.is_set():
            message = self.bus.recv(0.002)
            with self._lock:
                if message is not None:
                    self._heard(message.arbitration_id, bytes(message.data))
                for node in self.nodes.values():
                    node.on_time(time.monotonic())
            if self.leads and time.monotonic() >= due:
                due = max(due + 0.02, time.monotonic() - 0.02)
                self.master(0x080, b"")
        self.bus.shutdown()


class _Counted(CanAccess):
    """Counts every frame that leaves the driver."""

    def __init__(self) -> None:
        self.guest: Callable[[], bool] = lambda: False  # whether another master was heard
        self.afterwards = 0

    def attach(self, port: CanPort, config: CanConfig) -> Any:
        bus = super().attach(port, config)
        send = bus.send

        def counted(message: can.Message, timeout: float | None = None) -> None:
            self.afterwards += self.guest()
            send(message, timeout)

        bus.send = counted
        return bus


@dataclass
class Case:
    """What one row did, each time."""

    name: str
    frames: int = 0  # of ours, after the other master's first was taken from the interface
    heard: list[float] = field(default_factory=list)  # s from that frame until it was taken
    wrong: int = 0  # values called fresh that are of no SYNC within a cycle
    marked: list[tuple[int, int]] = field(default_factory=list)  # of 50 cycles before and behind it, not all fresh
    recoveries: list[float] = field(default_factory=list)
    unbalanced: int = 0


class Run:
    """One start of acquisition on a bus of its own."""

    def __init__(self) -> None:
        declared, _ = default_machine()
        channel = uuid.uuid4().hex
        (bus,) = (bus for bus in declared.buses if isinstance(bus, CanopenBus))
        bus = bus.model_copy(
            update={"interface": "virtual", "channel": channel, "options": {}, "listen_s": LISTEN_S, "bitrate": None}
        )
        channels = tuple(c for c in declared.channels if isinstance(c.source, CanSource))
        self.machine = declared.model_copy(update={"channels": channels, "buses": (bus,), "simulation": None})
        self.world = World(self.machine, channel)
        self.world.start()
        self.access = _Counted()
        events = EventLog()
        context = DriverContext(1 / self.machine.rate_hz, 0.0, time.monotonic_ns, events=events, can=self.access)
        self.driver = driver = CanopenDriver(bus, channels, context)
        self.access.guest = lambda: driver._leadership.state is State.GUEST
        self.problems = driver.start()
        own = RealClock(self.machine.rate_hz)
        clock = self.clock = FollowingClock(
            own, self.machine.rate_hz, context.period_s, lambda: driver.next_sync if driver.external_sync else None
        )
        table = channel_table(self.machine)
        self.cycles = Cycles(self.machine, table, [driver], clock, events)
        self.cycles.assembler._frozen = None  # a ramp of numbers is no sensor
        self.ledger = Ledger(table.names)
        self.frames: list[Frame] = []
        self.wrong = 0
        clock.start()

    def write_frame(self, frame: Frame) -> None:
        """In the ring's place: what came is looked at."""
        self.frames.append(frame)
        tick = self.clock._last
        assert tick is not None and tick.at_ns is not None
        oldest = bisect_right(self.world.moments, tick.at_ns - FRESH_PERIODS * 1e9 / self.machine.rate_hz) - 1
        near = [np.array(self.world.values(sync)) for sync in range(max(0, oldest), self.world.syncs + 1)]
        spans = np.array([high - low for low, high in self.world._limits]) / COUNTED
        fresh = frame.quality == Quality.FRESH
        agree = [np.abs(frame.values - values) <= 0.45 * spans for values in near]
        self.wrong += int((fresh & ~np.any(agree, axis=0)).sum())
        stored = np.isfinite(frame.values)[None, :] & ~np.isin(
            frame.quality, (Quality.STALE, Quality.MISSING, Quality.BUS_ERROR, Quality.INVALID, Quality.HELD)
        )
        self.ledger.add(frame.quality[None, :], stored, np.array([FRAME], dtype=np.uint8))

    def once(self, count: int = 1) -> None:
        """Cycles."""
        for _ in range(count):
            self.cycles.once(self)  # type: ignore[arg-type]

    def until_fresh(self, run: int = 5) -> float:
        """Seconds until so many cycles in a row were fresh on all channels."""
        began, good = time.monotonic(), 0
        while good < run and time.monotonic() - began < PATIENCE_S:
            self.once()
            good = good + 1 if bool(np.all(self.frames[-1].quality == Quality.FRESH)) else 0
        return time.monotonic() - began

    def close(self) -> None:
        """Everything ends."""
        self.driver.stop()
        self.world.ended.set()
        self.world.join()


def _power_up(run: Run) -> None:
    run.world.leads = True
    run.world.master(0x080, b"")


def _starts(run: Run) -> None:
    run.world.master(0x000, b"\x01\x00")
    run.world.leads = True


def _resets(run: Run) -> None:
    run.world.master(0x000, b"\x81\x00")
    run.world.master(0x000, b"\x01\x00")


def _asks(run: Run) -> None:
    run.world.master(0x600 + next(iter(run.world.nodes)), b"\x40\x00\x10\x00\0\0\0\0")
    run.world.leads = True


def _rebuilt(run: Run) -> None:
    assert run.driver.port is not None
    run.driver.port.fail(can.CanOperationError("the interface was reset"))
    run.world.leads = True
    run.world.master(0x080, b"")


#: What another master does; whether values come on by its SYNC.
MASTERS: tuple[tuple[str, Callable[[Run], None], bool], ...] = (
    ("another master powers up", _power_up, True),
    ("another master starts nodes", _starts, True),
    ("another master resets nodes, no SYNC", _resets, False),
    ("another SDO client", _asks, True),
    ("rebuilt while another master leads", _rebuilt, False),
)


def _master(case: Case, act: Callable[[Run], None], goes_on: bool, random: np.random.Generator) -> None:
    run = Run()
    try:
        run.until_fresh()
        run.once(int(random.integers(1, 30)))
        time.sleep(float(random.uniform(0, 0.02)))
        act(run)
        began = time.monotonic()
        while not run.access.guest() and time.monotonic() - began < PATIENCE_S:
            run.once()
        case.heard.append(time.monotonic() - began)
        if goes_on:
            case.recoveries.append(run.until_fresh())
        run.once(60)
        case.frames += run.access.afterwards
    finally:
        run.driver.stop()
        _settle(case, run)


def _step(case: Case, seconds: float, random: np.random.Generator) -> None:
    run = Run()
    try:
        run.until_fresh()
        run.once(int(random.integers(60, 100)))
        before = len(run.frames)
        run.world.jump_s = seconds
        run.once(50)
        lost = [bool(np.any(frame.quality != Quality.FRESH)) for frame in run.frames[before - 50 :]]
        case.marked.append((sum(lost[:50]), sum(lost[50:])))
        case.recoveries.append(run.until_fresh())
    finally:
        _settle(case, run)


def _settle(case: Case, run: Run) -> None:
    case.wrong += run.wrong
    run.ledger.close(run.frames[0].cycle, run.frames[-1].cycle)
    skipped = run.frames[-1].cycle - run.frames[0].cycle + 1 - len(run.frames)
    for channel in run.ledger.channels.values():
        channel.dropped["acquisition: cycle skipped"] += skipped
        case.unbalanced += not channel.balanced
    run.close()


def names() -> tuple[str, ...]:
    """Of all rows."""
    return (*(name for name, _, _ in MASTERS), *(f"stamps set by {step:+g} s" for step in STEPS_S))


def run_masters(times: int, seed: int, only: str | None, say: Callable[[str], None]) -> Outcome:
    """Every row so many times at random moments."""
    random = np.random.default_rng(seed)
    cases: list[Case] = []
    for name, act, goes_on in MASTERS:
        if only is None or only in name:
            cases.append(Case(name))
            for _ in range(times):
                _master(cases[-1], act, goes_on, random)
            say(f"{name:40s} {times} times")
    for step in STEPS_S:
        if only is None or only in (name := f"stamps set by {step:+g} s"):
            cases.append(Case(f"stamps set by {step:+g} s"))
            for _ in range(times):
                _step(cases[-1], step, random)
            say(f"{cases[-1].name:40s} {times} times")
    notes = [f"{'row':40s} ours afterwards   wrong   cycles marked before, behind   heard, worst   recovery, worst"]
    for case in cases:
        recovery, heard = (f"{max(times_s):.2f} s" if times_s else "-" for times_s in (case.recoveries, case.heard))
        marked = "{}, {}".format(*map(sum, zip(*case.marked, strict=True))) if case.marked else "-"
        notes.append(f"{case.name:40s} {case.frames:15d} {case.wrong:7d} {marked:>29s} {heard:>14s} {recovery:>17s}")
    frames, wrong = sum(case.frames for case in cases), sum(case.wrong for case in cases)
    worst = max((max(case.recoveries) for case in cases if case.recoveries), default=0.0)
    unbalanced = sum(case.unbalanced for case in cases)
    pairs = [pair for case in cases for pair in case.marked]
    more = statistics.mean([behind - before for before, behind in pairs]) if pairs else 0.0
    return Outcome(
        (
            figure("frames of ours after another master's first", frames, most=0),
            figure("wrong values called fresh", wrong, most=0),
            figure("cycles marked behind a step, beyond those before it, mean", more, "{:.2f}", most=1),
            figure("slowest recovery", worst, "{:.2f} s", most=RECOVERY_S),
            fact("produced = stored + dropped", not unbalanced, f"{times} times each"),
        ),
        tuple(notes),
    )
