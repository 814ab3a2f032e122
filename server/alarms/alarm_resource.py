"""The resource ``alarms``: what is wrong now, and who has seen it."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client.core import GaugeMetricFamily, Metric

from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_lifecycle import Alarm
from server.alarms.alarm_routes import router
from server.alarms.alarm_watch import Watch
from server.machines.acquisition import Acquisition
from server.platform.database.engine import Database
from server.platform.parts import TROUBLES, Parts
from server.platform.resource import Phase, Resource, Running
from server.platform.service import Service
from server.recordings.recording_resource import FREE
from server.recordings.recording_sessions import Sessions


def _watch(parts: Parts) -> Watch:
    look, troubles = parts[Service].look_for_damage, parts[TROUBLES]
    return Watch(parts[Acquisition], parts[Alarms], parts[FREE], parts[Sessions].end_all, troubles, look)


def _running(parts: Parts) -> Iterator[Running]:
    watch = parts[Watch]
    yield Running(Phase.WATCHING, watch.rounds.start, watch.rounds.stop)


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
    running=_running,
    metrics=_metrics,
)
