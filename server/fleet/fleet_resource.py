"""The resource ``fleet``: all machines at a glance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel

from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import Calibrations
from server.calibrations.calibration_store import Calibration
from server.machines.acquisition import Acquisition
from server.machines.machine_store import MachineRow, Machines
from server.monitor.monitor_resource import MonitoredJoint
from server.monitor.monitor_supervisor import Monitors
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.http.bodies import Message, Shown
from server.platform.http.route_parameters import ServiceDep
from server.platform.resource import Parts, Resource


class FleetCalibration(BaseModel):
    """The calibration in use: since when, and the error over all joints that it reached, in noise floors."""

    id: str
    label: str
    activated: str | None
    error: float | None


class FleetAlarms(BaseModel):
    """How many alarms are active, and how many, active or not, nobody acknowledged."""

    critical: int = 0
    warning: int = 0
    info: int = 0
    waiting: int = 0


class FleetMachine(Shown):
    """A machine at a glance.

    ``monitor``: of its mechanics, or of its valves where these alone are watched. ``joint``: the one nearest to its
    limit, as the monitor has it: its ``residual`` in ``unit``, and ``cusum`` over ``threshold`` as the share of the
    limit. Null while nothing is watched.
    """

    name: str
    version: int
    acquisition: str
    monitor: Literal["off", "learning", "watching", "drift"]
    reason: str | None
    reason_message: Message | None = None
    joint: MonitoredJoint | None
    calibration: FleetCalibration | None
    alarms: FleetAlarms


class Fleet(BaseModel):
    """All machines, the one nearest to its limit first; those that are not watched follow by name."""

    items: list[FleetMachine]


#: Most machines that are gathered; a service has far fewer.
MOST = 500


def _gathered(parts: Parts, only: tuple[str, ...] | None) -> Fleet:
    """Gather the fleet by three readings of the store, however many machines; ``only``: of these machines."""
    rows = parts[Machines].list(MOST, machines=only).items
    in_use = parts[Calibrations].list(2 * MOST, machines=only, state="active").items
    active = {one.machine: one for one in in_use if one.kind == "identification"}
    alarms = _count_alarms(parts[Alarms])
    found = [_machine(parts, row, active.get(row.name), alarms.get(row.name, FleetAlarms())) for row in rows]
    return Fleet(items=sorted(found, key=_order))


def _count_alarms(alarms: Alarms) -> dict[str, FleetAlarms]:
    found: dict[str, FleetAlarms] = {}
    for alarm in alarms.open():
        if alarm.machine is None:
            continue
        counts = found.setdefault(alarm.machine, FleetAlarms())
        if alarm.state == "active":
            setattr(counts, alarm.severity, getattr(counts, alarm.severity) + 1)
        counts.waiting += not alarm.acknowledged
    return found


def _machine(parts: Parts, row: MachineRow, calibration: Calibration | None, alarms: FleetAlarms) -> FleetMachine:
    monitor = parts[Monitors].state(row.name)
    joints = [*monitor.get("joints", ()), *monitor["valves"].get("joints", ())]
    if monitor["state"] == "off" and monitor["valves"]["state"] != "off":
        monitor = monitor["valves"]
    return FleetMachine(
        name=row.name,
        version=row.version,
        acquisition=parts[Acquisition].state(row.name),
        monitor=monitor["state"],
        reason=monitor.get("reason"),
        joint=worst_joint(joints),
        calibration=None if calibration is None else _calibration(calibration),
        alarms=alarms,
    )


def worst_joint(joints: Iterable[Mapping[str, Any]]) -> MonitoredJoint | None:
    """Find the joint whose cumulative sum is nearest to, or furthest beyond, its threshold; None without one."""
    known = [MonitoredJoint.model_validate(joint) for joint in joints]
    return max(known, key=_share, default=None)


def _share(joint: MonitoredJoint) -> float:
    return joint.cusum / joint.threshold if joint.threshold > 0 else 0.0


def _order(machine: FleetMachine) -> tuple[float, str]:
    return (1.0 if machine.joint is None else -_share(machine.joint), machine.name)


def _calibration(calibration: Calibration) -> FleetCalibration:
    error = calibration.overall.get("after")
    return FleetCalibration(
        id=calibration.id,
        label=calibration.label,
        activated=calibration.activated,
        error=float(error) if isinstance(error, int | float) else None,
    )


router = APIRouter(prefix="/fleet", tags=["fleet"], route_class=TypedRoute)


@router.get("", dependencies=[require("read")])
def fleet(service: ServiceDep, principal: PrincipalDep) -> Fleet:
    """List all machines with their residual against its limit, the calibration in use, and number of alarms."""
    return _gathered(service, principal.machines)


FLEET = Resource(name="fleet", routers=(router,))
