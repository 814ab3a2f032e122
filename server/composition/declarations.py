"""All resources of the service, one line each."""

from __future__ import annotations

from server.access.access_resource import ACCESS
from server.alarms.alarm_resource import ALARMS
from server.audit.audit_resource import AUDIT
from server.backups.backup_resource import BACKUPS
from server.bus_checks.bus_check_resource import BUS_CHECKS
from server.calibrations.calibration_resource import CALIBRATIONS
from server.can_signals.can_signals_resource import CAN_SIGNALS
from server.effects.effect_resource import EFFECTS
from server.excitations.excitation_resource import EXCITATIONS
from server.fleet.fleet_resource import FLEET
from server.history.history_resource import HISTORY
from server.identifications.identification_resource import IDENTIFICATIONS
from server.jobs.job_resource import JOBS
from server.live.live_resource import LIVE
from server.log_lines.log_resource import LOG_LINES
from server.machines.machine_resource import MACHINES
from server.monitor.monitor_resource import MONITOR
from server.outward.outward_resource import OUTWARD
from server.platform.resource import tables_of
from server.recalibrations.recalibration_resource import RECALIBRATIONS
from server.recordings.recording_resource import RECORDINGS
from server.schedules.schedule_resource import SCHEDULES
from server.traces.traces_resource import TRACES
from server.valves.valve_resource import VALVES

#: Routes are tried in this order, one after the other: what pages ask for most comes first.
RESOURCES = (
    LIVE,
    MACHINES,
    BUS_CHECKS,
    CAN_SIGNALS,
    MONITOR,
    FLEET,
    HISTORY,
    TRACES,
    RECORDINGS,
    IDENTIFICATIONS,
    VALVES,
    EXCITATIONS,
    SCHEDULES,
    RECALIBRATIONS,
    CALIBRATIONS,
    BACKUPS,
    JOBS,
    EFFECTS,
    ALARMS,
    OUTWARD,
    ACCESS,
    AUDIT,
    LOG_LINES,
)
#: All tables of the store.
TABLES = tables_of(RESOURCES)
