"""``hilfit bus check``: every device of a machine, and every channel, before anything is recorded.

Nodes of a bus that hilfit may lead are asked who they are, then the machine is acquired for some seconds. What the
machine file says is compared with what the devices say and do.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.cycles import AcquisitionStatistics
from daq.acquisition.ring import RingReader
from daq.arrays import RowArray
from daq.commissioning.can_questions import FoundNode
from daq.commissioning.identities import identity_findings, mapping_of, scale_finding
from daq.commissioning.rest import AtRest, at_rest
from daq.console import ShowProgress
from daq.machine.machine_file import CanopenBus, CanSource, Channel, Machine, ModbusSource
from daq.messages import Sentence, named
from daq.quality import MEASURED

if TYPE_CHECKING:
    from daq.commissioning.delays import BusDelay

SECONDS = 20.0
NOISY = 3.0  # times the declared noise
LEAST_SHARE = 0.99  # of the cycles that have to bring a value
DRIFTS = 4.0  # standard deviations
ZERO = 0.01  # of a pressure's range that a sensor without pressure may show
PRESSURES = ("head_pressure", "rod_pressure", "supply_pressure", "tank_pressure")


@dataclass(frozen=True)
class DeviceCheck:
    """One device: where it is, what it is, how it does.

    Attributes
    ----------
    identity : what it says of itself, by name; empty where it was not asked
    mapping : where its values come from
    latency_ms : mean and deviation of how long its answers take; None where only their age is known
    """

    bus: str
    device: str
    state: str
    detail: str
    identity: dict[str, str]
    mapping: str
    latency_ms: tuple[float, float] | None


@dataclass(frozen=True)
class ChannelCheck:
    """One channel, in its unit; ``raw`` is what its device sent, on average."""

    name: str
    unit: str
    bus: str
    device: str
    rest: AtRest
    raw: float


@dataclass(frozen=True)
class MachineCheck:
    """Result of ``hilfit bus check``; ``findings`` are lines about what is not as it should be."""

    machine: str
    utc: str
    seconds: float
    rate_hz: float
    cycles: int
    skipped: int
    worst_late_ms: float
    devices: tuple[DeviceCheck, ...]
    channels: tuple[ChannelCheck, ...]
    delays: tuple[BusDelay, ...]
    findings: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())


def check_machine_buses(
    machine: Machine, *, seconds: float = SECONDS, depressurised: bool = False, progress: ShowProgress | None = None
) -> MachineCheck:
    """Check every device of a machine that nobody acquires from now.

    Parameters
    ----------
    seconds : of machine time that it is acquired for
    depressurised : the pump is off and the lines are open: pressures have to be zero

    Raises
    ------
    AcquisitionError
        If a bus cannot be opened, or another master leads one that is not ``listen_only``.
    """
    show = progress or (lambda done, total, text=None: None)
    show(0, seconds, "who is there")
    nodes, notes = _asked(machine)
    rows, statistics = _acquired(machine, seconds, show)
    found = machine_check(machine, rows, statistics, nodes, notes, depressurised=depressurised)
    delays = delays_of_frames(machine, rows)
    if len({c.bus for c in found.channels}) > 1 and not delays:
        note = Sentence("daq.delays_between_buses_not")
        return replace(found, notes=(*found.notes, note))
    return replace(found, delays=delays)


def delays_of_frames(machine: Machine, rows: RowArray) -> tuple[BusDelay, ...]:
    """Estimate delays between the buses from frames (N,) of a motion; cycles that were skipped are gaps."""
    from daq.commissioning.delays import bus_delays

    if not len(rows):
        return ()
    cycles = (rows["cycle"] - rows["cycle"][0]).astype(np.int64)
    values = np.full((int(cycles[-1]) + 1, len(machine.channels)), np.nan)
    good = np.isin(rows["quality"], [int(quality) for quality in MEASURED])
    values[cycles] = np.where(good, rows["values"], np.nan)
    by_name = {channel.name: values[:, index] for index, channel in enumerate(machine.channels)}
    return tuple(bus_delays(machine, by_name, machine.rate_hz))


def machine_check(
    machine: Machine,
    rows: RowArray,
    statistics: AcquisitionStatistics,
    nodes: Mapping[tuple[str, int], FoundNode],
    notes: Sequence[str],
    *,
    depressurised: bool,
) -> MachineCheck:
    """Check a machine by its frames, statistics and its nodes' own objects (by bus and node-ID)."""
    notes = list(notes)
    channels = tuple(_channel(machine, index, channel, rows) for index, channel in enumerate(machine.channels))
    devices = tuple(_devices(machine, statistics, nodes))
    findings: list[str] = [
        named(f"{device.bus} {device.device}", device.detail) for device in devices if device.state != "running"
    ]
    findings += [line for (bus, _), node in nodes.items() for line in identity_findings(machine, bus, node)]
    for channel, checked in zip(machine.channels, channels, strict=True):
        findings += _of_channel(channel, checked, depressurised)
        node = nodes.get((checked.bus, channel.source.node)) if isinstance(channel.source, CanSource) else None
        finding = None if node is None else scale_finding(machine, channel, node)
        findings += [finding] if finding else []
    moving = [checked.name for checked in channels if checked.rest.moved]
    if moving:
        more = ", ..." if len(moving) > 4 else ""
        notes.append(
            Sentence(
                "daq.not_rest_channels_move",
                count=len(moving),
                count_2=len(channels),
                moving=moving[:4],
                more=more,
            )
        )
    return MachineCheck(
        machine.name, datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), len(rows) / machine.rate_hz, machine.rate_hz,
        statistics.cycles,
        statistics.skipped, statistics.worst_late_ms, devices, channels, (),
        tuple(dict.fromkeys(findings)), tuple(notes),
    )  # fmt: skip


