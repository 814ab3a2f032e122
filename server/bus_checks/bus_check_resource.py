"""The resource ``bus_checks``: what the buses of an acquired machine bring, looked at when somebody asks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BeforeValidator

from daq.arrays import RowArray
from daq.machine.machine_file import CanopenBus, Machine
from daq.messages import Sentence, messages_in
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.errors import UnavailableError
from server.platform.http.bodies import Message, Shown, finite
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import Resource

if TYPE_CHECKING:
    from daq.acquisition.cycles import AcquisitionStatistics
    from daq.commissioning.can_questions import FoundNode
    from daq.commissioning.check import ChannelCheck, MachineCheck

LEAST_S = 2.0  # of frames, without which noise and drift say nothing


def _checked(acquisition: Acquisition, name: str, seconds: float, depressurised: bool) -> MachineCheck:
    """Check the last ``seconds`` of a machine, if so many; delays between its buses by the last minute.

    The acquisition goes on undisturbed.

    Raises
    ------
    ConflictError
        If it is not acquired.
    UnavailableError
        If its acquisition does not run at the moment, or has run for less than two seconds.
    """
    from daq.acquisition.ring import RingReader

    machine, feed = acquisition.feed(name)
    with RingReader(feed.ring_name, from_start=True) as ring:
        rows = ring.read().rows
    if len(rows) < LEAST_S * machine.rate_hz:
        raise UnavailableError("server.machine_been_acquired_less", name=name, least_s=LEAST_S)
    return check_running(machine, rows, feed.statistics(), seconds=seconds, depressurised=depressurised)


#: A measured number; null where none was.
Known = Annotated[float | None, BeforeValidator(finite)]


class CheckedDevice(Shown):
    """A device: its state with a line that says more, what it says of itself, and where its values are.

    ``latency_ms`` is how long its answers take, ``jitter_ms`` their standard deviation, since acquisition started; null
    where only the age of values is known (a bus that is listened to).
    """

    bus: str
    device: str
    state: str
    detail: str
    detail_message: Message | None = None
    identity: dict[str, str]
    mapping: str
    latency_ms: float | None
    jitter_ms: float | None


class CheckedChannel(Shown):
    """A channel at rest, in its ``unit``; null where nothing was measured.

    ``value`` and ``raw`` (as its device sent it) are means, ``noise`` the standard deviation of white noise, ``step``
    the smallest change that was seen (0: none was), ``drift`` a change per minute with its standard deviation, null
    where the channel ``moved``. ``share`` of the cycles brought a value, ``others`` counts what came instead.
    """

    name: str
    unit: str
    bus: str
    device: str
    value: Known
    raw: Known
    noise: Known
    step: Known
    drift: Known
    drift_std: Known
    moved: bool
    age_ms: Known
    jitter_ms: Known
    share: float
    others: dict[str, int]


class DelayOfJoint(Shown):
    """What one joint's channels on both buses say: by their ``kind`` (``position`` or ``effort``), in ms."""

    joint: str
    kind: str
    delay_ms: float
    std_ms: float


class CheckedDelay(Shown):
    """By how much ``bus`` is behind ``reference`` (negative: ahead of it), with standard deviation, and who says so."""

    bus: str
    reference: str
    delay_ms: float
    std_ms: float
    told_by: list[DelayOfJoint]


class BusCheck(Shown):
    """Every device and every channel of a machine; ``findings`` are lines about what is not as it should be.

    ``seconds`` of frames were looked at; ``cycles``, ``skipped`` (that never happened) and the slowest start of one are
    counted since acquisition started. ``delays`` between the buses are told by the frames of the last minute, if a
    joint that two of them see moved for 15 s of it; empty otherwise. ``messages``: what findings and notes were
    made of, by their text.
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
    messages: dict[str, Message]


def shown(check: MachineCheck) -> BusCheck:
    """Return what is shown of a check."""
    devices = [
        CheckedDevice.of(device, latency_ms=latency, jitter_ms=jitter)
        for device in check.devices
        for latency, jitter in [device.latency_ms or (None, None)]
    ]
    channels = [
        CheckedChannel.of(channel.rest, **_of_device(channel), value=channel.rest.mean) for channel in check.channels
    ]
    delays = [
        CheckedDelay.of(
            delay,
            delay_ms=1e3 * delay.seconds,
            std_ms=1e3 * delay.std,
            told_by=[DelayOfJoint.of(pair, delay_ms=1e3 * pair.seconds, std_ms=1e3 * pair.std) for pair in delay.pairs],
        )
        for delay in check.delays
    ]
    messages = messages_in([*check.findings, *check.notes])
    return BusCheck.of(check, devices=devices, channels=channels, delays=delays, messages=messages)


def _of_device(channel: ChannelCheck) -> dict[str, Any]:
    return {name: getattr(channel, name) for name in ("name", "unit", "bus", "device", "raw")}


def check_running(
    machine: Machine,
    rows: RowArray,
    statistics: AcquisitionStatistics,
    *,
    seconds: float = 20.0,
    depressurised: bool = False,
) -> MachineCheck:
    """Check a machine that is being acquired, by frames of it; nothing is sent, and nothing waits.

    Who devices are is what they answered the driver when they had been commissioned.

    Parameters
    ----------
    rows : (N,) frames, as the ring buffer has them; delays between buses come from all of them
    statistics : of the same acquisition, since its start
    seconds : the newest ones are those in which the machine rests
    depressurised : as in :func:`check_machine_buses`
    """
    from daq.commissioning.check import delays_of_frames, machine_check

    nodes = {
        (bus["bus"], node.node): node
        for bus in statistics.buses
        for device in bus["devices"]
        if (node := _node(device)) is not None
    }
    silent = [bus for bus in machine.buses if isinstance(bus, CanopenBus) and bus.listen_only]
    notes = [Sentence("server.bus_listen_only_no_device", bus=bus.name) for bus in silent]
    resting = rows[-max(1, round(seconds * machine.rate_hz)) :]
    found = machine_check(machine, resting, statistics, nodes, notes, depressurised=depressurised)
    return replace(found, delays=delays_of_frames(machine, rows))


def _node(device: Mapping[str, Any]) -> FoundNode | None:
    """Describe a node from its driver's requests; None for a device that was not asked."""
    from daq.commissioning.can_questions import described

    objects = device.get("objects") or {}
    kind, _, number = str(device["name"]).rpartition(" ")
    return described(int(number), objects) if kind == "node" and objects and number.isdigit() else None


router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)


@router.get("/{name}/bus-check", responses=problems(404, 409, 422, 503), dependencies=[require("read")])
async def bus_check(
    name: str,
    service: ServiceDep,
    principal: PrincipalDep,
    seconds: Annotated[float, Query(ge=2, le=50, description="Of the newest frames, at rest")] = 20.0,
    depressurised: Annotated[bool, Query(description="Pump off, lines open: pressures have to be zero")] = False,
) -> BusCheck:
    """Check the buses of an acquired machine by its newest frames: identity, mapping, latency, noise, zero, drift."""
    service[Machines].get(name)
    acquisition = service[Acquisition]
    return shown(await service.heavy.run(principal.id, _checked, acquisition, name, seconds, depressurised))


BUS_CHECKS = Resource(name="bus_checks", routers=(router,))
