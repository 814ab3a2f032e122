"""A CAN bus that is only listened to: nothing is ever sent, frames are taken as they come.

Our clock paces the cycle. What came since the last one is fresh, with its age from its own time stamp; older than one
and a half periods (the receive thread was kept from running) it is late. A frame that comes less often than the cycle
has a rate of its own: between two of them its channels are held.
"""

from __future__ import annotations

import statistics
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from daq.drivers.base import DeviceStatus, DriverContext, DriverStatistics, Problem, Samples, nothing
from daq.drivers.can.health import BusHealth, advice, told
from daq.drivers.can.port import CanConfig, CanPort
from daq.drivers.keeper import Keeper
from daq.errors import AcquisitionError
from daq.frames.clock import NS
from daq.quality import Quality

SILENT_S = 1.0  # without a frame that comes in every cycle; or three of its intervals
FIRST_S = 2.0  # that a frame is waited for at the start
LATE_PERIODS = 1.5
INTERVALS = 9  # of which the median is taken for a frame's own
INBOX = 256  # frames of one identifier that are kept until the cycle takes them


class Stream:
    """Frames that always carry the same channels: a PDO, a message, or one multiplexed part of it.

    Parameters
    ----------
    name : how lines call it
    device : name of the device that it is listed under
    positions : its channels, in the driver's order
    declared_ns : interval that its description promises, if any
    """

    def __init__(self, name: str, device: str, positions: Sequence[int], declared_ns: float | None = None) -> None:
        self.name = name
        self.device = device
        self.positions = tuple(positions)
        self.at_ns: int | None = None
        self.fault = ""  # what was wrong with its last frame
        self._declared_ns = declared_ns
        self._intervals: deque[int] = deque(maxlen=INTERVALS)
        self._median_ns: float | None = None

    def arrived(self, at_ns: int) -> None:
        """One of its frames was taken from the bus at ``at_ns``."""
        if self._declared_ns is None and self.at_ns is not None:
            self._intervals.append(at_ns - self.at_ns)
            self._median_ns = statistics.median(self._intervals)
        self.at_ns = at_ns

    @property
    def interval_ns(self) -> float:
        """Time between two of its frames, ns; 0 while it is not known."""
        return self._declared_ns or self._median_ns or 0.0


class Inbox:
    """Frames of one identifier between receive thread and cycle; ``keep`` of them, the newest."""

    def __init__(self, keep: int) -> None:
        self._frames: deque[tuple[bytes, int, int]] = deque(maxlen=keep)
        self.arrived = threading.Event()

    def receive(self, data: bytes | bytearray, at_ns: int, sender: int = 0) -> None:
        """In the receive thread."""
        self._frames.append((bytes(data), at_ns, sender))
        self.arrived.set()

    def taken(self) -> Iterator[tuple[bytes, int, int]]:
        """Data, time and sender of all that came, the oldest first."""
        self.arrived.clear()
        while self._frames:
            yield self._frames.popleft()


