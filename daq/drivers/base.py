"""Contract of drivers. Adding one: a file, its bus in :mod:`daq.machine.buses`, a call of the conformance check.

A driver serves one bus of the machine file. Every cycle goes::

    trigger(cycle)        send SYNC, or start polling; returns at once
    collect(until_ns)     wait until everything that is due has come, at most until then; never raises

Drivers that send SYNC (``leads``) are triggered before the others, so that polled devices are asked after SYNC.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from daq.arrays import FlagArray, FloatArray, IntArray
from daq.drivers.found_setups import FoundSetups
from daq.errors import MachineFileError
from daq.frames.events import EventLog
from daq.machine.buses import BUSES
from daq.machine.machine_file import Channel
from daq.quality import Quality
from daq.seams import DRIVERS

if TYPE_CHECKING:
    from daq.drivers.can.port import CanAccess


@dataclass(frozen=True)
class DriverContext:
    """The cycle that a driver works in.

    Attributes
    ----------
    period_s : wall seconds between two cycles
    patience_s : least time to wait for a device that was alive just now: 0 on a machine, where late answers are no use;
        long in lockstep with a simulation, where waiting loses nothing
    monotonic_ns : the clock
    start_s : how long :meth:`Driver.start` may wait for devices that do not answer; those that come later are taken in
        while the cycle runs. A bus may be listened to for two seconds besides. None: as long as the machine file says
        that they may take to boot, and that the bus is to be listened to.
    events : where drivers say what happened to their devices
    rate_hz : cycles per second of machine time, 1 / period_s unless a simulation runs faster (None: that)
    found : where it is kept what nodes were like before they were changed; None: it is not kept
    can : how CAN buses are opened; None: by their interfaces. A trace and a replay bring their own.
    """

    period_s: float
    patience_s: float
    monotonic_ns: Callable[[], int]
    start_s: float | None = None
    events: EventLog = field(default_factory=EventLog)
    rate_hz: float | None = None
    found: FoundSetups | None = None
    can: CanAccess | None = None

    def at_start(self, usual_s: float) -> float:
        """Return the seconds that a start waits for what usually takes ``usual_s`` at most."""
        return usual_s if self.start_s is None else min(usual_s, self.start_s)

    @property
    def late_ns(self) -> float:
        """Longest time from SYNC to an answer, ns: half a period; in lockstep no time passes, so nothing is late."""
        return math.inf if self.patience_s > 0 else 0.5e9 * self.period_s


class Problem(str):
    """A ``line`` about something that cannot be acquired, and the channels that it costs."""

    line: str
    channels: tuple[str, ...]

    def __new__(cls, line: str, channels: Sequence[str] = ()) -> Problem:
        """Make the line; ``channels`` are names."""
        made = super().__new__(cls, line)
        made.line, made.channels = line, tuple(channels)
        return made


@dataclass(frozen=True)
class Samples:
    """Result of one cycle, for the ``n`` channels of a driver in its order.

    Attributes
    ----------
    raw : (n,) as the device sent it, before scale and offset; NaN where nothing new came
    quality : (n,) FRESH where something came in time; LATE where it came too late for that; MISSING where nothing did;
        INVALID where what came was no number, or may be another device's; EMERGENCY where the device reports an error
        (raw may be there or not); BUS_ERROR where the bus is down
    cycles_ago : (n,) cycles since the SYNC that the value belongs to: 0, or more for an answer that was late
    after_sync_s : (n,) wall seconds from the SYNC that the value belongs to until it was sampled; 0 for what is sampled
        at SYNC
    interval : (n,) cycles between two answers of a device that has a rate of its own; 1 where every cycle brings one
    plain : whether all of it is fresh, finite and sampled at this cycle's SYNC, as nearly always; then the other arrays
        hold zeros, and need not be looked at
    from_tick : whether ``after_sync_s`` counts from the tick's own moment, as where another master's SYNC is the tick,
        and not from when the driver was triggered
    """

    raw: FloatArray
    quality: FlagArray
    cycles_ago: IntArray
    after_sync_s: FloatArray
    interval: FloatArray | None = None
    plain: bool = False
    from_tick: bool = False


class Answers:
    """Samples of a cycle while they are put together: lists, which take single values much faster than arrays do.

    Attributes
    ----------
    raw, quality, cycles_ago, after_sync_s, interval : as in :class:`Samples`; nothing came yet
    no_numbers : values that came and were none
    """

    def __init__(self, count: int, quality: Quality = Quality.MISSING) -> None:
        self.raw: list[float] = [math.nan] * count
        self.quality: list[int] = [quality] * count
        self.cycles_ago = [0] * count
        self.after_sync_s = [0.0] * count
        self.interval = [1.0] * count
        self.no_numbers = 0

    def value(self, position: int, value: float, quality: Quality) -> None:
        """Take a channel's value; what is no number, or invalid for another reason, is no measurement."""
        if quality != Quality.INVALID and not math.isfinite(value):
            self.no_numbers += 1
            quality = Quality.INVALID
        self.raw[position] = math.nan if quality == Quality.INVALID else value
        self.quality[position] = quality

    def samples(self, *, from_tick: bool = False) -> Samples:
        """Return the samples."""
        return Samples(
            np.array(self.raw, dtype=np.float64),
            np.array(self.quality, dtype=np.uint8),
            np.array(self.cycles_ago, dtype=np.int64),
            np.array(self.after_sync_s, dtype=np.float64),
            np.array(self.interval, dtype=np.float64),
            from_tick=from_tick,
        )


