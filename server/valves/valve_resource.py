"""The resource ``valves``: from commands to speeds, from recordings."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from functools import partial
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse
from pydantic import Field

from fitting.pipeline.stage_names import INVERSES, VALVE_REPORT, VALVE_STAGE
from server.identifications.identification_job import StageProgram, fitting_program
from server.identifications.identification_resource import FitOrder
from server.jobs.job_places import named_results
from server.jobs.job_runner import JobRunner
from server.platform.authorization.guard import TypedRoute, require
from server.platform.database.engine import Database
from server.platform.errors import NotFoundError
from server.platform.files import DataDirectory
from server.platform.http.bodies import Body, Flag, Listed
from server.platform.http.route_parameters import Idempotency, MachineQuery, PageDep, ServiceDep, problems, sends
from server.platform.resource import BackedUp, PartName, Resource
from server.valves.valve_fits import ValveFit, ValveFits, ValveKind, ValveOrders, ValveResults, valve_recordings, valves


class ValveOptions(Body):
    """Choices: ``loop``: look for effects. ``bandwidth_hz``: of the filter; 3 Hz, or a fifth of a slower rate."""

    loop: Flag = True
    bandwidth_hz: Annotated[float, Field(gt=0)] | None = None


class ValveOrder(FitOrder):
    """Whose valves to identify, from recordings with commands; those in the role ``validate`` are judged on."""

    options: ValveOptions = ValveOptions()


class ValveResource(ValveFit):
    """An identification of valves; ``axes`` are there, by joint, once its job is done."""


class ValveList(Listed[ValveResource]):
    """A page of identifications of valves."""


router = APIRouter(prefix="/valves", tags=["valves"], route_class=TypedRoute)
InverseFormat = Literal["c", "csv", "fmu", "python", "st"]
#: Format of a file (:func:`fitting.valve.export.formats`) by its ending.
ENDINGS: dict[str, InverseFormat] = {".c": "c", ".h": "c", ".csv": "csv", ".fmu": "fmu", ".py": "python", ".st": "st"}


@router.post("", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
async def order(
    body: ValveOrder, response: Response, service: ServiceDep, idempotency_key: Idempotency = None
) -> ValveResource:
    """Order an identification of valves: its job is at ``Location``; one ``Idempotency-Key`` makes one job."""
    return ValveResource.of(await body.taken(service, ValveOrders, response, idempotency_key))


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_valves(service: ServiceDep, page: PageDep, machine: MachineQuery = None) -> ValveList:
    """List identifications of valves, newest first."""
    return ValveList.of(service[ValveFits].list(**page, machine=machine))


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> ValveResource:
    """Read an identification of valves."""
    return ValveResource.of(service[ValveFits].get(id))


@router.get("/{id}/valve.json", **sends({"application/json": {}}, 404, 409, 422), dependencies=[require("read")])
def report(id: str, service: ServiceDep) -> FileResponse:
    """Download the result (schema ``hilfit/valve/1``)."""
    return FileResponse(service[ValveResults].written(id, VALVE_REPORT), media_type="application/json")


@router.get("/{id}/inverse.zip", **sends({"application/zip": {}}, 404, 409, 422), dependencies=[require("read")])
def inverse(
    id: str,
    service: ServiceDep,
    format: Annotated[InverseFormat | None, Query(description="Of the files; all formats without it")] = None,
) -> Response:
    """Download a controller's inverse: each axis' command for a speed, as source; 404 if no valve moved its axis."""
    folder = service[ValveResults].written(id, VALVE_REPORT).with_name(INVERSES)
    wanted = [ending for ending, own in ENDINGS.items() if format in (None, own)]
    files = sorted(path for path in folder.glob("*") if path.suffix in wanted)
    if not files:
        raise NotFoundError("server.valves_no_inverse_none", id=id).about(valve=id)
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in files:
            archive.writestr(zipfile.ZipInfo(path.name), path.read_bytes())  # no time: the same files, the same archive
    name = f"{id}-inverse{'' if format is None else f'-{format}'}.zip"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(held.getvalue(), media_type="application/zip", headers=headers)


#: The stage of an identification of valves, and the command that runs it; called when the first job needs it.
VALVE_PROGRAM: PartName[Callable[[], StageProgram]] = PartName("stage of an identification of valves")


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
        ValveOrders: lambda parts: ValveOrders(
            parts[Database],
            lambda: parts[ValveKind].stages,
            lambda job: parts[JobRunner].enqueue(job),
        ),
    },
    job_kinds=(ValveKind,),
    backed_up=BackedUp("valves", partial(named_results, valves)),
)
