"""The resource ``monitor``: the live residual of each machine against its active calibrations."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import APIRouter
from prometheus_client.core import GaugeMetricFamily, Metric

from fitting.pipeline.stage_names import VALVE_REPORT
from server.alarms.alarm_desk import Alarms
from server.identifications.identification_results import MODEL_FILE, IdentificationResults
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.monitor.monitor_schemas import MonitorResource
from server.monitor.monitor_supervisor import Monitors
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.parts import Parts
from server.platform.resource import Phase, Resource, Running
from server.platform.settings import Settings
from server.recalibrations.recalibration_resource import POLICY
from server.schedules.recalibration_orders import RecalibrationOrders
from server.valves.valve_fits import ValveResults

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
        recalibrate=parts[RecalibrationOrders].order_drifted if parts[Settings].recalibrate_on_drift else None,
    )


def _running(parts: Parts) -> Iterator[Running]:
    monitors = parts[Monitors]
    yield Running(Phase.WATCHING, monitors.start, monitors.stop)


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
    running=_running,
    metrics=_metrics,
)
