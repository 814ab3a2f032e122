"""``/valves``: order, list, read, report, inverses."""

from __future__ import annotations

import io
import zipfile
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse

from daq.messages import Sentence
from fitting.pipeline.stage_names import INVERSES, VALVE_REPORT
from server.identifications.identification_order import Wish
from server.platform.authorization.guard import require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import NotFoundError
from server.platform.http.route_parameters import (
    Idempotency,
    MachineQuery,
    PageDep,
    ServiceDep,
    problems,
)
from server.valves.valve_fits import ValveFits, ValveOrders, ValveResults
from server.valves.valve_schemas import ValveList, ValveOrder, ValveResource

router = APIRouter(prefix="/valves", tags=["valves"], route_class=TypedRoute)
InverseFormat = Literal["c", "csv", "fmu", "python", "st"]
#: Format of a file (:func:`fitting.valve.export.formats`) by its ending.
ENDINGS: dict[str, InverseFormat] = {".c": "c", ".h": "c", ".csv": "csv", ".fmu": "fmu", ".py": "python", ".st": "st"}


@router.post("", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
async def order(
    body: ValveOrder, response: Response, service: ServiceDep, idempotency_key: Idempotency = None
) -> ValveResource:
    """Order an identification of valves: its job is at ``Location``; one ``Idempotency-Key`` makes one job."""
    recordings = tuple((choice.id, choice.role) for choice in body.recordings)
    wish = Wish(body.machine, recordings, body.options.model_dump(), body.label)
    # Shared storage may have to be filled first, and may be far away.
    made = await service.heavy.aside(service[ValveOrders].order, wish, idempotency_key)
    response.headers["Location"] = f"/api/v1/jobs/{made.job}"
    return ValveResource.of(made)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_valves(service: ServiceDep, page: PageDep, machine: MachineQuery = None) -> ValveList:
    """List identifications of valves, newest first."""
    return ValveList.of(service[ValveFits].list(**page, machine=machine))


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> ValveResource:
    """Read an identification of valves."""
    return ValveResource.of(service[ValveFits].get(id))


@router.get(
    "/{id}/valve.json",
    response_class=FileResponse,
    responses={200: {"content": {"application/json": {}}}, **problems(404, 409, 422)},
    dependencies=[require("read")],
)
def report(id: str, service: ServiceDep) -> FileResponse:
    """Download the result (schema ``hilfit/valve/1``)."""
    return FileResponse(service[ValveResults].written(id, VALVE_REPORT), media_type="application/json")


@router.get(
    "/{id}/inverse.zip",
    response_class=Response,
    responses={200: {"content": {"application/zip": {}}}, **problems(404, 409, 422)},
    dependencies=[require("read")],
)
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
        raise NotFoundError(Sentence("server.valves_no_inverse_none", id=id), valve=id)
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in files:
            archive.writestr(zipfile.ZipInfo(path.name), path.read_bytes())  # no time: the same files, the same archive
    name = f"{id}-inverse{'' if format is None else f'-{format}'}.zip"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(held.getvalue(), media_type="application/zip", headers=headers)
