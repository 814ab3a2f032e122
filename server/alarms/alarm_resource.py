"""The resource ``alarms``: what is wrong now, and who has seen it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any, Literal

import structlog
from fastapi import APIRouter, Response
from prometheus_client.core import GaugeMetricFamily, Metric
from pydantic import Field

from daq import Quality
from daq.errors import HilfitError
from daq.messages import Sentence
from daq.quality import MEASURED
from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_lifecycle import LONGEST_SHELF_S, Alarm, DeadBand, beyond, tag
from server.machines.acquisition import Acquisition
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.database.engine import Database
from server.platform.files import RESERVE_BYTES, Free
from server.platform.http.bodies import PLAIN, Body, Listed
from server.platform.http.route_parameters import KnownTags, MachineQuery, PageDep, ServiceDep, problems
from server.platform.processes.rounds import Rounds
from server.platform.resource import TROUBLES, Parts, Phase, Resource, Running
from server.platform.service import Service
from server.recordings.recording_resource import FREE
from server.recordings.recording_sessions import Sessions

LOOK_S = 1.0
DAMAGE_LOOK_S = 86_400.0
#: Free bytes above the reserve at which the alarm comes and goes.
WARNING = DeadBand(comes=768 * 2**20, goes=1024 * 2**20)
#: Seconds by which the wall's clock may run away from the monotonic one between two looks.
JUMP_S = 2.0
#: Also a value of an earlier cycle, and that of a device which owes none in this one.
_MEASURED = frozenset(quality.name.lower() for quality in (*MEASURED, Quality.LATE, Quality.HELD))
_log = structlog.stdlib.get_logger(__name__)


def stale_channels(frame: dict[str, Any]) -> tuple[str, ...]:
    """List channels of a frame that hold no measurement of its cycle, nor of the one before."""
    return tuple(name for name, channel in frame["channels"].items() if channel["quality"] not in _MEASURED)


def named(names: Iterable[str], most: int = 3) -> str:
    """Name the first few, and how many more."""
    found = list(names)
    if len(found) <= most:
        return ", ".join(found)
    return Sentence("server.and_others", names=found[:most], count=len(found) - most)


@dataclass(eq=False)
class Watch:
    """The thread that looks at acquisition, channels, disk and clock once a second, and ends recordings in time.

    Attributes
    ----------
    free : free bytes now
    troubles : see :data:`server.platform.resource.TROUBLES`
    look_for_damage : looks through the store; daily
    end_recordings : lets all that is being recorded be sealed, without waiting for it
    wall, monotonic : s, the two clocks
    """

    watched: Acquisition
    alarms: Alarms
    free: Free
    end_recordings: Callable[[], None]
    troubles: Mapping[str, str] = field(default_factory=dict)
    look_for_damage: Callable[[], None] = lambda: None
    _: KW_ONLY
    wall: Callable[[], float] = time.time
    monotonic: Callable[[], float] = time.monotonic

    def __post_init__(self) -> None:
        self._looked = self.monotonic()
        self._difference = self.wall() - self.monotonic()
        self._low = False
        self.rounds = Rounds("alarms", LOOK_S, self._look)

    def _look(self) -> None:
        for look in (self.disk, self.acquisitions, self.clock, self.service, self.alarms.sweep):
            try:
                look()
            except Exception as error:  # a database that is locked now will not be at the next look
                _log.error("alarm_look_failed", look=look.__name__, exc_info=error)

    def disk(self) -> None:
        """Alarm when space gets short; end recordings before the database has none."""
        free = self.free()
        left = free - RESERVE_BYTES
        self._low = beyond(left, WARNING, self._low)
        if left <= 0:
            self.end_recordings()
        # The text holds no number that moves: each new text would be a revision.
        text = Sentence("server.little_disk_free", reserve_bytes=RESERVE_BYTES // 2**20)
        if left <= 0:
            text = Sentence("server.disk_is_full", reserve_bytes=RESERVE_BYTES // 2**20)
        self.alarms.report(None, "disk_full", text, "critical" if left <= 0 else "warning", self._low)

    def acquisitions(self) -> None:
        """Alarm when a machine's acquisition is down, or a channel of it silent."""
        names = self.watched.names()
        for name in names:
            statistics = self.watched.statistics(name)
            down = statistics["state"] != "running"
            text = Sentence(
                "server.acquisition_does_not_run", why=statistics["error"] or Sentence("server.being_started")
            )
            self.alarms.report(name, "acquisition_down", text, "critical", down)
            stale: tuple[str, ...] = ()
            if not down:
                try:
                    stale = stale_channels(self.watched.latest(name))
                except HilfitError:  # it ended between the two looks
                    continue
            text = Sentence("server.no_measurement_from", channels=named(stale))
            self.alarms.report(name, "channel_stale", text, "warning", bool(stale))
        for alarm in self.alarms.active():
            if alarm.kind in ("acquisition_down", "channel_stale") and alarm.machine not in names:
                self.alarms.report(alarm.machine, alarm.kind, "", "info", False)

    def clock(self) -> None:
        """Alarm when the wall's clock was set: times of recordings before and after do not go together."""
        difference = self.wall() - self.monotonic()
        jump = difference - self._difference
        self._difference = difference
        if abs(jump) >= JUMP_S:
            text = Sentence("server.clock_was_set", seconds=jump)
            self.alarms.report(None, "clock_jumped", text, "info", True)
            self.alarms.report(None, "clock_jumped", text, "info", False)

    def service(self) -> None:
        """Alarm on what is wrong with the service itself; look through the store once a day."""
        if self.monotonic() - self._looked >= DAMAGE_LOOK_S:
            self._looked = self.monotonic()
            self.look_for_damage()
        for kind in ("store_damaged", "audit_cut", "backup_failed"):
            self.alarms.report(None, kind, self.troubles.get(kind, ""), "critical", kind in self.troubles)


