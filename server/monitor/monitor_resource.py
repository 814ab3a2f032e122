"""The resource ``monitor``: the live residual of each machine against its active calibrations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from fastapi import APIRouter
from prometheus_client.core import GaugeMetricFamily, Metric
from pydantic import BaseModel

from fitting.pipeline.stage_names import VALVE_REPORT
from server.alarms.alarm_desk import Alarms
from server.identifications.identification_results import MODEL_FILE, IdentificationResults
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.monitor.monitor_order import OverloadJoint, OverloadNow
from server.monitor.monitor_supervisor import Monitors
from server.platform.authorization.guard import TypedRoute, require
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.http.bodies import Message
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import Parts, Phase, Resource, Running
from server.platform.settings import Settings
from server.recalibrations.recalibration_resource import POLICY
from server.schedules.schedule_clock import ScheduleClock
from server.valves.valve_fits import ValveResults


class MovedNumber(BaseModel):
    """A number of a valve that has moved: ``edge``, ``gain`` or ``delay`` of a direction, by ``value`` in ``unit``."""

    name: str
    value: float
    std: float
    unit: str


class MonitoredJoint(BaseModel):
    """One joint's residual and its cumulative sums.

    ``residual`` is the root mean square of measured minus predicted effort (of valves: speed of the rod) over the last
    block, null while the joint rests. ``cusum`` is the largest of its sums, in standard deviations; a drift begins at
    ``threshold`` and ends at half of it. ``statistic`` says of what: ``offset``, ``direction`` (friction), ``level``
    (load or gain); of valves as in ``moved``, which says what a drift has moved as far as the blocks since then tell.
    ``false_alarms_per_year`` is of this joint, if it moved all year. ``learnt`` is 0 to 1.
    """

    joint: str
    residual: float | None
    unit: str
    cusum: float
    statistic: str
    threshold: float
    false_alarms_per_year: float
    learnt: float
    moved: list[MovedNumber] = []


class Payload(BaseModel):
    """Mass at the tip beyond that of the calibration's recordings, kg, of the last ten seconds of motion."""

    mass: float
    std: float


class Monitored(BaseModel):
    """What is followed against one calibration; ``reason`` says why it is off, ``delay_s`` how late the residual is."""

    state: Literal["off", "learning", "watching", "drift"]
    calibration: str | None = None
    since: str | None = None
    reason: str | None = None
    reason_message: Message | None = None
    joints: list[MonitoredJoint] = []
    time: float | None = None
    delay_s: float | None = None


class MonitorResource(Monitored):
    """The monitor of a machine, against the calibration of its mechanics, and of its ``valves``.

    ``overload_delay_s`` says how late an overload is judged, null where overloads are not watched: the calibration's
    model does not say what is usual. ``overload_joints`` leaves out joints that could not be judged. ``payload`` is
    null where too little moved.
    """

    payload: Payload | None = None
    overload: OverloadNow | None = None
    overload_joints: list[OverloadJoint] = []
    overload_delay_s: float | None = None
    valves: Monitored


router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)


@router.get("/{name}/monitor", responses=problems(404, 422), dependencies=[require("read")])
def monitor(name: str, service: ServiceDep) -> MonitorResource:
    """Report whether a machine still does as its active calibration predicts, joint by joint."""
    service[Machines].get(name)
    return MonitorResource(**service[Monitors].state(name))


def _monitors(parts: Parts) -> Monitors:
    return Monitors(
        parts[POLICY],
        parts[Acquisition],
        parts[Machines],
        parts[DataDirectory],
        {
            "identification": lambda id: parts[IdentificationResults].directory(id) / MODEL_FILE,
            "valves": lambda id: parts[ValveResults].directory(id) / VALVE_REPORT,
        },
        parts[Alarms],
        parts[Database].now,
        recalibrate=parts[ScheduleClock].order_drifted if parts[Settings].recalibrate_on_drift else None,
    )


def _metrics(parts: Parts) -> Iterator[Metric]:
    labels = ["machine", "joint"]
    residual = GaugeMetricFamily(
        "hilfit_residual", "Root mean square residual, in the joint's effort unit.", labels=labels
    )
    share = GaugeMetricFamily(
        "hilfit_residual_cusum_ratio",
        "Largest cumulative sum over its threshold; a drift begins at 1.",
        labels=labels,
    )
    payload = GaugeMetricFamily("hilfit_payload_kilograms", "Mass at the tip.", labels=["machine"])
    payload_std = GaugeMetricFamily(
        "hilfit_payload_std_kilograms", "Standard deviation of the mass at the tip.", labels=["machine"]
    )
    for machine in parts[Acquisition].names():
        state = parts[Monitors].state(machine)
        if (mass := state.get("payload")) is not None:
            payload.add_metric([machine], mass["mass"])
            payload_std.add_metric([machine], mass["std"])
        for joint in [*state.get("joints", ()), *state["valves"].get("joints", ())]:
            if joint["residual"] is not None:
                residual.add_metric([machine, joint["joint"]], joint["residual"])
            share.add_metric([machine, joint["joint"]], joint["cusum"] / joint["threshold"])
    yield from (residual, share, payload, payload_std)


MONITOR = Resource(
    name="monitor",
    routers=(router,),
    provides={Monitors: _monitors},
    running=lambda parts: [Running(Phase.WATCHING, parts[Monitors].start, parts[Monitors].stop)],
    metrics=_metrics,
)
