"""The resource ``valves``: from commands to speeds, from recordings."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fitting.pipeline.stage_names import VALVE_STAGE
from server.identifications.stage_request import StageProgram, fitting_program
from server.jobs.job_places import named_results
from server.jobs.job_runner import JobRunner
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.parts import PartName, Parts
from server.platform.resource import BackedUp, Resource
from server.valves.valve_fits import ValveFits, ValveKind, ValveOrders, ValveResults, valve_recordings, valves
from server.valves.valve_routes import router

#: The stage of an identification of valves, and the command that runs it; called when the first job needs it.
VALVE_PROGRAM: PartName[Callable[[], StageProgram]] = PartName("stage of an identification of valves")


def _orders(parts: Parts) -> ValveOrders:
    return ValveOrders(
        parts[Database],
        lambda: parts[ValveKind].stages,
        lambda job: parts[JobRunner].enqueue(job),
    )


VALVES = Resource(
    name="valves",
    routers=(router,),
    tables=(valves, valve_recordings),
    of_a_machine={"valves": valves},
    kept={"/valves": ("valves",)},
    provides={
        VALVE_PROGRAM: lambda parts: partial(fitting_program, (VALVE_STAGE,)),
        ValveFits: lambda parts: ValveFits(parts[Database]),
        ValveResults: lambda parts: ValveResults(parts[Database], parts[DataDirectory]),
        ValveKind: lambda parts: ValveKind(parts[Database], parts[DataDirectory], parts[VALVE_PROGRAM]),
        ValveOrders: _orders,
    },
    job_kinds=(ValveKind,),
    backed_up=BackedUp("valves", partial(named_results, valves)),
)
