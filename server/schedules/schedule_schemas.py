"""What the REST interface takes and gives of schedules."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from server.identifications.identification_schemas import IdentificationOptions
from server.platform.authorization.named_things import ExcitationId, MachineName
from server.platform.http.bodies import Flag, Label, Listed
from server.recalibrations.recalibration_store import Plan
from server.schedules.schedule_clock import next_slot
from server.schedules.schedule_store import Schedule, SlotResource


class ScheduleWish(
    BaseModel,
    extra="forbid",
    json_schema_extra={
        "examples": [{"machine": "folding-arm", "cron": "30 2 * * 1", "timezone": "Europe/Vienna", "duration_s": 600}]
    },
):
    """When and how a machine is recalibrated.

    ``motion``: record normal ``operation`` for ``duration_s`` of machine time (two thirds are fitted, one third
    judges the fit), or the ``standard`` motion: ``excitations`` names one or two, the first to fit, the last to judge
    by. ``deadline_s``: how long it waits for the machine, or for the person who runs the motion. ``activate``: only
    ``if_better`` lets it activate what it finds.
    """

    machine: MachineName
    label: Label = ""
    cron: Annotated[str, Field(max_length=200)]
    timezone: Annotated[str, Field(max_length=64)] = "UTC"
    enabled: Flag = True
    motion: Literal["operation", "standard"] = "operation"
    duration_s: Annotated[float, Field(ge=30, le=86400)] = 300.0
    excitations: Annotated[list[ExcitationId], Field(max_length=2)] = []
    deadline_s: Annotated[float, Field(ge=10, le=86400)] = 3600.0
    options: IdentificationOptions = IdentificationOptions()
    activate: Literal["never", "if_better"] = "never"

    def plan(self) -> Plan:
        """What a slot does."""
        own = self.model_dump(include=set(Plan.__dataclass_fields__))
        return Plan(**{**own, "excitations": tuple(self.excitations)})


class ScheduleResource(ScheduleWish):
    """A schedule; ``next`` is its next slot in UTC, ``last`` the last that had its turn."""

    id: str
    created: str
    next: str | None
    last: str | None

    @classmethod
    def of(cls, schedule: Schedule, last: SlotResource | None) -> ScheduleResource:
        """From the store."""
        known = {**vars(schedule.plan), **vars(schedule), "next": next_slot(schedule), "last": last and last.slot}
        return cls(**{name: known[name] for name in cls.model_fields})


class ScheduleList(Listed[ScheduleResource]):
    """A page of schedules."""


class UpcomingSlots(BaseModel):
    """The next slots of a cron expression, in UTC; fewer where it ends."""

    slots: list[str]


class SlotList(BaseModel):
    """The newest slots of a schedule, newest first."""

    items: list[SlotResource]
