"""What ``/alarms`` takes and gives."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from server.alarms.alarm_lifecycle import LONGEST_SHELF_S, Alarm
from server.platform.http.bodies import PLAIN, Body, Listed


class AlarmResource(Alarm):
    """An alarm: ``raised`` is when it came last, ``count`` how often before somebody acknowledged it."""


class AlarmList(Listed[AlarmResource]):
    """A page of alarms."""


class Shelf(Body, json_schema_extra={"examples": [{"seconds": 28800, "reason": "the sensor is replaced"}]}):
    """How long an alarm is to be quiet, and why."""

    seconds: Annotated[float, Field(gt=0, le=LONGEST_SHELF_S)]
    reason: Annotated[str, Field(min_length=1, max_length=200, pattern=PLAIN)]
