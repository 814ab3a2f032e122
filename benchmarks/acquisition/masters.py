"""On somebody else's bus: another master that comes, clocks that are set, SYNCs of ours that are late, odd nodes.

Independent nodes (:mod:`sim_backends.devices.canopen_device`) on a virtual bus, at the wall's clock. Values count the
SYNCs, so that it is known of each which SYNC sampled it, and when that was sent; every frame of ours is counted where
it leaves the driver. What a busy computer marks by itself (a tick that begins late, nodes that answer late) is kept
apart from what was done to the bus.
"""

from __future__ import annotations

import contextlib
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from daq.acquisition.cycles import Cycles
from daq.acquisition.ledger import FRAME, Ledger
from daq.drivers.base import DriverContext
from daq.drivers.can.port import CanAccess, CanPort
from daq.drivers.canopen.driver import CanopenDriver
from daq.drivers.canopen.leadership import State
from daq.errors import BusError
from daq.frames.channels import channel_table
from daq.frames.clock import RealClock, Tick
from daq.frames.events import EventLog
from daq.frames.frame import Frame
from daq.machine.machine_file import CanBus, CanopenBus, CanSource, Machine
from daq.quality import Quality
from sim_backends import default_machine
from sim_backends.devices.canopen_device import SimulatedNode
from sim_backends.devices.wiring import wire

LISTEN_S = 1.0  # ten heartbeats, also on a computer that is busy
PATIENCE_S = 20.0
BEHIND = 25  # cycles for which may be marked what a lost answer leads to: its node is started anew
AGE_S = 1e-3  # that the age of a fresh value may be wrong by
COUNTED = 900  # SYNCs after which values begin again: as many as a 12-bit encoder resolves
Row = Callable[[np.random.Generator], "Seen"]  # one time of it
NOT_STORED = (Quality.STALE, Quality.MISSING, Quality.BUS_ERROR, Quality.INVALID, Quality.HELD)
STEPS_S = (0.05, -0.05, 0.3, -0.3, 1.0, -1.0, 60.0, -60.0)


class _World(threading.Thread):
    """All nodes, and another controller."""

    def __init__(self, machine: Machine, channel: str) -> None:
        super().__init__(daemon=True)
        self.bus = can.Bus(interface="virtual", channel=channel, preserve_timestamps=True)
        self.jump_s = self.rate = 0.0  # of the gateway's clock, and what it gains per second
        self.syncs = 0
        self.moments = [0]  # monotonic ns of each SYNC as it was sent, beginning with power-on
        self.answered = [0]  # and when the nodes had answered it
        self.ours: deque[int] = deque()  # when SYNCs of ours left, that the nodes have not received yet
        self.leads = False  # whether the other controller sends SYNC
        self.ended = threading.Event()
        self._limits = [channel.range or (-1.0, 1.0) for channel in machine.channels]
        self.nodes = {plan.node: SimulatedNode(plan, self.send, machine.rate_hz) for plan in wire(machine).nodes}
        self._lock = threading.Lock()
        self.latch()
        for node in self.nodes.values():
            node.power_on(time.monotonic())

    def send(self, identifier: int, data: bytes) -> None:
        """Send a frame of a node, or of the other controller; its stamp is the gateway's clock."""
        stamp = time.time() + self.jump_s + self.rate * time.monotonic()
        self.bus.send(can.Message(timestamp=stamp, arbitration_id=identifier, data=data, is_extended_id=False))

    def set_clock(self, by_s: float = 0.0, rate: float = 0.0) -> None:
        """Set the gateway's clock, and let it gain so much per second from now on."""
        self.jump_s += by_s - rate * time.monotonic()
        self.rate = rate

    def values(self, sync: int) -> tuple[float, ...]:
        """Measure at a SYNC, SI: within each channel's range."""
        part = 0.1 + 0.8 * (sync % COUNTED) / COUNTED
        return tuple(low + part * (high - low) for low, high in self._limits)

    def latch(self) -> None:
        """Sample what is measured."""
        for node in self.nodes.values():
            node.latch(self.values(self.syncs))

    def sync(self, at_ns: int) -> None:
        """Answer a SYNC, whosever it is."""
        self.moments.append(at_ns)
        self.syncs += 1
        for node in self.nodes.values():
            node.on_sync(self.values(self.syncs))
        self.answered.append(time.monotonic_ns())

    def sampled(self, values: NDArray[np.float64]) -> NDArray[np.int64]:
        """Find by which SYNC each of (n,) values was sampled, of those near; 0 for what is of none."""
        low, high = np.array(self._limits).T
        step = ((values - low) / (high - low) - 0.1) / 0.8 * COUNTED
        near = np.round(np.nan_to_num(step, nan=-1.0)).astype(np.int64)
        turns = self.syncs // COUNTED * COUNTED + near
        found = np.where(turns > self.syncs, turns - COUNTED, turns)
        good = (np.abs(step - near) <= 0.45) & (near >= 0) & (found > 0) & (found <= self.syncs)
        return np.where(good, found, 0)

    def master(self, identifier: int, data: bytes) -> None:
        """Send a frame of the other controller, which the nodes receive as well."""
        with self._lock:
            now = time.monotonic_ns()
            self.send(identifier, data)
            self._received(identifier, data, now)

    def _received(self, identifier: int, data: bytes, at_ns: int) -> None:
        if identifier == 0x080:
            self.sync(at_ns)
            return
        for node in self.nodes.values():
            if identifier == 0 or identifier == 0x600 + node.id:
                node.on_frame(identifier, data, time.monotonic())

    def run(self) -> None:
        """Run until it is ended."""
        due = time.monotonic()
        while not self.ended.is_set():
            message = self.bus.recv(0.002)
            with self._lock:
                if message is not None:
                    own = message.arbitration_id == 0x080
                    self._received(message.arbitration_id, bytes(message.data), self.ours.popleft() if own else 0)
                for node in self.nodes.values():
                    node.on_time(time.monotonic())
            if self.leads and time.monotonic() >= due:
                due = max(due + 0.02, time.monotonic() - 0.02)
                self.master(0x080, b"")
        self.bus.shutdown()