class AlarmResource(Alarm):
    """An alarm: ``raised`` is when it came last, ``count`` how often before somebody acknowledged it."""


class AlarmList(Listed[AlarmResource]):
    """A page of alarms."""


class Shelf(Body, json_schema_extra={"examples": [{"seconds": 28800, "reason": "the sensor is replaced"}]}):
    """How long an alarm is to be quiet, and why."""

    seconds: Annotated[float, Field(gt=0, le=LONGEST_SHELF_S)]
    reason: Annotated[str, Field(min_length=1, max_length=200, pattern=PLAIN)]


router = APIRouter(prefix="/alarms", tags=["alarms"], route_class=TypedRoute)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_alarms(
    service: ServiceDep, page: PageDep, machine: MachineQuery = None, state: Literal["active", "cleared"] | None = None
) -> AlarmList:
    """List alarms, newest first; one of the service as a whole has no machine; ``label`` is looked for in the text."""
    return AlarmList.of(service[Alarms].list(**page, machine=machine, state=state))


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, response: Response, service: ServiceDep) -> AlarmResource:
    """Read an alarm; its ``ETag`` is for changing it."""
    return _tagged(service[Alarms].get(id), response)


@router.post("/{id}/acknowledge", responses=problems(404, 412, 422), dependencies=[require("operate")])
def acknowledge(
    id: str, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> AlarmResource:
    """Note that somebody has seen it; the first who does so remains named."""
    return _tagged(service[Alarms].acknowledge(id, principal.name, tags), response)


@router.post("/{id}/shelve", responses=problems(404, 412, 422), dependencies=[require("operate")])
def shelve(
    id: str, shelf: Shelf, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> AlarmResource:
    """Keep an alarm quiet for a while: it is tracked, but nobody is to be called."""
    changed = service[Alarms].shelve(id, principal.name, shelf.reason, shelf.seconds, tags)
    return _tagged(changed, response)


@router.post("/{id}/unshelve", responses=problems(404, 412, 422), dependencies=[require("operate")])
def unshelve(id: str, response: Response, service: ServiceDep, tags: KnownTags) -> AlarmResource:
    """End an alarm's shelf, so that it shows again."""
    return _tagged(service[Alarms].unshelve(id, tags), response)


def _tagged(alarm: Alarm, response: Response) -> AlarmResource:
    response.headers["ETag"] = f'"{tag(alarm)}"'
    return AlarmResource.of(alarm)


def _watch(parts: Parts) -> Watch:
    look, troubles = parts[Service].look_for_damage, parts[TROUBLES]
    return Watch(parts[Acquisition], parts[Alarms], parts[FREE], parts[Sessions].end_all, troubles, look)


def _metrics(parts: Parts) -> Iterator[Metric]:
    active = GaugeMetricFamily("hilfit_alarms_active", "Active alarms.", labels=["machine", "kind", "severity"])
    for alarm in parts[Alarms].active():
        active.add_metric([alarm.machine or "", alarm.kind, alarm.severity], 1)
    yield active


ALARMS = Resource(
    name="alarms",
    routers=(router,),
    tables=(Alarm.table,),
    of_a_machine={"alarms": Alarm.table},
    kept={"/alarms": ("alarms",)},
    provides={
        Alarms: lambda parts: Alarms(parts[Database]),
        Watch: _watch,
    },
    running=lambda parts: [Running(Phase.WATCHING, parts[Watch].rounds.start, parts[Watch].rounds.stop)],
    metrics=_metrics,
)
