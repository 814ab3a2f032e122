"""What the routes of machines take and give."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from server.machines.machine_store import MachineRow
from server.platform.http.bodies import Body, Flag, Listed


class MachineSummary(MachineRow):
    """A machine: its current version, and whether it is acquired."""


class MachineCheck(BaseModel):
    """A machine file without fault: the machine's name, and the version that it would be (the current one as it is)."""

    name: str
    version: int


class MachineDetail(MachineSummary):
    """A machine with its validated file and the state of its acquisition."""

    versions: list[int]
    machine: dict[str, Any]
    acquisition: dict[str, Any]


class MachineList(Listed[MachineSummary]):
    """A page of machines; ``next`` is the cursor of the next page."""


class AcquisitionWish(Body, json_schema_extra={"examples": [{"enabled": True}]}):
    """Whether acquisition of a machine should run."""

    enabled: Flag