class _Counted(CanAccess):
    """Counts every frame that leaves the driver."""

    def __init__(self, world: _World) -> None:
        self.guest: Callable[[], bool] = lambda: False  # whether another master was detected
        self.sent = self.afterwards = 0
        self._world = world

    def attach(self, port: CanPort, config: CanBus) -> Any:
        bus = super().attach(port, config)
        send = bus.send

        def counted(message: can.Message, timeout: float | None = None) -> None:
            self.sent += 1
            self.afterwards += self.guest()
            if message.arbitration_id == 0x080:
                self._world.ours.append(time.monotonic_ns())
            send(message, timeout)

        bus.send = counted
        return bus


@dataclass
class Seen:
    """Outcome of one time of a row; None where it is not asked.

    Attributes
    ----------
    frames : of ours, after the other master's first was taken from the interface
    detected : s from that frame until it was taken
    wrong : values called fresh that are of no SYNC near, or whose age is wrong by more than :data:`AGE_S`
    marked : cycles that were not all fresh although the computer kept up
    excused : those with which it did not, of 60, and what followed from that
    recovery : s until all was fresh again
    unbalanced : channels of which produced is not stored + dropped
    failed : what did not happen as it should, in words
    """

    frames: int = 0
    detected: float | None = None
    wrong: int = 0
    marked: int | None = None
    excused: int = 0
    recovery: float | None = None
    unbalanced: int = 0
    failed: str = ""


class _Clock(RealClock):
    """Kept from running behind a tick for ``stall_s``, once."""

    stall_s = 0.0

    def wait(self) -> Tick:
        tick = super().wait()
        stall, self.stall_s = self.stall_s, 0.0
        time.sleep(stall)
        return tick