class Listener:
    """What drivers that only listen have in common (see :class:`daq.drivers.base.Driver`).

    A subclass fills ``streams`` and says how a port is made (:meth:`connected`) and what frames hold (:meth:`decode`).
    """

    leads = False

    def __init__(self, config: CanConfig, names: Sequence[str], context: DriverContext) -> None:
        self.config = config
        self.context = context
        self.streams: list[Stream] = []
        self.counts = dict.fromkeys(("missing", "late", "short", "not_a_number", "bus_rebuilt"), 0)
        self.health = BusHealth(told(config.name, context.events))
        self.cycle_ns = 0
        self._names = tuple(names)
        self._silent: set[str] = set()
        self._port: CanPort | None = None
        self._failure = ""
        self._keeper = Keeper(f"keeper-{config.name}", self._open, self._broke, context.monotonic_ns)

    def connected(self) -> CanPort:
        """A new port whose frames arrive; AcquisitionError if the bus cannot be opened."""
        raise NotImplementedError

    def decode(self, samples: Samples) -> None:
        """Take what came, and put it into the samples with :meth:`came` and :meth:`value`."""
        raise NotImplementedError

    def device_line(self, device: str) -> str:
        """What there is to say about a device whose frames come."""
        return ""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the samples."""
        return self._names

    def start(self) -> tuple[str, ...]:
        """Open the bus and wait a moment for every frame."""
        self._keeper.start()
        self._open()
        deadline = self.context.monotonic_ns() + round(min(FIRST_S, self.context.start_s or FIRST_S) * NS)
        scratch = nothing(len(self._names))
        while self._port is not None and self.context.monotonic_ns() < deadline:
            self.decode(scratch)
            left = (deadline - self.context.monotonic_ns()) / NS
            pause = max(0.0, min(self.context.period_s, left))
            if all(stream.at_ns is not None for stream in self.streams) or self._keeper.paused(pause):
                break
        if self._port is None:
            return (Problem(self._failure, self._names),)
        return tuple(
            Problem(
                f"bus '{self.config.name}': {stream.name} does not come; check the source, bitrate and cable",
                [self._names[position] for position in stream.positions],
            )
            for stream in self.streams
            if stream.at_ns is None
        )

    def _open(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()
            self.counts["bus_rebuilt"] += 1
        try:
            made = self.connected()
        except AcquisitionError as error:
            self._is_down(str(error))
            return
        self._failure = ""
        self.health.opened()
        self.context.events.end(self.config.name, "bus_down")
        self._port = made
        self._keeper.settled()

    def _broke(self, error: Exception) -> None:
        self._is_down(f"bus '{self.config.name}': opening it broke ({type(error).__name__}: {error})")

    def _is_down(self, line: str) -> None:
        self._failure = line
        self.context.events.begin(self.config.name, "bus_down", line)
        self._keeper.later()

    def trigger(self, cycle: int) -> None:
        """Nothing is sent."""
        self.cycle_ns = self.context.monotonic_ns()

    def collect(self, until_ns: int) -> Samples:
        """What came since the last cycle."""
        port = self._port
        if port is None or port.failure is not None:
            if port is not None and not self._failure:
                self._is_down(f"bus '{self.config.name}': {port.failure}; it is opened again")
            self._keeper.later()
            return nothing(len(self._names), Quality.BUS_ERROR)
        samples = replace(nothing(len(self._names)), interval=np.ones(len(self._names)))
        self.decode(samples)
        assert samples.interval is not None
        for stream in self.streams:
            every = stream.interval_ns / NS / self.context.period_s
            if stream.at_ns is not None and every > LATE_PERIODS:
                samples.interval[list(stream.positions)] = every
            elif all(samples.quality[position] == Quality.MISSING for position in stream.positions):
                self.counts["missing"] += 1
        self._look()
        return samples

    def came(self, stream: Stream, at_ns: int, samples: Samples) -> Quality:
        """A frame of a stream came: its age, and the quality of what it holds."""
        stream.arrived(at_ns)
        stream.fault = ""
        age_ns = max(0, self.cycle_ns - at_ns)
        late = self.context.patience_s == 0 and age_ns > LATE_PERIODS * self.context.period_s * NS
        self.counts["late"] += late
        for position in stream.positions:
            samples.after_sync_s[position] = -age_ns / NS
        return Quality.LATE if late else Quality.FRESH

    def value(self, position: int, value: float, quality: Quality, samples: Samples) -> None:
        """What a frame holds for a channel; NaN is no measurement."""
        if not np.isfinite(value):
            self.counts["not_a_number"] += 1
            quality, value = Quality.INVALID, np.nan
        samples.raw[position] = value
        samples.quality[position] = quality

    def _devices(self) -> list[str]:
        return list(dict.fromkeys(stream.device for stream in self.streams))

    def _look(self) -> None:
        for device in self._devices():
            silent = bool(self._lacking(device))
            name = f"{self.config.name}/{device}"
            if silent and device not in self._silent:
                self._silent.add(device)
                self.context.events.begin(name, "silent", self._line(device))
            elif device in self._silent and not silent:
                self._silent.discard(device)
                self.context.events.end(name, "silent")

    def _lacking(self, device: str) -> list[str]:
        """Names of the device's streams that do not come."""
        return [
            stream.name
            for stream in self.streams
            if stream.device == device
            and (stream.at_ns is None or self.cycle_ns - stream.at_ns > max(SILENT_S * NS, 3 * stream.interval_ns))
        ]

    def _line(self, device: str) -> str:
        if device in self._silent:
            lacking = ", ".join(self._lacking(device))
            return f"bus '{self.config.name}' {device}: {lacking} does not come; check its power, and who leads the bus"
        faults = [stream.fault for stream in self.streams if stream.device == device and stream.fault]
        return faults[0] if faults else self.device_line(device)

    def statistics(self) -> DriverStatistics:
        """State of every device that is listened to, and counters since the start."""
        port = self._port
        failure = self._failure or (port.failure if port is not None else "closed")
        devices = tuple(
            DeviceStatus(
                device,
                "failed" if failure else "silent" if device in self._silent else "running",
                failure or self._line(device),
            )
            for device in self._devices()
        )
        counts = dict(self.counts) | {"error_frames": self.health.error_frames}
        if port is not None:
            counts |= {"frames": port.frames, "extended_frames": port.extended, "unreadable_frames": port.broken}
            counts["lost_frames"] = port.lost
        return DriverStatistics(
            self.config.name,
            devices,
            counts,
            "down" if failure else self.health.state,
            failure or advice(self.config.name, self.health.state),
        )

    def stop(self) -> None:
        """Close the bus; nothing is sent."""
        self._keeper.stop()
        port, self._port = self._port, None
        if port is not None:
            port.close()
