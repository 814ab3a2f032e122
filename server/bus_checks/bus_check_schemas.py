"""What ``GET /machines/{name}/bus-check`` gives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pydantic import BaseModel

if TYPE_CHECKING:
    from daq.commissioning.check import ChannelCheck, DeviceCheck, MachineCheck
    from daq.commissioning.delays import BusDelay


class CheckedDevice(BaseModel):
    """A device: its state with a line that says more, what it says of itself, and where its values are.

    ``latency_ms`` is how long its answers take, ``jitter_ms`` their standard deviation, since acquisition started; null
    where only the age of values is known (a bus that is listened to).
    """

    bus: str
    device: str
    state: str
    detail: str
    identity: dict[str, str]
    mapping: str
    latency_ms: float | None
    jitter_ms: float | None

    @classmethod
    def of(cls, device: DeviceCheck) -> CheckedDevice:
        """From the check."""
        latency, jitter = (None, None) if device.latency_ms is None else device.latency_ms
        return cls(
            bus=device.bus, device=device.device, state=device.state, detail=device.detail, identity=device.identity,
            mapping=device.mapping, latency_ms=latency, jitter_ms=jitter,
        )  # fmt: skip


class CheckedChannel(BaseModel):
    """A channel at rest, in its ``unit``; null where nothing was measured.

    ``value`` and ``raw`` (as its device sent it) are means, ``noise`` the standard deviation of white noise, ``step``
    the smallest change that was seen (0: none was), ``drift`` a change per minute with its standard deviation, null
    where the channel ``moved``. ``share`` of the cycles brought a value, ``others`` counts what came instead.
    """

    name: str
    unit: str
    bus: str
    device: str
    value: float | None
    raw: float | None
    noise: float | None
    step: float | None
    drift: float | None
    drift_std: float | None
    moved: bool
    age_ms: float | None
    jitter_ms: float | None
    share: float
    others: dict[str, int]

    @classmethod
    def of(cls, channel: ChannelCheck) -> CheckedChannel:
        """From the check."""
        rest = channel.rest
        return cls(
            name=channel.name, unit=channel.unit, bus=channel.bus, device=channel.device, value=_known(rest.mean),
            raw=_known(channel.raw), noise=_known(rest.noise), step=_known(rest.step), drift=_known(rest.drift),
            drift_std=_known(rest.drift_std), moved=rest.moved, age_ms=_known(rest.age_ms),
            jitter_ms=_known(rest.jitter_ms), share=rest.share, others=rest.others,
        )  # fmt: skip


class DelayOfJoint(BaseModel):
    """What one joint's channels on both buses say: by their ``kind`` (``position`` or ``effort``), in ms."""

    joint: str
    kind: str
    delay_ms: float
    std_ms: float


class CheckedDelay(BaseModel):
    """By how much ``bus`` is behind ``reference`` (negative: ahead of it), with standard deviation, and who says so."""

    bus: str
    reference: str
    delay_ms: float
    std_ms: float
    told_by: list[DelayOfJoint]

    @classmethod
    def of(cls, delay: BusDelay) -> CheckedDelay:
        """From the check."""
        told_by = [
            DelayOfJoint(joint=pair.joint, kind=pair.kind, delay_ms=1e3 * pair.seconds, std_ms=1e3 * pair.std)
            for pair in delay.pairs
        ]
        return cls(
            bus=delay.bus, reference=delay.reference, delay_ms=1e3 * delay.seconds, std_ms=1e3 * delay.std,
            told_by=told_by,
        )  # fmt: skip


class BusCheck(BaseModel):
    """Every device and every channel of a machine; ``findings`` are lines about what is not as it should be.

    ``seconds`` of frames were looked at; ``cycles``, ``skipped`` (that never happened) and the slowest start of one are
    counted since acquisition started. ``delays`` between the buses are told by the frames of the last minute, if a
    joint that two of them see moved for 15 s of it; empty otherwise.
    """

    machine: str
    utc: str
    seconds: float
    rate_hz: float
    cycles: int
    skipped: int
    worst_late_ms: float
    devices: list[CheckedDevice]
    channels: list[CheckedChannel]
    delays: list[CheckedDelay]
    findings: list[str]
    notes: list[str]

    @classmethod
    def of(cls, check: MachineCheck) -> BusCheck:
        """From the check."""
        return cls(
            machine=check.machine, utc=check.utc, seconds=check.seconds, rate_hz=check.rate_hz, cycles=check.cycles,
            skipped=check.skipped, worst_late_ms=check.worst_late_ms,
            devices=[CheckedDevice.of(device) for device in check.devices],
            channels=[CheckedChannel.of(channel) for channel in check.channels],
            delays=[CheckedDelay.of(delay) for delay in check.delays],
            findings=list(check.findings), notes=list(check.notes),
        )  # fmt: skip


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
