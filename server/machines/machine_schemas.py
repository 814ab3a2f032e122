"""What the routes of machines take and give."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from server.machines.machine_store import MachineRow
from server.platform.database.engine import Page
from server.platform.http.bodies import Body, Flag


class MachineSummary(BaseModel):
    """A machine: its current version, and whether it is acquired."""

    name: str
    version: int
    current: int
    sha256: str
    created: str
    acquire: bool

    @classmethod
    def of(cls, row: MachineRow) -> MachineSummary:
        """From the store."""
        return cls(**row.__dict__)


class MachineCheck(BaseModel):
    """A machine file without fault: the machine's name, and the version that it would be (the current one as it is)."""

    name: str
    version: int


class MachineDetail(MachineSummary):
    """A machine with its validated file and the state of its acquisition."""

    versions: list[int]
    machine: dict[str, Any]
    acquisition: dict[str, Any]


class MachineList(BaseModel):
    """A page of machines; ``next`` is the cursor of the next page."""

    items: list[MachineSummary]
    next: int | None

    @classmethod
    def of(cls, page: Page[MachineRow]) -> MachineList:
        """From the store."""
        return cls(items=[MachineSummary.of(row) for row in page.items], next=page.next)


class AcquisitionWish(Body, json_schema_extra={"examples": [{"enabled": True}]}):
    """Whether acquisition of a machine should run."""

    enabled: Flag