def _asked(machine: Machine) -> tuple[dict[tuple[str, int], FoundNode], list[str]]:
    """Ask nodes for their identity, by bus and node-ID."""
    from daq.commissioning.can_scan import scan_can

    found: dict[tuple[str, int], FoundNode] = {}
    notes: list[str] = []
    for bus in machine.buses:
        if not isinstance(bus, CanopenBus):
            continue
        sources = [c.source for c in machine.channels if isinstance(c.source, CanSource)]
        wanted = sorted({source.node for source in sources if source.bus == bus.name})
        if bus.listen_only:
            notes.append(Sentence("daq.bus_listen_only_no_device", bus=bus.name))
            continue
        scanned = scan_can(bus, seconds=bus.listen_s, ask=True, nodes=wanted)
        notes += scanned.notes
        found |= {(bus.name, node.node): node for node in scanned.nodes}
    return found, notes


def _acquired(machine: Machine, seconds: float, show: ShowProgress) -> tuple[RowArray, AcquisitionStatistics]:
    parts = []
    with (
        AcquisitionProcess(machine, strict=False) as acquisition,
        RingReader(acquisition.ring_name, from_start=True) as ring,
    ):
        count, wanted = 0, max(1, round(seconds * machine.rate_hz))
        while count < wanted:
            acquisition.check()
            ring.wait(0.5)
            parts.append(ring.read().rows)
            count += len(parts[-1])
            show(min(seconds, count / machine.rate_hz), seconds, "at rest")
        time.sleep(0.6)  # statistics are published twice a second
        statistics = acquisition.statistics()
    return np.concatenate(parts)[:wanted], statistics


def _channel(machine: Machine, index: int, channel: Channel, rows: RowArray) -> ChannelCheck:
    values = machine.conversion(channel).from_si(rows["values"][:, index])
    rest = at_rest(rows["time"], values, rows["ages"][:, index], rows["quality"][:, index])
    source = channel.source
    assert source is not None
    raw = (rest.mean - source.offset) / source.scale
    if isinstance(source, CanSource | ModbusSource):
        raw = raw * 10.0**source.decimals + source.zero
        raw = raw % source.modulo if source.modulo is not None else raw
    return ChannelCheck(channel.name, channel.unit, source.bus, source.device, rest, raw)