class _Started:
    """One start of acquisition on a bus of its own; ``prepare`` is done to the world before."""

    def __init__(self, prepare: Callable[[_World], None] = lambda world: None) -> None:
        declared, _ = default_machine()
        channel = uuid.uuid4().hex
        (bus,) = (bus for bus in declared.buses if isinstance(bus, CanopenBus))
        place = {"interface": "virtual", "channel": channel, "options": {}, "listen_s": LISTEN_S, "bitrate": None}
        bus = bus.model_copy(update=place)
        channels = tuple(c for c in declared.channels if isinstance(c.source, CanSource))
        self.machine = declared.model_copy(update={"channels": channels, "buses": (bus,), "simulation": None})
        self.world = _World(self.machine, channel)
        prepare(self.world)
        self.world.start()
        self.access = _Counted(self.world)
        events = EventLog()
        context = DriverContext(1 / self.machine.rate_hz, 0.0, time.monotonic_ns, events=events, can=self.access)
        self.driver = driver = CanopenDriver(bus, channels, context)
        self.access.guest = lambda: driver._leadership.state is State.GUEST
        self.clock = _Clock(self.machine.rate_hz, following=lambda: driver.next_sync if driver.external_sync else None)
        table = channel_table(self.machine)
        self.cycles = Cycles(self.machine, table, [driver], self.clock, events)
        self.cycles.assembler._frozen = None  # a ramp of numbers is no sensor
        self.ledger = Ledger(table.names)
        self.frames: list[Frame] = []
        self.excused: list[bool] = []  # of each frame, whether the computer did not keep up
        self.marked: list[bool] = []  # whether it did, and all the same not all values are fresh
        self._behind, self._late = 0, False
        self.wrong = 0

    def start(self) -> tuple[str, ...]:
        """Start acquisition; lines about what cannot be used."""
        try:
            return self.driver.start()
        finally:
            self.clock.start()

    def write(self, frame: Frame) -> None:
        """Write in the ring's place: inspect what came."""
        world, tick_ns, late_ns = self.world, self.clock._last, 0.1e9 / self.machine.rate_hz
        fresh = frame.quality == Quality.FRESH
        sampled = world.sampled(frame.values)
        # A guest that its master's SYNC does not lead yet counts from when a frame was on the bus.
        latest = world.answered if self.access.guest() else world.moments
        bounds = np.array([(world.moments[sync], latest[min(sync, len(latest) - 1)]) for sync in sampled]).T
        claimed = tick_ns - frame.ages * 1e9
        off = (claimed < bounds[0] - AGE_S * 1e9) | (claimed > bounds[1] + AGE_S * 1e9)
        self.wrong += int((fresh & ((sampled == 0) | off)).sum())
        answered = max(world.answered[-1] - world.moments[-1], world.answered[-2:][0] - world.moments[-2:][0])
        late = frame.monotonic_ns - tick_ns > late_ns or answered >= 4 * late_ns
        self._late = late
        if late or np.isin(frame.quality, (Quality.STALE, Quality.MISSING)).any():
            self._behind = BEHIND
        self.excused.append(self._behind > 0)
        self.marked.append(self._behind == 0 and not bool(fresh.all()))
        self._behind -= self._behind > 0
        self.frames.append(frame)
        stored = np.isfinite(frame.values) & ~np.isin(frame.quality, NOT_STORED)
        self.ledger.add(frame.quality[None, :], stored[None, :], np.array([FRAME], dtype=np.uint8))

    def once(self, count: int = 1) -> None:
        """Run the cycles."""
        for _ in range(count):
            self.cycles.once(self)  # type: ignore[arg-type]

    def until_fresh(self) -> float:
        """Time until the first of five cycles that were fresh on all channels, none between but by lateness, s."""
        began, first, good = time.monotonic(), 0.0, 0
        while good < 5 and time.monotonic() - began < PATIENCE_S:
            self.once()
            if bool(np.all(self.frames[-1].quality == Quality.FRESH)):
                good += 1
                first = time.monotonic() if good == 1 else first
            elif not self._late:
                good = 0
        return (first if good == 5 else time.monotonic()) - began

    def ended(self, seen: Seen) -> Seen:
        """Collect what was seen, with what every run is inspected for; end everything."""
        self.driver.stop()
        seen.wrong = self.wrong
        if self.frames:
            self.ledger.close(self.frames[0].cycle, self.frames[-1].cycle)
            skipped = self.frames[-1].cycle - self.frames[0].cycle + 1 - len(self.frames)
            for channel in self.ledger.channels.values():
                channel.dropped["acquisition: cycle skipped"] += skipped
                seen.unbalanced += not channel.balanced
        self.world.ended.set()
        self.world.join()
        return seen


def _sends(*frames: tuple[int, bytes], leads: bool = True) -> Callable[[_Started], None]:
    """Send frames of another master, which then leads by its SYNC or not."""

    def act(run: _Started) -> None:
        for identifier, data in frames:
            run.world.master(identifier, data)
        run.world.leads = leads

    return act


def _asks(run: _Started) -> None:
    _sends((0x600 + next(iter(run.world.nodes)), b"\x40\x00\x10\x00\0\0\0\0"))(run)


def _rebuilt(run: _Started) -> None:
    assert run.driver.port is not None
    run.driver.port.fail(can.CanOperationError("the interface was reset"))
    _sends((0x080, b""))(run)


