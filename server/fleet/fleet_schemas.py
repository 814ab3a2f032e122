"""What ``GET /fleet`` gives."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel

from server.monitor.monitor_schemas import MonitoredJoint


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


class FleetMachine(BaseModel):
    """A machine at a glance.

    ``joint``: the one nearest to its limit, as the monitor has it: its ``residual`` in ``unit``, and ``cusum`` over
    ``threshold`` as the share of the limit. Null while nothing is watched.
    """

    name: str
    version: int
    acquisition: str
    monitor: Literal["off", "learning", "watching", "drift"]
    reason: str | None
    joint: MonitoredJoint | None
    calibration: FleetCalibration | None
    alarms: FleetAlarms


class Fleet(BaseModel):
    """All machines, the one nearest to its limit first; those that are not watched follow by name."""

    items: list[FleetMachine]
