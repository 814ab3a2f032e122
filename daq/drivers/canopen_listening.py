"""A CANopen bus that another master leads: nothing is ever sent, PDOs are taken as they come.

Our clock paces the cycle. What came since the last one is fresh, with its age from its own time stamp; nodes need
neither answer SYNC nor send a heartbeat, and their mapping is what the machine file says it is (``cob_id`` and ``byte``
of each channel). A PDO that is shorter than that is no value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from daq import wire
from daq.drivers.base import DeviceStatus, DriverContext, DriverStatistics, Problem, Samples, nothing
from daq.drivers.can_health import BusHealth, advice, told
from daq.drivers.canopen_link import CanLink, Handler
from daq.drivers.keeper import Keeper
from daq.errors import AcquisitionError, MachineFileError
from daq.machine_file import CanopenBus, CanSource, Channel
from daq.quality import Quality

NS = 1_000_000_000
SILENT_S = 1.0
FIRST_S = 2.0  # that a PDO is waited for at the start
EMERGENCY_ID = 0x080


@dataclass
class _Pdo:
    """One PDO that is listened to: its channels (position, source), and its newest frame (data, time, number)."""

    members: list[tuple[int, CanSource]] = field(default_factory=list)
    latest: tuple[bytes, int, int] | None = None
    taken: int = 0
    short: int = 0

    def receive(self, data: bytearray, at_ns: int) -> None:
        """In the receive thread."""
        number = 1 if self.latest is None else self.latest[2] + 1
        self.latest = (bytes(data), at_ns, number)


class ListeningDriver:
    """CANopen PDOs of a bus that is not ours (see :class:`daq.drivers.base.Driver`)."""

    leads = False

    def __init__(self, bus: CanopenBus, channels: Sequence[Channel], context: DriverContext) -> None:
        self._config = bus
        self._context = context
        self._names = tuple(channel.name for channel in channels)
        self._pdos: dict[int, _Pdo] = {}
        self._nodes: dict[int, set[int]] = {}
        for position, channel in enumerate(channels):
            source = channel.source
            assert isinstance(source, CanSource)
            if source.cob_id is None:
                raise MachineFileError(
                    f"bus '{bus.name}': is listen_only, so {channel.name} needs the PDO that carries it; add cob_id "
                    "and byte to its source"
                )
            self._pdos.setdefault(source.cob_id, _Pdo()).members.append((position, source))
            self._nodes.setdefault(source.node, set()).add(source.cob_id)
        self._emergencies: dict[int, int] = {}
        self._silent: set[int] = set()
        self._counts = dict.fromkeys(("missing", "short_pdo", "not_a_number", "emergency", "bus_rebuilt"), 0)
        self._health = BusHealth(told(bus.name, context.events))
        self._link: CanLink | None = None
        self._failure = ""
        self._sync_ns = 0
        self._keeper = Keeper(f"keeper-{bus.name}", self._open, lambda error: None, context.monotonic_ns)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the samples."""
        return self._names

    def start(self) -> tuple[str, ...]:
        """Open the bus and wait a moment for every PDO."""
        self._keeper.start()
        self._open()
        deadline = self._context.monotonic_ns() + round(min(FIRST_S, self._context.start_s or FIRST_S) * NS)
        while self._link is not None and any(pdo.latest is None for pdo in self._pdos.values()):
            if self._context.monotonic_ns() >= deadline or self._keeper.paused(self._context.period_s):
                break
        if self._link is None:
            return (Problem(self._failure, self._names),)
        return tuple(
            Problem(
                f"bus '{self._config.name}': PDO 0x{cob_id:03X} does not come; check cob_id, bitrate and cable",
                [self._names[position] for position, _ in pdo.members],
            )
            for cob_id, pdo in self._pdos.items()
            if pdo.latest is None
        )

    def _open(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()
            self._counts["bus_rebuilt"] += 1
        try:
            made = CanLink(self._config, self._context.monotonic_ns, self._health)
        except AcquisitionError as error:
            self._failure = str(error)
            self._context.events.begin(self._config.name, "bus_down", self._failure)
            self._keeper.later()
            return
        for cob_id, pdo in self._pdos.items():
            made.handlers[cob_id] = pdo.receive
        for node in self._nodes:
            made.handlers.setdefault(EMERGENCY_ID + node, self._on_emergency(node))
        self._failure = ""
        self._health.opened()
        self._context.events.end(self._config.name, "bus_down")
        self._link = made
        self._keeper.settled()

    def _on_emergency(self, node: int) -> Handler:
        def receive(data: bytearray, at_ns: int) -> None:
            code = int.from_bytes(data[:2], "little")
            if code & 0xFF00:
                self._emergencies[node] = code
                self._counts["emergency"] += 1
            else:
                self._emergencies.pop(node, None)

        return receive

    def trigger(self, cycle: int) -> None:
        """Nothing is sent."""
        self._sync_ns = self._context.monotonic_ns()

    def collect(self, until_ns: int) -> Samples:
        """What came since the last cycle."""
        link = self._link
        if link is None or link.failure is not None:
            if link is not None and not self._failure:
                self._failure = f"bus '{self._config.name}': {link.failure}; it is opened again"
                self._context.events.begin(self._config.name, "bus_down", self._failure)
            self._keeper.later()
            return nothing(len(self._names), Quality.BUS_ERROR)
        samples = nothing(len(self._names))
        for pdo in self._pdos.values():
            latest = pdo.latest
            if latest is None or latest[2] <= pdo.taken:
                self._counts["missing"] += 1
                continue
            pdo.taken = latest[2]
            for position, source in pdo.members:
                self._value(pdo, latest[0], position, source, samples)
                samples.after_sync_s[position] = min(0, latest[1] - self._sync_ns) / NS
        self._look()
        return samples

    def _value(self, pdo: _Pdo, data: bytes, position: int, source: CanSource, samples: Samples) -> None:
        end = source.byte + wire.size(source.data_type)
        if len(data) < end:
            self._counts["short_pdo"] += 1
            pdo.short = len(data)
            samples.quality[position] = Quality.INVALID
            return
        value = wire.decode(source.data_type, data[source.byte : end])
        if not np.isfinite(value):
            self._counts["not_a_number"] += 1
            samples.quality[position] = Quality.INVALID
            return
        samples.raw[position] = value
        samples.quality[position] = Quality.EMERGENCY if source.node in self._emergencies else Quality.FRESH

    def _look(self) -> None:
        for node in self._nodes:
            silent = self._sync_ns - self._heard_ns(node) > SILENT_S * NS
            name = f"{self._config.name}/node {node}"
            if silent and node not in self._silent:
                self._silent.add(node)
                self._context.events.begin(name, "silent", self._line(node))
            elif node in self._silent and not silent:
                self._silent.discard(node)
                self._context.events.end(name, "silent")

    def _heard_ns(self, node: int) -> int:
        """When the last of the node's PDOs came that comes least often."""
        latest = [self._pdos[cob_id].latest for cob_id in self._nodes[node]]
        return min(0 if frame is None else frame[1] for frame in latest)

    def _line(self, node: int) -> str:
        if node in self._silent:
            pdos = ", ".join(f"0x{cob_id:03X}" for cob_id in sorted(self._nodes[node]))
            return f"bus '{self._config.name}' node {node}: PDOs {pdos} do not come; check whether its master runs"
        short = [(cob_id, self._pdos[cob_id].short) for cob_id in self._nodes[node] if self._pdos[cob_id].short]
        if short:
            return (
                f"PDO 0x{short[0][0]:03X} has {short[0][1]} bytes, fewer than its channels need; check byte, data_type"
            )
        return f"emergency 0x{self._emergencies[node]:04X}" if node in self._emergencies else ""

    def statistics(self) -> DriverStatistics:
        """State of every node that is listened to, and counters since the start."""
        link = self._link
        failure = self._failure or (link.failure if link is not None else "closed")
        devices = tuple(
            DeviceStatus(
                f"node {node}",
                "failed" if failure else "silent" if node in self._silent else "running",
                failure or self._line(node),
            )
            for node in self._nodes
        )
        counts = dict(self._counts) | {"error_frames": self._health.error_frames}
        if link is not None:
            counts |= {"frames": link.frames, "extended_frames": link.extended, "unreadable_frames": link.broken}
        return DriverStatistics(
            self._config.name,
            devices,
            counts,
            "down" if failure else self._health.state,
            failure or advice(self._config.name, self._health.state),
        )

    def stop(self) -> None:
        """Close the bus; nothing is sent."""
        self._keeper.stop()
        link, self._link = self._link, None
        if link is not None:
            link.close()
