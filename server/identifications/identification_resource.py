"""The resource ``identifications``: both stages and the loop, from recordings."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from server.identifications.identification_job import IdentificationKind
from server.identifications.identification_order import IdentificationOrders
from server.identifications.identification_results import IdentificationResults
from server.identifications.identification_routes import router
from server.identifications.identification_store import (
    Identifications,
    identification_recordings,
    identifications,
)
from server.identifications.stage_request import StageProgram, fitting_program
from server.jobs.job_places import named_results
from server.jobs.job_runner import JobRunner
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.parts import PartName, Parts
from server.platform.resource import BackedUp, Resource

#: The stages of an identification, and the command that runs one; called when the first job needs it.
STAGE_PROGRAM: PartName[Callable[[], StageProgram]] = PartName("stages of an identification")


def _kind(parts: Parts) -> IdentificationKind:
    return IdentificationKind(parts[Database], parts[DataDirectory], parts[STAGE_PROGRAM])


def _orders(parts: Parts) -> IdentificationOrders:
    return IdentificationOrders(
        parts[Database],
        lambda: parts[IdentificationKind].stages,
        lambda job: parts[JobRunner].enqueue(job),
    )


IDENTIFICATIONS = Resource(
    name="identifications",
    routers=(router,),
    tables=(identifications, identification_recordings),
    of_a_machine={"identifications": identifications},
    kept={"/identifications": ("identifications",)},
    provides={
        STAGE_PROGRAM: lambda parts: fitting_program,
        Identifications: lambda parts: Identifications(parts[Database]),
        IdentificationResults: lambda parts: IdentificationResults(parts[Database], parts[DataDirectory]),
        IdentificationKind: _kind,
        IdentificationOrders: _orders,
    },
    job_kinds=(IdentificationKind,),
    backed_up=BackedUp("identifications", partial(named_results, identifications)),
)