def _devices(
    machine: Machine, statistics: AcquisitionStatistics, nodes: Mapping[tuple[str, int], FoundNode]
) -> list[DeviceCheck]:
    found = []
    for bus in statistics.buses:
        for device in bus["devices"]:
            number = device["name"].rpartition(" ")[2]
            node = nodes.get((bus["bus"], int(number))) if number.isdigit() else None
            latency = device.get("latency_ms")
            found.append(
                DeviceCheck(
                    bus["bus"],
                    device["name"],
                    device["state"],
                    device["detail"],
                    _identity(node) if node is not None else _unit_identity(device.get("objects") or {}),
                    mapping_of(machine, bus["bus"], device["name"]),
                    None if latency is None else tuple(latency),
                )
            )
    return found


def _unit_identity(identity: Mapping[str, str | int]) -> dict[str, str]:
    """Return a Modbus unit's identity, by the words of its device identification."""
    words = {"device": identity.get("product") or identity.get("vendor"), "firmware": identity.get("revision")}
    return {name: str(word) for name, word in (words | {"vendor": identity.get("vendor")}).items() if word}


def _identity(node: FoundNode) -> dict[str, str]:
    numbers = {"vendor": node.vendor_id, "product": node.product_code, "serial number": node.serial_number}
    words: dict[str, str | None] = {"device": node.name, "profile": node.profile, "firmware": node.firmware}
    known = {key: value for key, value in words.items() if value}
    return known | {key: f"0x{value:08X}" for key, value in numbers.items() if value is not None}


# Channels


def _of_channel(channel: Channel, checked: ChannelCheck, depressurised: bool) -> Iterator[str]:
    """Make the lines about one channel."""
    rest, name, unit = checked.rest, channel.name, channel.unit
    others = [Sentence("daq.count_of", count=count, what=what) for what, count in rest.others.items()]
    if math.isnan(rest.mean):
        yield Sentence("daq.values_came", name=name, values=rest.values, others=others or Sentence("daq.nothing_else"))
        return
    if rest.share < LEAST_SHARE:
        yield Sentence("daq.cycles_brought_value", name=name, share=100 * rest.share, others=others)
    if channel.noise_std and rest.noise <= 0:
        yield Sentence("daq.not_change_once_although", name=name, noise_std=channel.noise_std, unit=unit)
    declared = math.hypot(channel.noise_std or 0.0, (channel.resolution or 0.0) / math.sqrt(12.0))
    if channel.noise_std and rest.noise > NOISY * declared:
        noise, times = rest.noise, rest.noise / declared
        yield Sentence("daq.noise_times_noise_std_resolution", name=name, noise=noise, unit=unit, noise_2=times)
    if channel.range is not None and not channel.range[0] < rest.mean < channel.range[1]:
        yield Sentence("daq.outside_range", name=name, mean=rest.mean, unit=unit, range=list(channel.range))
    if not (rest.moved or math.isnan(rest.drift)) and abs(rest.drift) > max(DRIFTS * rest.drift_std, rest.noise):
        yield Sentence("daq.drifts_minute", name=name, drift=rest.drift, drift_std=rest.drift_std, unit=unit)
    span = 0.0 if channel.range is None else channel.range[1] - channel.range[0]
    zero_due = depressurised and channel.quantity in PRESSURES
    if zero_due and channel.source is not None and abs(rest.mean) > ZERO * span > 0:
        offset = channel.source.offset - rest.mean
        yield Sentence("daq.shows_without_pressure", name=name, mean=rest.mean, unit=unit, offset=offset)


def check_page(check: MachineCheck) -> str:
    """Write the check as one page to print: a self-contained HTML file."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template("check_page.html.j2").render(check=check, number=number)


def number(value: float, digits: int = 4) -> str:
    """Format a number with so many digits; empty where there is none."""
    return "" if math.isnan(value) else f"{value:.{digits}g}"
