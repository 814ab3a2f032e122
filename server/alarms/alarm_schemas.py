"""What ``/alarms`` takes and gives."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from server.alarms.alarm_conditions import Severity
from server.alarms.alarm_lifecycle import LONGEST_SHELF_S
from server.platform.http.bodies import PLAIN, Listed, Shown


class AlarmResource(Shown):
    """An alarm: ``raised`` is when it came last, ``count`` how often before somebody acknowledged it."""

    id: str
    machine: str | None
    kind: str
    text: str
    severity: Severity
    state: Literal["active", "cleared"]
    acknowledged: bool
    acknowledged_by: str | None
    shelved_until: str | None
    shelved_by: str | None
    shelve_reason: str | None
    raised: str
    cleared: str | None
    count: int


class AlarmList(Listed[AlarmResource]):
    """A page of alarms."""


class Shelf(BaseModel, json_schema_extra={"examples": [{"seconds": 28800, "reason": "the sensor is replaced"}]}):
    """How long an alarm is to be quiet, and why."""

    model_config = ConfigDict(extra="forbid")

    seconds: Annotated[float, Field(gt=0, le=LONGEST_SHELF_S)]
    reason: Annotated[str, Field(min_length=1, max_length=200, pattern=PLAIN)]