def _led(act: Callable[[_Started], None], goes_on: bool) -> Row:
    """Lead while another master acts; see whether values come on by its SYNC."""

    def once(random: np.random.Generator) -> Seen:
        run, seen = _Started(), Seen()
        run.start()
        run.until_fresh()
        run.once(int(random.integers(1, 30)))
        time.sleep(float(random.uniform(0, 0.02)))
        act(run)
        began = time.monotonic()
        while not run.access.guest() and time.monotonic() - began < PATIENCE_S:
            run.once()
        seen.detected = time.monotonic() - began
        if goes_on:
            seen.recovery = run.until_fresh()
        run.once(60)
        seen.frames = run.access.afterwards
        return run.ended(seen)

    return once


def _there_before(act: Callable[[_World], None]) -> Row:
    """Start where another master is already."""

    def once(random: np.random.Generator) -> Seen:
        run, seen = _Started(act), Seen(failed="it was started all the same")
        with contextlib.suppress(BusError):
            run.start()
        if run.driver.failure:
            seen.failed = ""
        seen.frames = run.access.sent
        return run.ended(seen)

    return once


def _sends_sync(world: _World) -> None:
    world.leads = True


def _sends_events(world: _World) -> None:
    """Keep nodes operational with heartbeats, and nobody sends SYNC."""
    for node in world.nodes.values():
        node.set_data(0x1017, 0, b"\x64\0")
        node.on_nmt(0x01, time.monotonic())


def _clock(change: Callable[[_World], None], before: bool = False) -> Row:
    """Set the gateway's clock, or let it run otherwise from the start."""

    def once(random: np.random.Generator) -> Seen:
        run, seen = _Started(change if before else lambda world: None), Seen()
        run.start()
        run.until_fresh()
        run.once(int(random.integers(60, 100)))
        begun = len(run.frames)
        if not before:
            change(run.world)
        run.once(60)
        seen.marked, seen.excused = sum(run.marked[begun:]), sum(run.excused[begun:])
        seen.recovery = run.until_fresh()
        return run.ended(seen)

    return once


def _late_sync(random: np.random.Generator) -> Seen:
    """Keep us from running between the tick and our SYNC."""
    run, seen = _Started(), Seen()
    run.start()
    run.until_fresh()
    for _ in range(5):
        run.once(int(random.integers(1, 20)))
        run.clock.stall_s = float(random.uniform(0.002, 0.018))
        run.once(2)
    seen.recovery = run.until_fresh()
    return run.ended(seen)


def _node(change: Callable[[SimulatedNode], None]) -> Row:
    """Make one node unlike the others; it has to be commissioned, and to bring values, all the same."""

    def once(random: np.random.Generator) -> Seen:
        run, seen = _Started(lambda world: change(world.nodes[int(random.choice(list(world.nodes)))])), Seen()
        seen.failed = "; ".join(run.start())
        seen.recovery = run.until_fresh()
        run.once(60)
        return run.ended(seen)

    return once


def _without_heartbeat(node: SimulatedNode) -> None:
    del node.object_dictionary[0x1017]
    node._store.pop((0x1017, 0), None)


def _in_steps(node: SimulatedNode) -> None:
    taken = node.set_data

    def rounded(index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        taken(index, subindex, b"\x7d\0" if index == 0x1017 else data, check_writable)

    node.set_data = rounded  # type: ignore[method-assign]


ROWS: dict[str, Row] = {
    "another master powers up": _led(_sends((0x080, b"")), True),
    "another master starts nodes": _led(_sends((0x000, b"\x01\x00")), True),
    "another master resets nodes, no SYNC": _led(
        _sends((0x000, b"\x81\x00"), (0x000, b"\x01\x00"), leads=False), False
    ),
    "another SDO client": _led(_asks, True),
    "rebuilt while another master leads": _led(_rebuilt, False),
    "another master's SYNC before the start": _there_before(_sends_sync),
    "operational nodes without SYNC before the start": _there_before(_sends_events),
    **{f"stamps set by {step:+g} s": _clock(partial(_World.set_clock, by_s=step)) for step in STEPS_S},
    **{f"stamps slewed by {1e6 * rate:+g} ppm": _clock(partial(_World.set_clock, rate=rate)) for rate in (5e-4, -5e-4)},
    **{
        f"stamps off by {1e6 * rate:+g} ppm": _clock(partial(_World.set_clock, rate=rate), True)
        for rate in (1e-3, -1e-3)
    },
    "SYNC of ours sent late": _late_sync,
    "node without 0x1017": _node(_without_heartbeat),
    "node with a heartbeat of 125 ms": _node(_in_steps),
}
