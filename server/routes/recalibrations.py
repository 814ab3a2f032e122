"""``/recalibrations``: what a schedule's slot, or a run by hand, recorded, fitted, compared and proposed."""

from __future__ import annotations

from typing import Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel

from server.access.guard import require
from server.access.route import TypedRoute
from server.routes.common import ServiceDep, problems
from server.store.recalibrations import Recalibration

router = APIRouter(prefix="/recalibrations", tags=["schedules"], route_class=TypedRoute)


class RecalibrationResource(BaseModel):
    """A recalibration; its id is the ``subject`` of its job. What it has not come to is null.

    ``recordings``: ids by role. ``comparison``: errors per joint on the newest recordings, of the active calibration
    (``before``) and of the new one (``after``).
    """

    id: str
    job: str
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    machine: str
    schedule: str | None
    label: str
    created: str
    recordings: dict[str, str]
    identification: str | None
    comparison: dict[str, Any] | None
    calibration: str | None

    @classmethod
    def of(cls, value: Recalibration, state: str) -> RecalibrationResource:
        """From the store."""
        row = {key: item for key, item in value.__dict__.items() if key in cls.model_fields}
        return cls.model_validate(row | {"state": state})


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> RecalibrationResource:
    """Read a recalibration, with the table of errors before and after."""
    found = service.recalibrations.get(id)
    return RecalibrationResource.of(found, service.jobs.get(found.job).state)