def nothing(count: int, quality: Quality = Quality.MISSING) -> Samples:
    """Return samples of a cycle in which nothing came."""
    return Answers(count, quality).samples()


class Spread:
    """Mean and standard deviation of times that are added one by one, ns in, ms out."""

    __slots__ = ("count", "squares", "total")

    def __init__(self) -> None:
        self.count, self.total, self.squares = 0, 0.0, 0.0

    def add(self, ns: float) -> None:
        """Add one more."""
        self.count += 1
        self.total += ns
        self.squares += ns * ns

    def mean_std(self) -> tuple[float, float] | None:
        """Return mean and deviation; None before the second one."""
        if self.count < 2:
            return None
        mean = self.total / self.count
        return mean / 1e6, math.sqrt(max(0.0, self.squares / self.count - mean * mean)) / 1e6


@dataclass(frozen=True)
class DeviceStatus:
    """State of one device: ``running``, ``commissioning``, ``silent`` or ``failed``, with a line that says more.

    The line of a device that is back says why it was away and for how long. ``latency_ms`` is how long its answers took
    since the start (CANopen: after SYNC; Modbus: after the question) and their standard deviation, where that is known.
    ``objects`` is what it said of itself when it was asked (CANopen: ``0x1018:4`` and so on; Modbus: ``vendor``,
    ``product``, ``revision``); empty where nobody asked.
    """

    name: str
    state: str
    detail: str = ""
    latency_ms: tuple[float, float] | None = None
    objects: Mapping[str, int | str] = field(default_factory=dict)


@dataclass(frozen=True)
class DriverStatistics:
    """Devices of a bus and what happened on it since the start, by name of the event.

    ``state`` is that of the bus: ``active``, ``warning`` or ``passive`` (error counters of a CAN controller above their
    limits), ``bus_off`` or ``down``, with a line in ``detail`` where it is not active.
    """

    bus: str
    devices: tuple[DeviceStatus, ...]
    counts: Mapping[str, int] = field(default_factory=dict)
    state: str = "active"
    detail: str = ""


class Driver(Protocol):
    """A bus driver; made by its class as ``(bus, channels, context)``, where ``bus`` is an entry of ``buses:``."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that it delivers, in the order of its samples."""

    @property
    def leads(self) -> bool:
        """True where it sends SYNC and therefore has to be triggered first."""

    def start(self) -> tuple[str, ...]:
        """Open the bus and commission its devices, waiting no longer than ``context.start_s`` for all of them.

        Returns
        -------
        tuple of str
            One line (:class:`Problem`) per device, or per bus, that cannot be used now: which, why, what to do. The
            others run, and what cannot be used is tried again while the cycle goes on.
        """

    def trigger(self, cycle: int) -> None:
        """Start a cycle; does not wait and does not raise.

        Parameters
        ----------
        cycle : its number, rising
        """

    def collect(self, until_ns: int) -> Samples:
        """Wait until all that is due came, or the time is over; does not raise.

        Parameters
        ----------
        until_ns : reading of the monotonic clock at which it returns with what there is
        """

    def statistics(self) -> DriverStatistics:
        """Return the state of the devices and counters."""

    def stop(self) -> None:
        """Leave the devices quiet and close the bus; a second call does nothing."""


def by_device(channels: Sequence[Channel], number: Callable[[Any], int]) -> dict[int, list[tuple[int, Channel]]]:
    """Group a bus's channels, each with its position, by the number of their source's device."""
    found: dict[int, list[tuple[int, Channel]]] = {}
    for position, channel in enumerate(channels):
        found.setdefault(number(channel.source), []).append((position, channel))
    return found


def make_driver(bus: Any, channels: Sequence[Channel], context: DriverContext) -> Driver:
    """Make the driver for an entry of ``buses:``, of ``BUSES`` or of another package's entry point for its type."""
    own = {kind.tag: kind.driver for kind in BUSES}
    if bus.type in own:
        kind = resolve_name(own[bus.type])
    elif bus.type in (others := DRIVERS.names()):
        kind = DRIVERS.load(bus.type)
    else:
        names = ", ".join(sorted({*own, *others}))
        raise MachineFileError("daq.bus_no_driver_type", bus=bus.name, type=bus.type, names=names)
    made: Driver = kind(bus, channels, context)
    return made
