"""What is gathered of all machines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import Calibrations
from server.calibrations.calibration_store import Calibration
from server.fleet.fleet_schemas import Fleet, FleetAlarms, FleetCalibration, FleetMachine
from server.machines.acquisition import Acquisition
from server.machines.machine_store import MachineRow, Machines
from server.monitor.monitor_schemas import MonitoredJoint
from server.monitor.monitor_supervisor import Monitors

#: Most machines that are gathered; a service has far fewer.
MOST = 500


class FleetView:
    """Gathers the state of all machines; three readings of the store, however many there are."""

    def __init__(
        self,
        machines: Machines,
        acquisition: Acquisition,
        monitors: Monitors,
        calibrations: Calibrations,
        alarms: Alarms,
    ) -> None:
        self._machines = machines
        self._acquisition = acquisition
        self._monitors = monitors
        self._calibrations = calibrations
        self._alarms = alarms

    def gather(self, only: tuple[str, ...] | None) -> Fleet:
        """The fleet; ``only``: of these machines."""
        rows = self._machines.list(MOST, only=only).items
        active = {one.machine: one for one in self._calibrations.list(MOST, machines=only, state="active").items}
        alarms = self._count_alarms()
        found = [self._machine(row, active.get(row.name), alarms.get(row.name, FleetAlarms())) for row in rows]
        return Fleet(items=sorted(found, key=_order))

    def _count_alarms(self) -> dict[str, FleetAlarms]:
        found: dict[str, FleetAlarms] = {}
        for alarm in self._alarms.open():
            if alarm.machine is None:
                continue
            counts = found.setdefault(alarm.machine, FleetAlarms())
            if alarm.state == "active":
                setattr(counts, alarm.severity, getattr(counts, alarm.severity) + 1)
            counts.waiting += not alarm.acknowledged
        return found

    def _machine(self, row: MachineRow, calibration: Calibration | None, alarms: FleetAlarms) -> FleetMachine:
        monitor = self._monitors.state(row.name)
        return FleetMachine(
            name=row.name,
            version=row.version,
            acquisition=self._acquisition.state(row.name),
            monitor=monitor["state"],
            reason=monitor.get("reason"),
            joint=worst_joint(monitor.get("joints", ())),
            calibration=None if calibration is None else _calibration(calibration),
            alarms=alarms,
        )


def worst_joint(joints: Iterable[Mapping[str, Any]]) -> MonitoredJoint | None:
    """The joint whose cumulative sum is nearest to, or furthest beyond, its threshold; None if there is none."""
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
