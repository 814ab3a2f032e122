"""The resource ``recalibrations``: what schedules and people order, and how far it came."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from fastapi import APIRouter

from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import ByPolicy
from server.excitations.excitation_job import ExcitationKind, MotionDelivery
from server.identifications.identification_order import IdentificationOrders
from server.jobs.job_store import Jobs
from server.platform.authorization.guard import TypedRoute, require
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import PartName, Parts, Resource
from server.platform.settings import Settings
from server.recalibrations.recalibration_job import PROGRAM, RecalibrationKind, Surroundings
from server.recalibrations.recalibration_site import Site
from server.recalibrations.recalibration_store import Recalibration, Recalibrations, recalibrations
from server.recordings.recording_sessions import Sessions


class RecalibrationResource(Recalibration):
    """A recalibration; its id is the ``subject`` of its job. What it has not come to is null.

    ``recordings``: ids by role. ``comparison``: errors per joint on the newest recordings, of the active calibration
    (``before``) and of the new one (``after``).
    """


router = APIRouter(prefix="/recalibrations", tags=["schedules"], route_class=TypedRoute)


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> RecalibrationResource:
    """Read a recalibration, with the table of errors before and after."""
    return RecalibrationResource.of(service[Recalibrations].get(id))


COMPARISON: PartName[Sequence[str]] = PartName("the program that compares calibrations")
POLICY: PartName[ByPolicy] = PartName("what recalibrations do to calibrations")


def _kind(parts: Parts) -> RecalibrationKind:
    around = Surroundings(
        parts[POLICY],
        parts[Alarms],
        parts[Site],
        parts[IdentificationOrders].order,
        parts[Jobs].request_cancel,
        threading.Semaphore(parts[Settings].recordings_at_once),
    )
    return RecalibrationKind(parts[Database], parts[DataDirectory], around, parts[COMPARISON])


RECALIBRATIONS = Resource(
    name="recalibrations",
    routers=(router,),
    tables=(recalibrations,),
    of_a_machine={"recalibrations": recalibrations},
    provides={
        COMPARISON: lambda parts: PROGRAM,
        POLICY: lambda parts: parts[ByPolicy],
        Recalibrations: lambda parts: Recalibrations(parts[Database]),
        Site: lambda parts: Site(
            parts[Database],
            parts[DataDirectory],
            parts[Sessions],
            parts[ExcitationKind],
            parts[MotionDelivery],
        ),
        RecalibrationKind: _kind,
    },
    job_kinds=(RecalibrationKind,),
)
